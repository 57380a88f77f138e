import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bag_writer
import synthetic
from phri_analysis.bag_files import BagFile

ROOT = Path(__file__).resolve().parents[1]
FAKE = os.pathsep.join([str(ROOT / "tests" / "fake"), str(ROOT / "tests")])


def run(*arguments, cwd=None):
    """phri-analysis as a user starts it, with the stand-in for phri_sim."""
    return subprocess.run(
        [str(ROOT / "bin" / "phri-analysis"), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": FAKE + os.pathsep + os.environ.get("PYTHONPATH", "")},
    )


def failed(result, code, *words):
    assert result.returncode == code, result.stderr
    assert result.stderr.count("\n") == 1 and result.stderr.startswith("phri-analysis: ")
    assert all(word in result.stderr for word in words), result.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["report", "--help"], ["simulate", "--help"], ["--version"]])
def test_help(arguments):
    result = run(*arguments)
    assert result.returncode == 0 and "phri-analysis" in result.stdout


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["report"], ["BAGS_OR_DIR"]),
        (["reprot"], ["reprot"]),
        (["simulate", "maze", "--participants", "many"], ["many"]),
        (["simulate", "maze", "--controllers", "lrq"], ["lrq", "mahalanobis"]),
    ],
)
def test_usage_errors(arguments, words):
    failed(run(*arguments), 64, *words)


def test_simulate_writes_the_same_bytes_for_any_jobs(tmp_path):
    options = [
        "simulate",
        "maze_assistance",
        "--participants",
        1,
        "--trials",
        1,
        "--seed",
        7,
        "--controllers",
        "none,lqr",
    ]
    result = run(*options, "--out", tmp_path / "one")
    assert result.returncode == 0, result.stderr
    assert "Human power [W]" in result.stdout and str(tmp_path / "one" / "report.html") in result.stdout
    assert "(c) Mahalanobis" not in result.stdout
    assert run(*options, "--jobs", 2, "--out", tmp_path / "two").returncode == 0
    for name in ("table.csv", "report.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_simulate_has_a_default_folder(tmp_path):
    assert run("simulate", "maze_assistance", "--participants", 1, "--trials", 1, cwd=tmp_path).returncode == 0
    assert (tmp_path / "results" / "studies" / "maze_assistance" / "report.html").is_file()


def test_report_of_a_folder_and_its_errors(tmp_path):
    for participant in (1, 2):
        trial = synthetic.plausible_trial(participant).iloc[:600]
        trial.attrs = synthetic.plausible_trial(participant).attrs
        bag_writer.write_bag(trial, tmp_path / f"{participant}.bag")
    result = run("report", tmp_path)
    assert result.returncode == 0, result.stderr
    html = (tmp_path / "report.html").read_text()
    assert "1.bag" in html and "2.bag" in html and (tmp_path / "table.csv").is_file()

    (tmp_path / "3.bag").write_bytes((tmp_path / "1.bag").read_bytes()[:20000])
    failed(run("report", tmp_path, "--out", tmp_path / "x"), 65, "3.bag")
    assert not (tmp_path / "x").exists()
    assert run("report", tmp_path, "--out", tmp_path / "x", "--skip-bad").returncode == 0
    assert "Left out" in (tmp_path / "x" / "report.html").read_text()
    failed(run("report", tmp_path / "1.bag", "--out", tmp_path / "2.bag" / "out"), 74, "2.bag")


def test_missing_input(tmp_path):
    failed(run("report", tmp_path / "nowhere"), 66, "nowhere")
    failed(run("report", tmp_path), 66, "no bag")
    failed(run("simulate", "absent"), 66, "absent.yaml")


def test_bad_data(tmp_path):
    failed(run("simulate", "bad.yaml"), 65, "learner/states")
    (tmp_path / "a.bag").write_bytes(b"")
    failed(run("report", tmp_path / "a.bag"), 65, "a.bag")


@pytest.fixture
def real_time_bag(tmp_path):
    trial = synthetic.plausible_trial(grid=synthetic.maze_grid(30))
    short = trial.iloc[:1200].reset_index(drop=True)
    short.attrs = {**trial.attrs, "clock": "realtime"}
    short["lateness"] = np.where(np.arange(1200) % 100 == 7, 3e-3, 8e-5)
    return bag_writer.write_bag(short, tmp_path / "a.bag")


def test_check_says_what_is_verified(real_time_bag, tmp_path):
    result = run("check", tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith(f"ok {real_time_bag}: ") and "intact up to 2.199 s" in result.stdout
    content = bytearray(real_time_bag.read_bytes())
    _, _, start, stop = BagFile(bytes(content)).chunks[30]
    content[(start + stop) // 2] ^= 16
    real_time_bag.write_bytes(content)
    failed(run("check", tmp_path), 65, "a.bag: byte ", "after 1.", " s: chunk: lz4", "topic /phri/", "were recorded")
    assert run("check", tmp_path).stdout.startswith("DAMAGED")
    failed(run("check", tmp_path / "none.bag"), 66, "none.bag")


def test_recover_saves_what_is_intact(real_time_bag, tmp_path):
    failed(run("recover", real_time_bag), 64, "nothing to recover")
    active = tmp_path / "a.bag.active"
    active.write_bytes(real_time_bag.read_bytes()[:-60000])
    real_time_bag.unlink()
    failed(run("report", tmp_path), 66, "a.bag.active was cut off", "phri-analysis recover")
    result = run("recover", active)
    assert result.returncode == 0, result.stderr
    saved = tmp_path / "a.recovered.bag"
    assert f"{saved}: " in result.stdout and "no final digest" in result.stdout
    assert run("check", saved).returncode == 0
    assert run("report", saved, "--out", tmp_path / "out").returncode == 0
    assert "1 trials are cut off or have gaps" in (tmp_path / "out" / "report.html").read_text()
    failed(run("recover", active), 64, "a.recovered.bag exists, and is not overwritten")
    (tmp_path / "b.bag").write_bytes(b"no bag")
    failed(run("recover", tmp_path / "b.bag"), 65, "not a readable ROS bag")


def test_lateness_prints_and_draws(real_time_bag, tmp_path):
    result = run("lateness", tmp_path)
    assert result.returncode == 0, result.stderr
    assert "<= 0.1 ms       1188   99.000 %" in result.stdout and "<= 5 ms         12    1.000 %" in result.stdout
    assert "1200 ticks: p50 0.080 ms, p99 0.080 ms, p99.9 3.000 ms, worst 3.000 ms, 36 slipped" in result.stdout
    assert (tmp_path / "lateness.png").read_bytes().startswith(b"\x89PNG")
    trial = synthetic.constant_trial(ticks=100, clock="lockstep")
    failed(run("lateness", bag_writer.write_bag(trial, tmp_path / "b.bag")), 65, "b.bag: no lateness", "lockstep")


def test_a_run_that_breaks_is_an_internal_error():
    failed(run("simulate", "breaks"), 70, "the tick faulted")
