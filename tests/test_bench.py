"""make bench: the arithmetic of a row, every way in which a peer can fail, and, where the programs are built, a run of
the real ones. What is fast is nothing for a test: no number here is a measured time."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
BENCH = ROOT / "scripts" / "bench"
BUILT = pathlib.Path(os.environ.get("PHRI_BUILD", ROOT / "catkin_ws" / "build")) / "phri_sim" / "bench"
sys.path.insert(0, str(BENCH))
import peer as peer_module  # noqa: E402
import rows  # noqa: E402

KEYS = {"name", "ours", "unit", "peer", "peer_value", "ratio", "runs", "spread", "check", "reason"}
OURS = {
    "plan/mahalanobis": 40, "plan/lqr": 20, "plan/lqr_gains_kept": 10, "lq_solve": 15, "prediction": 25, "viterbi": 16}
TICK = {"unit": "ns", "step": {"median": 1000, "p999": 5000}, "tick": {"median": 100, "p999": 900}}
PROGRAM = """#!/bin/bash
case $1 in --write_case=*) echo '{}' >"${1#*=}"; exit ;; esac
echo '%s'
"""
# a peer interpreter: told the program and the case, it introduces itself and answers every line
PEER = """#!/bin/bash
name=$(basename "$1" .py)
%s
echo "a greeting that is no JSON"
echo '{"version": "'$name' 1.0", "checks": %s}'
while read -r line; do echo '%s'; done
"""
ANSWER = {spec.name: 160 for spec in rows.ROWS}


class FakePeer:
    version, checks, reason = "other 1.0", {}, ""

    def __init__(self, **changes):
        self.name = "other"
        self.__dict__.update(changes)


def one_row(ours, theirs, peer=None, **changes):
    spec = rows.Spec("x", "us", "x", ("other",), **changes)
    answered = [{} if value is None else {"x": value} for value in theirs]
    (row,) = rows.complete(spec, [{"x": value} for value in ours], {"other": peer or FakePeer()}, {"other": answered})
    return row


def test_ratio_is_the_median_of_the_rounds_own_ratios():
    """A machine that is ten times slower in one round slows both: the ratio does not see it, the medians would."""
    row = one_row([10, 100, 20], [40, 400, 80])
    assert row["ratio"] == 4.0 and row["spread"] == 0.0
    # medians are 10 and 30, whose ratio is 3; the rounds' ratios are 3, 2, 0.5
    assert one_row([10, 15, 4], [30, 30, 2])["ratio"] == 2.0


def test_ratio_says_how_many_times_better_ours_is():
    assert one_row([10], [40])["ratio"] == 4.0
    assert one_row([10], [40], more_is_better=True)["ratio"] == 0.25


def test_spread_is_the_interquartile_range_over_the_median():
    assert rows.spread_of([1, 2, 3, 4, 5]) == pytest.approx(2 / 3)
    assert rows.spread_of([7]) == 0.0


def test_row_without_peer_has_its_own_median_and_spread():
    (row,) = rows.complete(rows.Spec("x", "us", "x"), [{"x": value} for value in (1, 2, 3, 4, 5)], {}, {})
    assert set(row) == KEYS
    assert (row["ours"], row["peer"], row["peer_value"], row["ratio"], row["runs"]) == (3, None, None, None, 5)
    assert row["spread"] == pytest.approx(2 / 3)


@pytest.mark.parametrize("wrong", [1e-6, float("inf"), float("nan")])
def test_another_result_gets_no_ratio(wrong):
    row = one_row([10], [40], FakePeer(checks={"x": wrong}))
    assert row["ratio"] is None and row["peer_value"] == 40 and "another result" in row["reason"]
    assert one_row([10], [40], FakePeer(checks={"x": 1e-15}))["ratio"] == 4.0


def test_peer_that_misses_a_round_gets_no_ratio():
    row = one_row([10, 10], [40, None])
    assert row["peer_value"] is None and row["ratio"] is None and row["reason"] == "other did not measure x"


def test_difference_is_relative_and_sees_shapes():
    assert peer_module.difference([[1.0, 4.0]], [[1.0, 5.0]]) == pytest.approx(0.2)
    assert peer_module.difference([1.0], [1.0, 2.0]) == float("inf")


def test_docs_table_is_rewritten_between_its_markers_only(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{rows.BEGIN}\nold\n{rows.END}\nafter\n")
    result = {"machine": dict.fromkeys(
        ("processor", "cores", "memory", "kernel", "compiler", "load_before", "revision"), "m"),
        "rounds": 1, "seconds": 1, "rows": [one_row([10], [40])]}
    rows.write_docs(page, result)
    once = page.read_text()
    rows.write_docs(page, result)
    assert page.read_text() == once
    assert once.startswith("before\n") and once.endswith("\nafter\n") and "old" not in once and "| 4 |" in once
    page.write_text("no markers")
    with pytest.raises(ValueError, match="has no lines"):
        rows.write_docs(page, result)


def test_page_has_the_markers():
    text = (ROOT / "docs" / "benchmarks.md").read_text()
    assert text.count(rows.BEGIN) == 1 and text.index(rows.BEGIN) < text.index(rows.END)
    for spec in rows.ROWS:
        assert f"`{spec.name}`" in text, f"docs/benchmarks.md does not say what {spec.name} is"


@pytest.fixture
def fakes(tmp_path):
    """Fake programs of ours, in a folder as after a build."""
    entries = [{"name": name, "cpu_time": value} for name, value in OURS.items()]
    entries.append({"name": "trials", "cpu_time": 100, "simulated_s": 20})
    for name, output in (("bench_tick", TICK), ("bench_pipeline", {"benchmarks": entries})):
        program(tmp_path / name, PROGRAM % json.dumps(output))
    return tmp_path


def program(path, text):
    path.write_text(text)
    path.chmod(0o755)
    return path


def run(folder, *arguments):
    """(exit status, bench.json or nothing, standard error)"""
    output = folder / "out" / "bench.json"
    done = subprocess.run(
        [sys.executable, BENCH / "bench.py", "--programs", folder, "--output", output, *arguments],
        capture_output=True, text=True)
    return done.returncode, json.loads(output.read_text()) if output.exists() else None, done.stderr


def test_without_peers_every_row_is_there_and_has_none(fakes):
    status, result, _ = run(fakes, "--rounds", "2")
    assert status == 0
    assert [row["name"] for row in result["rows"]] == [spec.name for spec in rows.ROWS]
    for row in result["rows"]:
        assert set(row) == KEYS
        assert row["peer"] is row["peer_value"] is row["ratio"] is row["reason"] is None and row["runs"] == 2
    ours = {row["name"]: row["ours"] for row in result["rows"]}
    assert ours["trial_speed"] == 200.0  # 20 s in 100 ms
    assert (ours["tick_step_p999"], ours["tick_loop_median"], ours["plan_lqr"]) == (5000, 100, 20)


def peer_rows(result):
    return [row for row in result["rows"] if row["peer"]]


def test_with_peers_every_row_that_names_one_has_its_ratio(fakes):
    python = program(fakes / "python", PEER % ("", '{"viterbi": 0.0}', json.dumps(ANSWER)))
    status, result, errors = run(fakes, "--peers", python, "--rounds", "2")
    assert status == 0, errors
    assert len(peer_rows(result)) == sum(len(spec.peers) for spec in rows.ROWS)
    for row in peer_rows(result):
        expected = row["ours"] / 160 if row["name"] == "trial_speed" else 160 / row["ours"]
        assert row["ratio"] == pytest.approx(expected) and row["peer_value"] == 160


@pytest.mark.parametrize("body, checks, answer, reason", [
    ("echo 'no module of that name' >&2; exit 1", "{}", ANSWER, "no module of that name"),
    ("exit 3", "{}", ANSWER, "ended with status 3"),
    ("", '{"viterbi": 0.5}', ANSWER, "another result"),
    ("", "{}", {}, "did not measure"),
    ("echo '{no JSON'", "{}", ANSWER, "answered with no JSON"),
])
def test_broken_peer_is_reported_and_not_passed_over(fakes, body, checks, answer, reason):
    python = program(fakes / "python", PEER % (body, checks, json.dumps(answer)))
    status, result, _ = run(fakes, "--peers", python, "--rounds", "1")
    assert status == 70
    row = next(row for row in result["rows"] if row["name"] == "viterbi")
    assert row["ratio"] is None and reason in row["reason"] and row["ours"] == 16


def test_missing_interpreter_and_what_pip_said_are_reported(fakes):
    told = fakes / "venv" / "not_installed"
    told.mkdir(parents=True)
    (told / "hmmlearn").write_text("pip: ERROR: no such version\n")
    status, result, _ = run(fakes, "--peers", fakes / "venv" / "bin" / "python", "--rounds", "1")
    assert status == 70
    reasons = {row["name"]: row["reason"] for row in peer_rows(result)}
    assert reasons["viterbi"] == "pip: ERROR: no such version" and "No such file" in reasons["lq_solve"]


def test_bad_arguments_and_missing_programs(fakes, tmp_path):
    assert run(fakes, "--rounds", "0")[0] == 64
    assert run(fakes, "--seconds", "nan")[0] == run(fakes, "--seconds", "inf")[0] == 64
    assert run(fakes, "--quick", "--docs", "page.md")[0] == 64
    status, result, errors = run(tmp_path / "nothing")
    assert status == 66 and result is None and "bench_tick is not there" in errors
    program(fakes / "bench_tick", "#!/bin/bash\necho broken >&2\nexit 70\n")
    status, result, errors = run(fakes)
    assert status == 70 and result is None and "broken" in errors


@pytest.mark.parametrize("arguments, settings, status, text", [
    (["--fast"], {}, 64, "unknown argument --fast"),
    (["--rounds"], {}, 64, "--rounds needs a number"),
    ([], {"PEERS": "maybe"}, 64, "PEERS=maybe, expected yes or no"),
    ([], {"PEERS": "no"}, 66, "make build first"),
])
def test_script_refuses_what_it_does_not_understand(tmp_path, arguments, settings, status, text):
    environment = {**os.environ, "PHRI_BUILD": str(tmp_path), "PHRI_BENCH_VENV": str(tmp_path / "venv"), **settings}
    done = subprocess.run([ROOT / "scripts" / "bench.sh", *arguments], capture_output=True, text=True, env=environment)
    assert done.returncode == status and text in done.stderr
    assert not (tmp_path / "venv").exists()


@pytest.mark.skipif(not (BUILT / "bench_pipeline").is_file(), reason="the benchmarks are not built: make bench does")
def test_real_programs_and_the_peer_that_needs_nothing(tmp_path):
    """Our programs check themselves when they start; numpy's Riccati recursion, in the system's Python, is an
    independent oracle for the first gains. The peers that this Python has not are missing, and say so."""
    output = tmp_path / "bench.json"
    done = subprocess.run([sys.executable, BENCH / "bench.py", "--programs", BUILT, "--quick", "--peers",
                           "/usr/bin/python3", "--output", output], capture_output=True, text=True)
    result = json.loads(output.read_text())
    assert {row["name"] for row in result["rows"]} == {spec.name for spec in rows.ROWS}, done.stderr
    for row in result["rows"]:
        assert set(row) == KEYS and row["ours"] > 0 and row["runs"] == 1
        if row["peer"] and row["peer"].startswith("numpy"):
            assert row["check"] <= rows.SAME and row["ratio"] > 0 and row["reason"] is None
    assert sum(str(row["peer"]).startswith("numpy") for row in result["rows"]) == 3


@pytest.mark.skipif(not (BUILT / "bench_pipeline").is_file(), reason="the benchmarks are not built: make bench does")
def test_a_wrong_gain_of_ours_would_be_seen(tmp_path):
    """The oracle can fail: with one weight of the real problem changed, its gain is another one."""
    import peer_numpy

    case = tmp_path / "case.json"
    subprocess.run([BUILT / "bench_pipeline", f"--write_case={case}"], check=True)
    problem = json.loads(case.read_text())["lq"]["mahalanobis"]
    same = peer_module.difference(peer_numpy.Riccati(problem).solve()[0], problem["gain"])
    problem["Q"][100][0][0] *= 1.001
    changed = peer_module.difference(peer_numpy.Riccati(problem).solve()[0], problem["gain"])
    assert same <= rows.SAME < changed
