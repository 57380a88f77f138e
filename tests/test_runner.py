"""scripts/test.py must not report success that did not happen: each way in which a job can fail without a failed case,
on a small fake checkout whose gtest programs are shell scripts."""

import pathlib
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
PASSED = '<testcase name="a" status="run" classname="S"/>'
FAILED = '<testcase name="b" status="run" classname="S"><failure message="1 != 2"/></testcase>'
SKIPPED = '<testcase name="c" status="run" classname="S"><skipped/></testcase>'


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "test.py", tmp_path / "scripts")
    return tmp_path


def add_program(checkout, name, cases=None, after="exit 0"):
    """A test source and its program: a script that writes `cases` (None: nothing) as JUnit, then does `after`."""
    source = checkout / "catkin_ws" / "src" / "pkg" / "test" / f"test_{name}.cpp"
    source.parent.mkdir(parents=True, exist_ok=True)
    source.write_text("")
    program = checkout / "catkin_ws" / "devel" / "lib" / "pkg" / f"pkg_test_{name}"
    program.parent.mkdir(parents=True, exist_ok=True)
    write = '' if cases is None else f"""
for argument; do case $argument in --gtest_output=xml:*) file=${{argument#*xml:}} ;; esac; done
echo '<testsuites><testsuite name="S">{cases}</testsuite></testsuites>' >"$file"
"""
    program.write_text(f"#!/bin/bash\n{write}\necho text of {name}\n{after}\n")
    program.chmod(0o755)
    return program


def run(checkout, *arguments):
    """(exit status, last line, all output)"""
    command = [sys.executable, checkout / "scripts" / "test.py", "--devel", checkout / "catkin_ws" / "devel"]
    done = subprocess.run([*command, *arguments], capture_output=True, text=True)
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()[-1], done.stdout


def read(path):
    """The content, or nothing for a process that has just ended."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


def test_counts_passed_and_skipped_cases(checkout):
    add_program(checkout, "one", PASSED + PASSED)
    add_program(checkout, "two", PASSED + SKIPPED)
    status, last, output = run(checkout)
    assert (status, last) == (0, "3 passed, 0 failed")
    assert "1 skipped" in output and "text of one" not in output


def test_failed_case_is_named_and_its_output_shown(checkout):
    add_program(checkout, "one", PASSED + FAILED, "exit 1")
    status, last, output = run(checkout)
    assert (status, last) == (1, "1 passed, 1 failed")
    assert "failed: pkg/test_one: S.b" in output and "text of one" in output


@pytest.mark.parametrize("cases, after, reason", [
    (PASSED, "exit 3", "exit status 3 without a failed case"),
    (None, "kill -KILL $$", "exit status -9 without a failed case"),
    (None, "exit 0", "no test case ran"),
    ("", "exit 0", "no test case ran"),
    ("<unfinished", "exit 0", "unreadable result file"),
])
def test_failure_without_a_failed_case(checkout, cases, after, reason):
    add_program(checkout, "good", PASSED)
    add_program(checkout, "bad", cases, after)
    status, last, output = run(checkout)
    assert status == 1 and last.endswith(" 1 failed")
    assert f"failed: pkg/test_bad: {reason}" in output


def test_source_without_program_fails(checkout):
    add_program(checkout, "good", PASSED)
    add_program(checkout, "gone", PASSED).unlink()
    status, last, output = run(checkout)
    assert (status, last) == (1, "1 passed, 1 failed")
    assert "failed: pkg/test_gone: cannot be started" in output


def test_a_job_past_its_limit_is_stopped_with_all_it_started(checkout):
    # setsid: a process that left the job's group, as the nodes of roslaunch do; it would write the file if it lived on
    late = checkout / "late"
    add_program(checkout, "slow", PASSED, f"setsid bash -c 'sleep 4; touch {late}' & sleep 60")
    status, last, output = run(checkout, "--limit", "0.5")
    assert (status, last) == (1, "1 passed, 1 failed")
    assert "stopped after" in output
    assert not any(str(late).encode() in read(path) for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"))


def test_runner_findings_are_in_the_junit_files(checkout):
    add_program(checkout, "bad", None, "exit 3")
    run(checkout)
    results = checkout / "results" / "tests" / "gtest__pkg__test_bad"
    errors = [error.get("message") for path in results.glob("*.xml") for error in ET.parse(path).iter("error")]
    assert errors == ["exit status 3 without a failed case"]
    assert (results / "output.txt").read_text() == "text of bad\n"


def test_pytest_folders_leave_out_what_a_rostest_starts(checkout):
    folder = checkout / "catkin_ws" / "src" / "pkg" / "test"
    folder.mkdir(parents=True)
    (folder / "test_plain.py").write_text("def test_it():\n    assert 1 + 1 == 2\n")
    (folder / "test_node.py").write_text("raise SystemExit('must not be imported')\n")
    (folder / "node.test").write_text('<launch><test test-name="a" pkg="pkg" type="test_node.py"/></launch>')
    (checkout / "tests").mkdir()
    (checkout / "tests" / "test_other.py").write_text("def test_it():\n    assert 1 + 1 == 3\n")
    assert run(checkout, "--list")[2].split("\n")[:-1] == [
        "rostest pkg/node.test", "pytest  catkin_ws/src/pkg/test", "pytest  tests"]
    status, last, output = run(checkout, "-k", "pytest")
    assert (status, last) == (1, "1 passed, 1 failed")
    assert "failed: tests: tests.test_other.test_it" in output


def test_nothing_found_is_no_success(checkout):
    assert run(checkout)[:2] == (1, "0 passed, 0 failed")


def test_a_full_run_forgets_tests_that_are_no_more(checkout):
    add_program(checkout, "one", PASSED)
    stale = checkout / "results" / "tests" / "gtest__pkg__test_gone"
    stale.mkdir(parents=True)
    assert run(checkout)[1] == "1 passed, 0 failed"
    assert not stale.exists()
