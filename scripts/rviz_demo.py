#!/usr/bin/python3
"""A person at the demo, played by a script without a display: the real nodes, the real rviz, mouse and marker.

Starts Xvfb, experiment.launch with human:=marker, and rviz with the panel inside a driver that operates it by Qt test
events. Drags the marker through the maze twice by the feedback messages that rviz would send; in the second trial it
switches the controller, tunes it, stops and starts; rates both. Leaves pictures of the window, the bags and
session.yaml in FOLDER.

usage: rviz_demo.py FOLDER        (scripts/env.sh sourced)
Exit codes: 0 done, 70 a step failed (named).
"""

import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import phri_sim
import rospy
from roslib.packages import find_node, find_resource, get_pkg_dir

EXPERIMENT = "maze_assistance"
SPEED = 0.08  # [m/s] of the marker
PATIENCE = 90.0  # [s] for anything to happen; a busy machine with software rendering is slow
SIZE = "1400x900x24"


class Failed(Exception):
    """A step that did not succeed."""


class Display:
    """Xvfb on a display of its own."""

    def __init__(self, log):
        read, write = os.pipe()
        self.process = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", SIZE, "+extension", "GLX"],
                                        pass_fds=(write,), stdout=log, stderr=log)
        os.close(write)
        with os.fdopen(read) as answer:
            self.name = ":" + answer.readline().strip()


class Rviz:
    """rviz with the demo's configuration; `do` one step of the driver (driver_steps.hpp)."""

    def __init__(self, log):
        config = find_resource("phri_rviz", "demo.rviz")[0]
        self.process = subprocess.Popen([find_node("phri_rviz", "phri_rviz_driver")[0], config, "-"], text=True,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, bufsize=1)

    def do(self, *words):
        step = " ".join(f'"{word}"' if " " in str(word) else str(word) for word in words)
        self.process.stdin.write(step + "\n")
        self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith("driver: ok"):
                return line[len("driver: ok"):].strip()
            if line.startswith("driver: error"):
                raise Failed(line.strip())
        raise Failed(f"rviz ended at the step {step}")

    def wait(self, widget, text):
        self.do("wait", widget, text, PATIENCE)


class Person:
    """Whose hand is on the marker: along the way to the goal, then lets go."""

    def __init__(self):
        sys.path.insert(0, str(pathlib.Path(get_pkg_dir("phri_sim")) / "nodes"))
        import drag_marker
        self.drag_marker, self.drag = drag_marker, drag_marker.Drag("/phri")
        self.route = phri_sim.Experiment(EXPERIMENT).route()
        self.thread = None

    def go(self):
        self.thread = threading.Thread(target=self.drag_marker.drag_along, args=(self.route,), daemon=True,
                                       kwargs={"speed": SPEED, "timeout": PATIENCE, "drag": self.drag})
        self.thread.start()

    def half_way(self):
        """Waits until the object is in the narrow channel."""
        end = time.monotonic() + PATIENCE
        while self.drag.object() is None or self.drag.object()[0] > -0.05:
            if time.monotonic() > end:
                raise Failed(f"the object did not get to the channel within {PATIENCE:.0f} s")
            time.sleep(0.05)


def play(rviz, folder):
    rospy.init_node("rviz_demo", anonymous=True, disable_signals=True)
    person = Person()
    rviz.wait("messageLabel", "drag the handle to start")
    rviz.do("pause", 2)  # for the first pictures to be drawn
    rviz.do("screenshot", folder / "waiting.png")

    person.go()
    person.half_way()
    rviz.do("screenshot", folder / "dragging.png")
    person.thread.join(PATIENCE)
    rviz.wait("ratingLabel", "Trial 1")
    rviz.do("rate", 3)
    rviz.wait("ratingLabel", "rated 3")

    rviz.wait("messageLabel", "drag the handle to start")
    person.go()
    rviz.wait("stateLabel", "ACTIVE")
    rviz.do("choose", "controllerBox", "pd")
    rviz.wait("loopLabel", "pd")
    rviz.do("set", "tuning/pd/stiffness", "400")
    rviz.do("click", "stopButton")
    rviz.wait("stateLabel", "IDLE")
    rviz.do("click", "startButton")
    rviz.wait("stateLabel", "ACTIVE")
    person.half_way()
    rviz.do("screenshot", folder / "assisted.png")
    person.thread.join(PATIENCE)
    rviz.wait("ratingLabel", "Trial 2")
    rviz.do("screenshot", folder / "rating.png")
    rviz.do("rate", 5)


def free_port():
    import socket
    with socket.socket() as found:
        found.bind(("localhost", 0))
        return found.getsockname()[1]


def run(folder):
    folder.mkdir(parents=True, exist_ok=True)
    port = free_port()
    os.environ.update(ROS_MASTER_URI=f"http://localhost:{port}", ROS_HOSTNAME="localhost",
                      ROS_LOG_DIR=str(folder / "log"), QT_QPA_PLATFORM="xcb", LIBGL_ALWAYS_SOFTWARE="1")
    with open(folder / "rviz.log", "w") as log, open(folder / "launch.log", "w") as launch_log:
        display = Display(log)
        os.environ["DISPLAY"] = display.name
        launch = subprocess.Popen(
            ["roslaunch", "--port", str(port), "phri_sim", "experiment.launch", f"experiment:={EXPERIMENT}",
             "human:=marker", "trial:=2", "controller:=mahalanobis", f"rating_wait:={PATIENCE:.0f}", "rviz:=false",
             "record:=true", f"bag_dir:={folder}", "overrides:={override: {safety: {guard: {late_cycle: 1.0}}}}"],
            stdout=launch_log, stderr=subprocess.STDOUT)
        rviz = None
        try:
            rviz = Rviz(log)
            play(rviz, folder)
            launch.wait(PATIENCE)
        finally:
            for process in (launch, rviz and rviz.process, display.process):
                if process is not None and process.poll() is None:
                    process.send_signal(signal.SIGINT if process is launch else signal.SIGTERM)
                    try:
                        process.wait(20)
                    except subprocess.TimeoutExpired:
                        process.kill()


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 64
    folder = pathlib.Path(sys.argv[1]).resolve()
    try:
        run(folder)
    except Failed as error:
        print(f"rviz_demo: {error}; see {folder}/launch.log and rviz.log", file=sys.stderr)
        return 70
    status = (folder / "session.status").read_text().strip()
    print(f"rviz_demo: session {status}; pictures in {folder}")
    return 0 if status.startswith("0 ") else 70


if __name__ == "__main__":
    sys.exit(main())
