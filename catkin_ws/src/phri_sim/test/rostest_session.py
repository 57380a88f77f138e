#!/usr/bin/python3
"""Whole sessions by session.launch; what becomes of them when a node dies, a disk is full or a parameter is wrong."""

import hashlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest

import numpy as np
import phri_sim
import rosbag
import rostest
import yaml

LIMIT = 120.0  # [s] on the wall for a session to end by itself
SEED = 5
MODEL_WAIT = 2.0  # [s] that the experiment node waits for one answer (kModelWait)
# short trials: they end by the timeout, which is as good an end as any for what is tested here
OVERRIDES = {"timeout": 12.0, "model/states": 10.0}
LAUNCH_OVERRIDES = "overrides:={timeout: 12, model: {states: 10}}"
TRIALS = 6  # so many that the kill comes in time also on a busy machine


def free_port():
    with socket.socket() as found:
        found.bind(("localhost", 0))
        return found.getsockname()[1]


class Session:
    """session.launch in a process group and a folder of its own."""

    def __init__(self, *arguments, prepare=None):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="phri_session_"))
        port = free_port()
        environment = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}", ROS_LOG_DIR=str(self.folder / "log"))
        self.output = open(self.folder / "output.txt", "w")
        self.process = subprocess.Popen(
            ["roslaunch", "--port", str(port), "phri_sim", "session.launch", f"bag_dir:={self.folder}/bags",
             f"seed:={SEED}", *arguments], env=environment, stdout=self.output, stderr=subprocess.STDOUT,
            start_new_session=True, preexec_fn=prepare)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(LIMIT)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
        self.output.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def report(self):
        try:
            return yaml.safe_load((self.folder / "bags" / "session.yaml").read_text())
        except OSError:
            return {"done": 0}

    def wait_done(self, trials):
        """Returns as soon as so many trials are done, that is, while the next one runs."""
        end = time.monotonic() + LIMIT
        while self.report()["done"] < trials and self.process.poll() is None and time.monotonic() < end:
            time.sleep(0.01)

    def kill(self, program, kind=signal.SIGKILL):
        """Sends a signal to the node whose program is named so; its pid."""
        for entry in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except OSError:
                continue
            if parent == self.process.pid and any(word.endswith(program.encode()) for word in words):
                os.kill(int(entry.name), kind)
                return int(entry.name)
        raise AssertionError(f"no node {program} among the children of {self.process.pid}:\n{self.text()}")

    def text(self):
        return (self.folder / "output.txt").read_text()

    def end(self):
        """(exit code, reason) by session.status."""
        self.process.wait(LIMIT)
        code, reason = (self.folder / "bags" / "session.status").read_text().split(" ", 1)
        return int(code), reason.strip()


class SessionTest(unittest.TestCase):
    def assert_equals_in_process(self, session, bags):
        """The trials of the recorded block are those that run without ROS, to the bit."""
        experiment = phri_sim.Experiment("maze_assistance_demo", OVERRIDES)
        plan = phri_sim.schedule(experiment, 1, TRIALS, SEED)
        tables = phri_sim.run_block(experiment, next(block for block in plan if block.controller == "mahalanobis"))
        self.assertEqual(len(bags), len(tables))
        for entry, table in zip(bags, tables):
            path = session.folder / "bags" / entry["file"]
            self.assertEqual(hashlib.sha256(path.read_bytes()).hexdigest(), entry["sha256"])
            with rosbag.Bag(str(path)) as bag:
                rows = [[*m.position, *m.velocity] for _, m, _ in bag.read_messages(topics="/phri/joint_states")]
            np.testing.assert_array_equal(np.array(rows), table[["x", "y", "vx", "vy"]].to_numpy())

    def test_killed_learner_costs_one_repetition(self):
        """Row 11 of the fault matrix. The learner comes back, reads the block's demonstrations from its store and
        learns again: since learning is deterministic, nothing of the session differs from one without the fault."""
        with Session("participants:=1", f"trials:={TRIALS}", "controller:=mahalanobis", LAUNCH_OVERRIDES) as session:
            session.wait_done(1)
            session.kill("learner_node.py")
            code, reason = session.end()
            self.assertEqual(code, 0, reason + session.text())
            report = session.report()
            self.assertEqual((report["state"], report["done"], report["repeated"]), ("complete", TRIALS, 1))
            self.assert_equals_in_process(session, report["bags"])
            complete = list((session.folder / "bags").glob("*.bag"))
            self.assertEqual(len(complete), TRIALS)
            self.assertEqual(list((session.folder / "bags").glob("*.active")), [])

    def test_stopped_clock_and_frozen_nodes_change_nothing(self):
        """Row 16. The experiment node frozen: /clock stands still, nobody hangs or takes it for the end. The learner
        frozen for longer than it may take for an answer: the trial is repeated. The numbers are as if nothing had
        been."""
        with Session("participants:=1", f"trials:={TRIALS}", "controller:=mahalanobis", LAUNCH_OVERRIDES) as session:
            session.wait_done(1)
            for program, seconds in (("experiment_node", 2.0), ("learner_node.py", MODEL_WAIT + 1.5)):
                pid = session.kill(program, signal.SIGSTOP)
                time.sleep(seconds)
                os.kill(pid, signal.SIGCONT)
            code, reason = session.end()
            self.assertEqual(code, 0, reason + session.text())
            report = session.report()
            self.assertLessEqual(report["repeated"], 1)
            self.assertIn("is connected but does not answer", session.text())
            self.assert_equals_in_process(session, report["bags"])

    def test_killed_experiment_node_ends_the_session_by_name(self):
        with Session("participants:=1", LAUNCH_OVERRIDES) as session:
            session.wait_done(1)
            session.kill("experiment_node")
            code, reason = session.end()
            self.assertEqual(code, 70)
            self.assertIn("experiment_node died during trial", reason)
            self.assertEqual(session.report()["state"], "running")

    def test_full_disk_ends_the_session(self):
        """A limit on the size of files acts on a write as a full disk does."""
        def limit_files():
            import resource
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (300000, 300000))
        with Session("participants:=1", LAUNCH_OVERRIDES, prepare=limit_files) as session:
            code, reason = session.end()
            self.assertEqual(code, 74, reason + session.text())
            self.assertIn(".bag", reason)
            self.assertEqual(list((session.folder / "bags").glob("*.bag")), [])

    def test_bad_parameters_are_named(self):
        with Session("overrides:={model: {state: 10}}", "controller:=lqr") as session:
            code, reason = session.end()
            self.assertEqual(code, 78)
            self.assertIn("did you mean model/states?", reason)

    def test_unknown_controller_is_named(self):
        with Session("controller:=lqrr") as session:
            code, reason = session.end()
            self.assertEqual(code, 78)
            self.assertIn("lqrr", reason)


if __name__ == "__main__":
    rostest.rosrun("phri_sim", "session_test", SessionTest)
