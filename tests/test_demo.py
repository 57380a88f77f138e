"""scripts/demo.sh says that the demo worked only when the session, by its status file, and the report both did:
roslaunch returns 0 whatever happens. Here roslaunch and phri-analysis are fakes."""

import os
import pathlib
import shutil
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
FAKE_ROSLAUNCH = """#!/bin/bash
echo "roslaunch $*"
for argument; do case $argument in bag_dir:=*) out=${argument#*:=} ;; esac; done
%s
"""
FAKE_ANALYSIS = """#!/bin/bash
[ "$1" = report ] || exit 2
%s
"""
SESSION_DONE = 'echo 0 all trials ran >"$out/session.status"'
REPORT_DONE = 'echo a,b >"$2/table.csv"; echo "<html>" >"$2/report.html"'


@pytest.fixture
def demo(tmp_path):
    """Runs the demo script in a checkout of its own with what the fakes do."""
    (tmp_path / "scripts").mkdir()
    for name in ("demo.sh", "env.sh"):
        shutil.copy(ROOT / "scripts" / name, tmp_path / "scripts")
    programs = tmp_path / "analysis" / "bin"  # env.sh puts this first on PATH
    programs.mkdir(parents=True)

    def run(session=SESSION_DONE, report=REPORT_DONE, **environment):
        for name, text in (("roslaunch", FAKE_ROSLAUNCH % session), ("phri-analysis", FAKE_ANALYSIS % report)):
            (programs / name).write_text(text)
            (programs / name).chmod(0o755)
        return subprocess.run([tmp_path / "scripts" / "demo.sh"], env={**os.environ, "DISPLAY": "", **environment},
                              capture_output=True, text=True)

    run.results = tmp_path / "results" / "demo"
    return run


def test_success_names_the_report(demo):
    done = demo()
    assert done.returncode == 0, done.stderr
    folder, = demo.results.iterdir()
    assert done.stdout.splitlines()[-1] == f"demo: report  {folder}/report.html"
    launch = next(line for line in done.stdout.splitlines() if line.startswith("roslaunch"))
    assert launch.partition("phri_sim ")[2].split() == [
        "session.launch", "experiment:=maze_assistance_demo", f"bag_dir:={folder}", "record:=true", "rviz:=false",
        "pace:=0"]


def test_a_dead_display_is_no_display(demo):
    assert "rviz:=false" in demo(DISPLAY=":4711").stdout


@pytest.mark.parametrize("session, report, status, message", [
    ("exit 0", REPORT_DONE, 1, "no session.status"),
    ('echo 70 learner died >"$out/session.status"', REPORT_DONE, 70, "exit status 70: learner died"),
    ('echo done >"$out/session.status"', REPORT_DONE, 1, "holds 'done', expected an exit status"),
    (SESSION_DONE + "; exit 5", REPORT_DONE, 5, "roslaunch ended with exit status 5"),
    (SESSION_DONE, REPORT_DONE + "; exit 1", 1, "the report could not be made"),
    (SESSION_DONE, 'echo a,b >"$2/table.csv"', 1, "left no report.html"),
])
def test_each_failure_fails_the_demo(demo, session, report, status, message):
    done = demo(session, report)
    assert done.returncode == status
    assert message in done.stderr and "what it left is in" in done.stderr


def test_an_experiment_that_hangs_is_stopped(demo):
    done = demo("exec sleep 60", DEMO_LIMIT="0.5")
    assert done.returncode == 1 and "stopped after 0.5 s" in done.stderr
