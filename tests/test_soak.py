"""make soak: what the script makes of programs that pass, fail and crash, its refusals, and, where the tests are built,
a few of the real problems."""

import os
import pathlib
import re
import subprocess
import xml.etree.ElementTree as ET

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCRIPT = ROOT / "scripts" / "soak.sh"
DEVEL = pathlib.Path(os.environ.get("PHRI_DEVEL", ROOT / "catkin_ws" / "devel"))
BUILT = sorted(DEVEL.glob("lib/phri_control/*_test_soak_*"))
CASES = {"SoakRisk.randomProblemsEndFiniteOrTyped", "SoakCumulants.randomProblemsEndFiniteOrTyped",
         "SoakIterative.randomNonlinearProblems", "SoakIterative.randomScenes", "SoakIterative.randomControlLoops"}
# a program as the gtest ones behave: told its part and the results file
PROGRAM = """#!/bin/bash
for argument; do case $argument in --gtest_output=xml:*) echo '<testsuites/>' >"${argument#*xml:}" ;; esac; done
echo "$PHRI_SOAK $PHRI_SOAK_PART $PHRI_SOAK_SEED $*" >>"$(dirname "$0")/calls"
%s
"""


def run(tmp_path, *arguments, devel=None, **settings):
    """(exit status, lines of standard output, standard error)"""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PHRI_SOAK")}
    environment |= {"PHRI_DEVEL": str(devel or tmp_path / "devel"), "PHRI_SOAK_RESULTS": str(tmp_path / "results"),
                    "PHRI_SOAK_JOBS": "2", **settings}
    done = subprocess.run([SCRIPT, *arguments], capture_output=True, text=True, env=environment)
    return done.returncode, done.stdout.splitlines(), done.stderr


def program(tmp_path, name, body):
    path = tmp_path / "devel" / "lib" / "phri_control" / f"phri_control_test_soak_{name}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PROGRAM % body)
    path.chmod(0o755)
    return path.parent / "calls"


def test_parts_are_added_up(tmp_path):
    calls = program(tmp_path, "a", "echo '[soak] SoakA.x: 30 problems, 0 failed, 1.5 s: policy 20, hessian 10'")
    program(tmp_path, "b", "echo '[soak] SoakB.y: 4 problems, 0 failed, 0.1 s'")
    status, lines, errors = run(tmp_path)
    assert status == 0, errors
    assert lines[-1] == "68 problems, 0 failed"
    assert "SoakA.x: 60 problems, 0 failed, 3.0 s" in lines and "SoakB.y: 8 problems, 0 failed, 0.2 s" in lines
    counts = [line.split() for line in lines]
    assert ["hessian", "20"] in counts and ["policy", "40"] in counts
    asked = calls.read_text().splitlines()
    assert sorted(line.split()[1] for line in asked) == ["1/2", "1/2", "2/2", "2/2"]
    assert all(line.startswith("100 ") and "--gtest_filter=Soak*" in line for line in asked)
    assert len(list((tmp_path / "results").glob("*.xml"))) == 4


def test_failed_problem_is_counted_and_shown(tmp_path):
    program(tmp_path, "a", """
[ "$PHRI_SOAK_PART" = 1/2 ] || { echo '[soak] SoakA.x: 5 problems, 0 failed, 1.0 s'; exit 0; }
echo 'test_soak_a.cpp:5: Failure'; echo 'problem 17; alone: PHRI_SOAK_SEED=17'
echo '[soak] SoakA.x: 5 problems, 2 failed, 1.0 s: policy 5'; exit 1""")
    status, lines, errors = run(tmp_path)
    assert status == 70 and lines[-1] == "10 problems, 2 failed" and "PHRI_SOAK_SEED=17" in errors


@pytest.mark.parametrize("end, text", [("kill -SEGV $$", "ended with status 139"), ("exit 1", "failed as a whole")])
def test_program_that_counts_no_failure_fails_nevertheless(tmp_path, end, text):
    program(tmp_path, "a", f"echo '[soak] SoakA.x: 5 problems, 0 failed, 1.0 s: policy 5'; {end}")
    status, _, errors = run(tmp_path)
    assert status == 70 and text in errors


def test_one_problem_is_run_once(tmp_path):
    calls = program(tmp_path, "a", "echo '[soak] SoakA.x: 1 problems, 0 failed, 0.0 s: policy 1'")
    status, lines, _ = run(tmp_path, PHRI_SOAK_SEED="4711", PHRI_SOAK_FILTER="SoakA.x")
    assert status == 0 and lines[-1] == "1 problems, 0 failed"
    assert calls.read_text().startswith("100 1/1 4711 ") and "--gtest_filter=SoakA.x" in calls.read_text()


@pytest.mark.parametrize("settings, text", [
    ({"PHRI_SOAK": "many"}, "PHRI_SOAK=many, expected a number from 0.001"),
    ({"PHRI_SOAK": "0"}, "PHRI_SOAK=0, expected"),
    ({"PHRI_SOAK": "-1"}, "PHRI_SOAK=-1, expected"),
    ({"PHRI_SOAK": "1e6"}, "PHRI_SOAK=1e6, expected"),
    ({"PHRI_SOAK_SEED": "x"}, "PHRI_SOAK_SEED=x, expected"),
    ({"PHRI_SOAK_SEED": ""}, "PHRI_SOAK_SEED=, expected"),
    ({"PHRI_SOAK_JOBS": "0"}, "PHRI_SOAK_JOBS=0, expected"),
])
def test_bad_settings_are_refused(tmp_path, settings, text):
    calls = program(tmp_path, "a", "true")
    status, lines, errors = run(tmp_path, **settings)
    assert status == 64 and text in errors and not lines and not calls.exists()


def test_nothing_to_run_is_an_error(tmp_path):
    status, _, errors = run(tmp_path)
    assert status == 66 and "make build first" in errors
    program(tmp_path, "a", "true")
    status, lines, errors = run(tmp_path, PHRI_SOAK_FILTER="Nothing*")
    assert status == 64 and "PHRI_SOAK_FILTER" in errors and lines[-1] == "0 problems, 0 failed"
    assert run(tmp_path, "fast")[0] == 64


@pytest.mark.skipif(not BUILT, reason="the tests are not built: make build does")
def test_a_few_of_the_real_problems(tmp_path):
    status, lines, errors = run(tmp_path, devel=DEVEL, PHRI_SOAK="0.002")
    assert status == 0, errors
    found = [re.match(r"(\S+): (\d+) problems, 0 failed", line) for line in lines]
    counts = {match[1]: int(match[2]) for match in found if match}
    assert CASES <= set(counts)
    # ceil(0.002 * base), whatever the number of programs that share them
    assert counts["SoakRisk.randomProblemsEndFiniteOrTyped"] == 20
    assert counts["SoakIterative.randomNonlinearProblems"] == 2
    assert lines[-1] == f"{sum(counts.values())} problems, 0 failed"
    names = [f"{case.get('classname')}.{case.get('name')}" for path in (tmp_path / "results").glob("*.xml")
             for case in ET.parse(path).iter("testcase")]
    assert CASES <= set(names)


@pytest.mark.skipif(not BUILT, reason="the tests are not built: make build does")
@pytest.mark.parametrize("name, value", [
    ("PHRI_SOAK", "ten"), ("PHRI_SOAK", "0"), ("PHRI_SOAK_PART", "3/2"), ("PHRI_SOAK_PART", "1/2x"),
    ("PHRI_SOAK_SEED", "-1"), ("PHRI_SOAK_SEED", "99999999999999999999"),
])
def test_programs_themselves_refuse_bad_settings(name, value):
    done = subprocess.run([BUILT[0], "--gtest_filter=Soak*"], capture_output=True, text=True,
                          env={**os.environ, name: value})
    assert done.returncode == 1 and f"{name}={value}, expected" in done.stdout


@pytest.mark.skipif(not BUILT, reason="the tests are not built: make build does")
def test_a_problem_depends_on_its_number_alone(tmp_path):
    """Three problems one by one end as the three together."""
    def kinds(**settings):
        status, lines, errors = run(tmp_path, devel=DEVEL, PHRI_SOAK_FILTER="SoakRisk.*", **settings)
        assert status == 0, errors
        return {line.split()[0]: int(line.split()[1]) for line in lines if line.startswith("    ")}

    together = kinds(PHRI_SOAK="0.0012")  # ceil(12)
    single = [kinds(PHRI_SOAK_SEED=str(number)) for number in range(12)]
    assert together == {kind: sum(one.get(kind, 0) for one in single) for kind in together}
    assert sum(together.values()) >= 12
