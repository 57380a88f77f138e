#!/usr/bin/python3
"""Runs the benchmarks and their peers in interleaved rounds; writes results/bench.json and prints it as a table.

A round runs our programs once, then every peer once; a row's ratio is the median over the rounds of that round's
ratio, so what slows the machine down for a while slows both. Usually started by scripts/bench.sh, which builds our
programs and installs the peers.

Exit status: 0 all rows are complete, 70 a peer is missing, broken or found another result (its row says why), 64 usage,
66 our programs are not built.
"""

import argparse
import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading

from rows import ROWS, beside, complete, missed, scaling, table, write_docs

HERE = pathlib.Path(__file__).resolve().parent
PEERS = ("numpy", "crocoddyl", "crocoddyl_cpp", "hmmlearn", "mujoco", "pybullet")
SIM_PROGRAMS = ("bench_tick", "bench_pipeline", "bench_learning")
CONTROL_PROGRAMS = ("bench_scenes", "bench_risk", "bench_cumulants", "bench_mpc")
LEARNING_PROGRAMS = ("bench_hmm", "bench_recognition")
REQUEST_LIMIT = 600  # [s] a peer that does not answer is broken; crocoddyl_cpp compiles first
PLANS = 5000  # of bench_mpc per round
LEARNING_SECONDS = 10  # of bench_learning per round, in real time
# what the rows need of the programs that measure more
FILTERS = {
    "bench_risk": "^(lq_plain/(50|200|500)|risk_force_noise/(1_source/200|2_sources/(50|500)|3_sources/200))$",
    "bench_recognition": "primitives:50/states:10$",
    "bench_cumulants": "^Cumulants/(T:50/S:2/K:2/p:4|T:(50|500)/S:2/K:4/p:4)$",
}
# one core each, and no module of the ROS workspace, which belongs to another numpy
QUIET = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class Failed(Exception):
    pass


class Peer:
    """A running peer program; `reason` says why it is of no use (any more)."""

    def __init__(self, name, arguments, case, log):
        python = arguments.peers
        self.name, self.reason, self.version, self.checks = name, "", name, {}
        self.log = log / f"{name}.log"
        self.process = None
        # scripts/bench.sh writes these
        told = pathlib.Path(python).parent.parent / "not_installed" / name.removesuffix("_cpp")
        if told.is_file():
            self.reason = told.read_text(encoding="utf-8").strip()
            return
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        environment["PHRI_BENCH_BUILD"] = str(arguments.build)
        try:
            with open(self.log, "w", encoding="utf-8") as errors:
                self.process = subprocess.Popen(
                    [python, HERE / f"peer_{name}.py", case], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=errors, text=True, env={**environment, **QUIET})
        except OSError as error:
            self.reason = str(error)
            return
        hello = self._read()
        if hello:
            self.version, self.checks = hello["version"], hello["checks"]

    def _read(self):
        """The next line of JSON; lines that are not (pybullet greets) are skipped."""
        timer = threading.Timer(REQUEST_LIMIT, self.process.kill)
        timer.start()
        try:
            for line in self.process.stdout:
                if line.startswith("{"):
                    return json.loads(line)
        except (OSError, ValueError) as error:
            self.reason = f"answered with no JSON: {error}"
            self.process.kill()  # it would wait for ever
        finally:
            timer.cancel()
        self.process.wait()
        said = self.log.read_text(encoding="utf-8").strip().splitlines()
        self.reason = self.reason or (said[-1] if said else f"ended with status {self.process.returncode}")
        return None

    def measure(self, seconds):
        if self.reason:
            return {}
        try:
            self.process.stdin.write(json.dumps({"seconds": seconds}) + "\n")
            self.process.stdin.flush()
        except OSError as error:
            self.reason = str(error)
        return self._read() or {}

    def stop(self):
        if self.process is None:
            return
        with contextlib.suppress(OSError):  # it has ended already
            self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(timeout=REQUEST_LIMIT)


def output_of(command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        raise Failed(f"{command[0]} ended with status {done.returncode}: {done.stderr.strip()[-500:]}")
    return done.stdout


def google(program, seconds):
    """The entries that a program of Google Benchmark measured."""
    command = [program, "--benchmark_format=json", f"--benchmark_min_time={seconds}"]
    if program.name in FILTERS:
        command.append(f"--benchmark_filter={FILTERS[program.name]}")
    entries = json.loads(output_of(command))["benchmarks"]
    for entry in entries:
        if entry.get("error_occurred"):
            raise Failed(f"{program.name}: {entry['name']}: {entry['error_message']}")
    return entries


def measure_ours(sim, control, learning, seconds, plans):
    """{quantity: value} of one round, in the units of the rows."""
    tick = json.loads(output_of([sim / "bench_tick", 1]))
    ours = {f"tick_{part}_{key}": tick[part][key] for part in ("step", "tick") for key in ("median", "p999")}
    for entry in google(sim / "bench_pipeline", seconds):
        ours[entry["name"]] = entry["cpu_time"]
        if entry["name"] == "trials":
            ours["trial_speed"] = entry["simulated_s"] / (1e-3 * entry["cpu_time"])
    for entry in google(control / "bench_scenes", seconds):
        ours[entry["name"]] = entry["cpu_time"]
        for part in ("step", "stage"):
            if f"{part}s" in entry:
                ours[f"{entry['name']}/{part}"] = entry["cpu_time"] / entry[f"{part}s"]
    passes = {entry["name"]: entry["cpu_time"] for program in ("bench_risk", "bench_cumulants")
              for entry in google(control / program, seconds)}
    for program in LEARNING_PROGRAMS:
        ours.update({entry["name"]: entry["cpu_time"] for entry in google(learning / program, seconds)})
    mpc = json.loads(output_of([control / "bench_mpc", plans]))
    live = json.loads(output_of([sim / "bench_learning", LEARNING_SECONDS if plans == PLANS else 3]))
    return {**ours, **scaling(passes), **{f"mpc_{key}": value for key, value in mpc.items()}, **beside(live)}


def machine():
    def first(path, key, default="unknown"):
        lines = pathlib.Path(path).read_text(encoding="utf-8").splitlines()
        return next((line.split(":", 1)[1].strip() for line in lines if line.startswith(key)), default)

    uname = os.uname()
    return {
        "processor": first("/proc/cpuinfo", "model name"),
        "cores": os.cpu_count(),
        "memory": first("/proc/meminfo", "MemTotal"),
        "kernel": f"{uname.sysname} {uname.release}",
        "compiler": output_of(["c++", "--version"]).splitlines()[0],
        "load_before": round(os.getloadavg()[0], 2),
        "revision": os.environ.get("PHRI_GIT_REVISION", "unknown"),
    }


def run(arguments):
    sim, control, learning = (arguments.build / package / "bench"
                              for package in ("phri_sim", "phri_control", "phri_learning"))
    for program in (*(sim / name for name in SIM_PROGRAMS), *(control / name for name in CONTROL_PROGRAMS),
                    *(learning / name for name in LEARNING_PROGRAMS)):
        if not program.is_file():
            print(f"bench: {program} is not there: scripts/bench.sh builds it", file=sys.stderr)
            return 66
    about = machine()
    rounds, seconds, plans = (1, 0.001, 200) if arguments.quick else (arguments.rounds, arguments.seconds, PLANS)
    ours, peers, measured = [], [], {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            if arguments.peers:
                case = pathlib.Path(folder) / "case.json"
                output_of([sim / "bench_pipeline", f"--write_case={case}"])
                output_of([control / "bench_scenes", f"--write_case={case.with_name('scenes.json')}"])
                output_of([learning / "bench_hmm", f"--write_case={case.with_name('hmm.json')}"])
                peers = [Peer(name, arguments, case, pathlib.Path(folder)) for name in PEERS]
            for number in range(rounds):
                print(f"\rbench: round {number + 1} of {rounds}", end="", file=sys.stderr, flush=True)
                ours.append(measure_ours(sim, control, learning, seconds, plans))
                for peer in peers:
                    measured.setdefault(peer.name, []).append(peer.measure(seconds))
        finally:
            print(file=sys.stderr)
            for peer in peers:
                peer.stop()
    rows = [row for spec in ROWS for row in complete(spec, ours, {peer.name: peer for peer in peers}, measured)]
    result = {
        "machine": about,
        "rounds": rounds,
        "seconds": seconds,
        "peers": {peer.name: peer.version for peer in peers},
        "rows": rows,
    }
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(table(rows))
    for line in missed(rows):
        print(line)
    print(f"\n{arguments.output}")
    if arguments.docs:
        write_docs(arguments.docs, result)
    return 70 if any(row["reason"] for row in rows) else 0


def main():
    parser = argparse.ArgumentParser(description="Our programs and their peers in interleaved rounds.")
    parser.add_argument("--build", type=pathlib.Path, required=True, help="build space of the workspace")
    parser.add_argument("--peers", help="Python interpreter that has the peers; without: no peers")
    parser.add_argument("--output", type=pathlib.Path, required=True, help="bench.json")
    parser.add_argument("--docs", type=pathlib.Path, help="page whose table is rewritten")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=0.1, help="at least, per round and quantity")
    parser.add_argument("--quick", action="store_true", help="one short round: numbers mean nothing")
    arguments = parser.parse_args()
    if not 1 <= arguments.rounds <= 1000:
        parser.error(f"--rounds {arguments.rounds}: expected 1 to 1000")
    if not 0.0 < arguments.seconds <= 60.0:
        parser.error(f"--seconds {arguments.seconds}: expected more than 0, at most 60")
    if arguments.quick and arguments.docs:
        parser.error("--quick --docs: one short round is nothing to publish")
    try:
        return run(arguments)
    except Failed as error:
        print(f"bench: {error}", file=sys.stderr)
        return 70


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SystemExit as end:
        sys.exit(64 if end.code == 2 else end.code)
