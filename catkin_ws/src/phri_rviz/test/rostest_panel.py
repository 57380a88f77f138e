#!/usr/bin/python3
"""The panel in a real rviz on a display of its own, operated by test events, against a node that reports every call.

Nothing here looks at the clock on the wall: waits end when what is waited for has happened, and have long limits. That
a service does not freeze the window is shown by a timer of the window that goes on, and by order: the answer is
withheld until the window has done other things.
"""

import json
import os
import pathlib
import queue
import re
import subprocess
import tempfile
import threading
import unittest

import rostest

HERE = pathlib.Path(__file__).resolve().parent
CONFIG = HERE.parent / "config" / "demo.rviz"
PATIENCE = 60.0  # [s] for anything to happen; a busy machine is slow, a broken panel never gets there
BRIGHTEST, DARKEST = 252, 128  # mean grey of the 3-D view: light background (250), a map, dark walls; black is 0
LEAST_COLORS = 3  # background, walls and at least one marker
FROZEN = 8  # ticks of 10 ms in the 2 s without an answer; one that stands still does 1, this one 50 or more


class Child:
    """A program with a line each way; `expect` returns the next line that fits."""

    def __init__(self, command, pick, environment=None):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                        env=environment)
        self.lines, self.log = queue.Queue(), []
        self.pick = pick
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stdout:
            self.log.append(line)
            picked = self.pick(line)
            if picked is not None:
                self.lines.put(picked)
        self.lines.put(None)

    def write(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def next(self):
        try:
            line = self.lines.get(timeout=PATIENCE)
        except queue.Empty:
            raise AssertionError(f"{self.process.args[0]} says nothing for {PATIENCE} s") from None
        if line is None:
            raise AssertionError(f"{self.process.args[0]} has ended:\n" + "".join(self.log[-40:]))
        return line

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()


class Node(Child):
    def __init__(self):
        # as a node of the launch file would be: in /phri, by this name
        super().__init__([str(HERE / "fake_experiment_node.py"), "__ns:=/phri"],
                         lambda line: json.loads(line) if line.startswith("{") else None)
        self.calls = []
        while "ready" not in self.next():
            pass

    def tell(self, **order):
        self.write(json.dumps(order))

    def wait_for(self, **event):
        """The next event with these fields; those before it are forgotten."""
        while True:
            got = self.next()
            if event.items() <= got.items():
                return got

    def events(self):
        """All that has been said so far."""
        result = []
        while not self.lines.empty():
            result.append(self.next())
        return result


class Driver(Child):
    def __init__(self, program, config, environment):
        super().__init__([program, str(config), "-"],
                         lambda line: line[8:].strip() if line.startswith("driver: ") else None, environment)

    def run(self, *step):
        """What the step printed. Raises when it failed."""
        self.write(" ".join(f'"{word}"' if " " in str(word) else str(word) for word in step))
        answer = self.next()
        if not answer.startswith("ok"):
            raise AssertionError(answer)
        return answer[3:]

    def wait(self, what, text):
        self.run("wait", what, text, PATIENCE * 0.8)


def start_display():
    read, write = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1400x900x24", "-nolisten", "tcp"],
                              pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as numbers:
        number = numbers.readline().strip()
    if not number:
        raise AssertionError("Xvfb does not start")
    return server, f":{number}"


def find_driver():
    for folder in os.environ["CMAKE_PREFIX_PATH"].split(":"):
        program = pathlib.Path(folder) / "lib" / "phri_rviz" / "phri_rviz_driver"
        if program.is_file():
            return str(program)
    raise AssertionError("phri_rviz_driver is not built (make the target tests)")


class PanelTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        server, display = start_display()
        cls.addClassCleanup(server.wait)
        cls.addClassCleanup(server.kill)
        os.chmod(cls.folder.name, 0o700)
        environment = dict(os.environ, DISPLAY=display, LIBGL_ALWAYS_SOFTWARE="1", QT_QPA_PLATFORM="xcb",
                           HOME=cls.folder.name, XDG_RUNTIME_DIR=cls.folder.name)
        cls.driver = Driver(find_driver(), CONFIG, environment)
        cls.addClassCleanup(cls.driver.kill)
        cls.node = Node()
        cls.addClassCleanup(lambda: cls.node.kill())

    def setUp(self):
        """Every case starts from a living node in PASSIVE that the panel has seen."""
        self.node.tell(state={"state": "PASSIVE", "controller": "lqr", "fault_name": "", "message": ""})
        self.driver.wait("stateLabel", "PASSIVE")
        self.driver.wait("controllerBox", "lqr")
        self.node.events()

    def value(self, name):
        return float(self.driver.run("read", f"tuning/{name}"))

    def test_buttons_call_their_services(self):
        for state, button, service, after in (("PASSIVE", "startButton", "start", "ACTIVE"),
                                              ("ACTIVE", "stopButton", "stop", "PASSIVE"),
                                              ("FAULT", "clearFaultButton", "clear_fault", "PASSIVE"),
                                              ("ACTIVE", "resetButton", "reset", "IDLE")):
            with self.subTest(service):
                self.node.tell(state={"state": state})
                self.driver.wait("stateLabel", state)
                self.node.events()
                self.driver.run("click", button)
                self.assertEqual(self.node.next(), {"call": service, "argument": None})
                self.driver.wait("answerLabel", f"{service} done")
                self.driver.wait("stateLabel", after)
                self.assertEqual(self.node.events(), [{"end": service}], "one call each")

    def test_fault_and_its_text_are_shown(self):
        self.node.tell(state={"state": "FAULT", "fault_name": "WRENCH_STALE", "message": "check the cable"})
        self.driver.wait("stateLabel", "FAULT")
        self.driver.wait("messageLabel", "WRENCH_STALE: check the cable")
        self.driver.wait("startButton.enabled", "false")
        self.driver.wait("clearFaultButton.enabled", "true")
        self.node.tell(state={"state": "PASSIVE", "fault_name": "", "message": "waiting for the hand"})
        self.driver.wait("messageLabel", "waiting for the hand")
        self.driver.wait("clearFaultButton.enabled", "false")

    def test_controller_is_switched_by_name(self):
        for name in ("mahalanobis", "pd"):  # of the experiment; after the separator
            self.driver.run("choose", "controllerBox", name)
            self.assertEqual(self.node.wait_for(call="switch_controller")["argument"], name)
            self.driver.wait("answerLabel", f"{name} is in force")
            self.assertEqual(self.driver.run("read", "controllerBox"), name)
        self.node.tell(state={"controller": "lqr"})  # by somebody else
        self.driver.wait("controllerBox", "lqr")

    def test_typed_value_is_set(self):
        self.driver.run("set", "tuning/pd/stiffness", "400")
        self.assertEqual(self.node.wait_for(call="set_parameters")["argument"], {"pd/stiffness": 400.0})
        self.driver.wait("answerLabel", "pd/stiffness = 400 N/m")
        self.assertEqual(self.value("pd/stiffness"), 400)

    def test_refused_value_is_shown_and_reverted(self):
        before = self.value("pd/stiffness")
        self.node.tell(limit=500)
        self.driver.run("set", "tuning/pd/stiffness", "600")
        self.assertEqual(self.node.wait_for(call="set_parameters")["argument"], {"pd/stiffness": 600.0})
        self.driver.wait("answerLabel", "pd/stiffness = 600 is unstable, at most 500")
        self.assertEqual(self.value("pd/stiffness"), before)
        self.node.tell(limit=1e14)

    def test_lowered_value_is_shown_and_reverted(self):
        self.node.tell(clamp=30)
        self.driver.run("set", "tuning/pd/damping", "35")
        self.driver.wait("answerLabel", "pd/damping = 35 refused, it stays 30 Ns/m")
        self.assertEqual(self.value("pd/damping"), 30)
        self.node.tell(clamp=1e14)

    def test_impossible_values_are_not_sent(self):
        before = self.value("pd/stiffness")
        for text, problem in (("-1", "-1 is outside 0 to 1e+14 N/m"), ("nan", "nan is outside"), ("1e15", "1e15 is"),
                              ("a lot", "'a lot' is not a number")):
            self.driver.run("set", "tuning/pd/stiffness", text)
            self.driver.wait("answerLabel", problem)
            self.assertEqual(self.value("pd/stiffness"), before, text)
        self.assertEqual(self.node.events(), [])

    def test_slider_sends_its_last_value(self):
        self.driver.run("set", "tuning/pd/stiffness", "200")  # in the middle of the slider
        self.driver.wait("answerLabel", "pd/stiffness = 200 N/m")
        self.node.events()
        self.driver.run("drag", "tuning/pd/stiffness/slider", "0.6", "0.8")
        shown = self.value("pd/stiffness")
        sent = []
        while not sent or sent[-1] != shown:  # a missing last value ends in the patience of `next`
            event = self.node.wait_for(call="set_parameters")
            sent.append(event["argument"]["pd/stiffness"])
        self.driver.wait("answerLabel", "pd/stiffness = ")
        self.assertEqual(sent, sorted(sent), "pulled to one side only")
        self.assertLess(len(sent), 30, "not one request for each move of the mouse")
        self.assertEqual(self.value("pd/stiffness"), shown)
        self.assertEqual([event for event in self.node.events() if "call" in event], [], "nothing after the last")

    def test_rating_after_a_finished_trial_only(self):
        for phase, enabled in ((0, "false"), (1, "true"), (2, "false"), (1, "true")):
            self.node.tell(trial={"phase": phase, "trial": 3 + phase})
            self.driver.wait("ratingLabel", f"Trial {3 + phase}")
            for number in range(1, 7):
                self.assertEqual(self.driver.run("read", f"ratingButton{number}.enabled"), enabled, phase)
        self.driver.run("rate", "5")
        self.assertEqual(self.node.wait_for(call="rate")["argument"], 5)
        self.driver.wait("ratingLabel", "stored: 5 (participant 0, trial 3)")
        self.assertEqual(self.driver.run("read", "ratingButton5.checked"), "true")
        self.node.tell(trial={"phase": 0, "trial": 6})
        self.driver.wait("ratingButton5.enabled", "false")

    def test_blocked_service_does_not_freeze_the_window(self):
        self.node.tell(block="reset")
        self.driver.run("ticks")
        self.driver.run("click", "resetButton")
        self.driver.wait("answerLabel", "/phri/experiment_node/reset: no answer within 2 s")
        self.assertGreater(int(self.driver.run("ticks")), FROZEN)
        self.driver.run("click", "startButton")  # another service, while this one is still busy
        self.node.wait_for(call="start")
        self.driver.wait("stateLabel", "ACTIVE")
        self.assertNotIn({"end": "reset"}, self.node.events(), "all of this happened before the answer")
        self.node.tell(release="reset")
        self.node.wait_for(end="reset")

    def test_dead_node_is_said_to_be_gone_and_comes_back(self):
        self.node.kill()
        self.driver.wait("messageLabel", "is /phri/experiment_node running?")
        self.assertRegex(self.driver.run("read", "messageLabel"), r"^no state for \d+\.\d s: ")
        self.assertEqual(self.driver.run("read", "startButton.enabled"), "false")
        self.driver.run("click", "stopButton")  # stop is never refused by the panel itself
        self.driver.wait("answerLabel", "is its node running?")
        type(self).node = Node()
        self.driver.wait("stateLabel", "PASSIVE")
        self.node.wait_for(call="list_controllers")
        self.driver.run("click", "startButton")
        self.node.wait_for(call="start")
        self.driver.wait("stateLabel", "ACTIVE")
        self.driver.wait("tuning/pd/stiffness", "200")  # of the new node

    def test_namespace_is_a_property_of_the_configuration(self):
        saved = pathlib.Path(self.folder.name) / "saved.rviz"
        self.driver.run("set", "namespaceEdit", "no/slash")
        self.driver.wait("answerLabel", "namespace 'no/slash': must begin with /")
        self.assertEqual(self.driver.run("read", "namespaceEdit"), "/phri")
        self.driver.run("set", "namespaceEdit", "/other")
        self.driver.wait("messageLabel", "is /other/experiment_node running?")
        self.driver.run("save", saved)
        self.assertRegex(saved.read_text(), r"Namespace: /other\n")
        self.driver.run("set", "namespaceEdit", "/phri")
        self.driver.wait("stateLabel", "PASSIVE")
        self.driver.wait("tuning/pd/stiffness/unit", "N/m")

    def test_picture_shows_the_scene(self):
        picture = pathlib.Path(self.folder.name) / "window.png"

        def look():
            return [float(number) for number in self.driver.run("screenshot", picture).split()]

        width, height, brightness, colors = look()
        for _ in range(20):  # map and markers may still be on their way
            if colors >= LEAST_COLORS:
                break
            self.driver.run("pause", "0.5")
            width, height, brightness, colors = look()
        self.assertGreaterEqual(colors, LEAST_COLORS)
        self.assertGreater(brightness, DARKEST)
        self.assertLess(brightness, BRIGHTEST)
        self.assertGreater(min(width, height), 600)
        self.assertTrue(picture.read_bytes().startswith(b"\x89PNG"))

    def test_unknown_steps_and_widgets_are_named(self):
        for step, reason in ((("click", "noSuchButton"), "step [0-9]+ 'click noSuchButton': no widget is named"),
                             (("jump", "high"), "no step is named 'jump'"),
                             (("click",), "click takes 1 arguments, not 0")):
            with self.assertRaises(AssertionError) as caught:
                self.driver.run(*step)
            self.assertTrue(re.search(reason, str(caught.exception)), caught.exception)


if __name__ == "__main__":
    rostest.rosrun("phri_rviz", "panel_test", PanelTest)
