#!/usr/bin/python3
"""Run every test of the repository, several at once, and print `N passed, N failed` (test cases) as the last line.

What is found:
  gtest    catkin_ws/src/<package>/test/test_<x>.cpp, run as <devel>/lib/<package>/<package>_test_<x> (the macro
           phri_tests makes it); a source without a program is a failure, not silence
  rostest  catkin_ws/src/<package>/test/*.test, each with its own master, ROS_HOME and log folder
  pytest   analysis/tests, tests, and per package the test/test_*.py that no .test file starts

results/tests/<job>/ holds each job's output.txt and JUnit files. A job that exits non-zero without a failed case, runs
no case, or takes longer than --limit is a failure. Source scripts/env.sh first (make test does).
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

ROOT = pathlib.Path(__file__).resolve().parent.parent
SOURCES = ROOT / "catkin_ws" / "src"
RESULTS = ROOT / "results" / "tests"
GUESS = {"rostest": 20.0, "pytest": 10.0, "gtest": 1.0}  # [s], for jobs that have not run before
MARK = "PHRI_TEST_JOB"  # environment variable that tells a job's processes, also those that left its process group
GRACE = 40.0  # [s] roslaunch takes up to about 20 s to stop its nodes after an interrupt
SHOWN = 8000  # characters of a failed job's output


@dataclass
class Job:
    kind: str
    name: str
    command: list
    folder: pathlib.Path = None

    def __post_init__(self):
        self.folder = RESULTS / re.sub(r"[^\w.-]+", "__", f"{self.kind}/{self.name}")


@dataclass
class Outcome:
    job: Job
    passed: int = 0
    skipped: int = 0
    failed: list = field(default_factory=list)
    seconds: float = 0.0
    output: str = ""


def find_jobs(devel):
    for source in sorted(SOURCES.glob("*/test/test_*.cpp")):
        package = source.parent.parent.name
        program = devel / "lib" / package / f"{package}_{source.stem}"
        yield Job("gtest", f"{package}/{source.stem}", [str(program)])
    started = set()
    for launch in sorted(SOURCES.glob("*/test/*.test")):
        package = launch.parent.parent.name
        started |= {launch.parent / node.get("type") for node in ET.parse(launch).iter("test")}
        yield Job("rostest", f"{package}/{launch.name}", ["rostest", "--package", package, str(launch)])
    for folder in [*sorted(SOURCES.glob("*/test")), ROOT / "analysis" / "tests", ROOT / "tests"]:
        files = [str(path) for path in sorted(folder.glob("test_*.py")) if path not in started]
        if files:
            yield Job("pytest", str(folder.relative_to(ROOT)), [sys.executable, "-m", "pytest", "-q", *files])


def result_arguments(job):
    """The arguments that make a job write JUnit files into its folder."""
    if job.kind == "gtest":
        return ["--gtest_color=no", f"--gtest_output=xml:{job.folder}/result.xml"]
    if job.kind == "rostest":
        return [f"--results-base-dir={job.folder}", f"--results-filename={pathlib.Path(job.name).stem}.xml"]
    return ["--color=no", f"--junitxml={job.folder}/result.xml"]


def read_cases(outcome):
    """Counts the leaf cases of the job's JUnit files; rostest's wrapper file (rostest-*) only repeats its tests."""
    for path in sorted(outcome.job.folder.rglob("*.xml")):
        if path.name.startswith("rostest-"):
            continue
        try:
            tree = ET.parse(path)
        except ET.ParseError as error:
            outcome.failed.append(f"{outcome.job.name}: unreadable result file {path.name}: {error}")
            continue
        for case in tree.iter("testcase"):
            if case.find("failure") is not None or case.find("error") is not None:
                outcome.failed.append(f"{outcome.job.name}: {case.get('classname', '')}.{case.get('name', '')}")
            elif case.find("skipped") is not None or case.get("status") == "notrun":
                outcome.skipped += 1
            else:
                outcome.passed += 1


def write_problem(job, text):
    """The runner's own finding as a JUnit file, so that readers of results/tests see it too."""
    suite = ET.Element("testsuite", name=job.name, tests="1", failures="0", errors="1")
    case = ET.SubElement(suite, "testcase", classname=job.kind, name=job.name)
    ET.SubElement(case, "error", message=text)
    ET.ElementTree(suite).write(job.folder / "runner.xml", encoding="utf-8", xml_declaration=True)


def stop_leftovers(job):
    """Kills what a job left running (a node survives the launcher that was killed), told by its environment."""
    mark = f"{MARK}={job.folder}\0".encode()
    for entry in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            if mark in (entry / "environ").read_bytes() + b"\0":
                os.kill(int(entry.name), signal.SIGKILL)
        except OSError:  # gone already, or another user's
            pass


def run_command(job, limit):
    """(exit status, or None when it was stopped after `limit` seconds); its output goes to output.txt: to a file,
    since a node that outlives its launcher would hold a pipe open."""
    environment = dict(os.environ, ROS_HOME=str(job.folder / "ros_home"), ROS_LOG_DIR=str(job.folder / "ros_log"),
                       HYPOTHESIS_STORAGE_DIRECTORY=str(job.folder / "hypothesis"), **{MARK: str(job.folder)})
    if os.environ.get("PHRI_PRELOAD"):  # the sanitizers' libraries, see scripts/env.sh
        environment["LD_PRELOAD"] = os.environ["PHRI_PRELOAD"]
    with open(job.folder / "output.txt", "w") as output:
        child = subprocess.Popen([*job.command, *result_arguments(job)], cwd=ROOT, env=environment, stdout=output,
                                 stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            return child.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGINT)
            try:
                child.wait(GRACE)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
            return None
        finally:
            stop_leftovers(job)


def stop_all(jobs):
    """For SIGINT and SIGTERM: the jobs are in sessions of their own, so the terminal does not reach them."""
    for job in jobs:
        stop_leftovers(job)
    os._exit(130)


def run(job, limit):
    shutil.rmtree(job.folder, ignore_errors=True)
    job.folder.mkdir(parents=True)
    outcome = Outcome(job)
    start = time.monotonic()
    problem = None
    try:
        status = run_command(job, limit)
        read_cases(outcome)
        if status is None:
            problem = f"stopped after {limit:.0f} s"
        elif status != 0 and not outcome.failed:
            problem = f"exit status {status} without a failed case"
        elif status == 0 and outcome.passed + outcome.skipped + len(outcome.failed) == 0:
            problem = "no test case ran"
        outcome.output = (job.folder / "output.txt").read_text(errors="replace")
    except OSError as error:
        problem = f"cannot be started (is it built?): {error}"
    if problem:
        outcome.failed.append(f"{job.name}: {problem}")
        write_problem(job, problem)
    outcome.seconds = time.monotonic() - start
    return outcome


def run_all(jobs, at_once, limit):
    """Outcomes of all jobs, the longest (by the last run) started first, so that the end is not one long job alone."""
    record = RESULTS / "seconds.json"
    try:
        seconds = json.loads(record.read_text())
    except (OSError, ValueError):
        seconds = {}
    jobs.sort(key=lambda job: -seconds.get(job.folder.name, GUESS[job.kind]))
    outcomes = []
    with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
        for future in concurrent.futures.as_completed([pool.submit(run, job, limit) for job in jobs]):
            outcome = future.result()
            outcomes.append(outcome)
            seconds[outcome.job.folder.name] = round(outcome.seconds, 1)
            print(f"{'FAIL' if outcome.failed else 'ok':4} {outcome.job.kind:7} {outcome.job.name:45} "
                  f"{outcome.passed:4} passed {len(outcome.failed):2} failed {outcome.seconds:6.1f} s", flush=True)
            if outcome.failed:
                print(outcome.output[-SHOWN:], flush=True)
    RESULTS.mkdir(parents=True, exist_ok=True)
    record.write_text(json.dumps(seconds, indent=1, sort_keys=True))
    return outcomes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-j", type=int, default=min(2, os.cpu_count() or 1), help="jobs at once (default: 2)")
    parser.add_argument("-k", default="", help="only the jobs whose `kind name` holds this text")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds that a job may take (default: 600)")
    parser.add_argument("--list", action="store_true", help="print the jobs and stop")
    parser.add_argument("--devel", type=pathlib.Path, help="devel space (default: of the profile in scripts/env.sh)",
                        default=os.environ.get("PHRI_DEVEL", ROOT / "catkin_ws" / "devel"))
    arguments = parser.parse_args()

    jobs = [job for job in find_jobs(arguments.devel) if arguments.k in f"{job.kind} {job.name}"]
    if arguments.list:
        print(*(f"{job.kind:7} {job.name}" for job in jobs), sep="\n")
        return 0
    if not arguments.k:  # a full run leaves no result of a test that is no more
        for folder in RESULTS.glob("*__*"):
            shutil.rmtree(folder, ignore_errors=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop_all(jobs))
    outcomes = run_all(jobs, arguments.j, arguments.limit)
    passed, skipped = (sum(getattr(outcome, count) for outcome in outcomes) for count in ("passed", "skipped"))
    failed = [name for outcome in outcomes for name in outcome.failed]
    print(*(f"failed: {name}" for name in sorted(failed)), sep="\n", end="\n" if failed else "")
    if skipped:
        print(f"{skipped} skipped")
    if not outcomes:
        print(f"test: nothing matches -k '{arguments.k}'" if arguments.k else "test: no tests found")
    print(f"{passed} passed, {len(failed)} failed")
    return 0 if passed and not failed else 1


if __name__ == "__main__":
    sys.exit(main())
