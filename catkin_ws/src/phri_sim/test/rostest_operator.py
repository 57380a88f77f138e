#!/usr/bin/python3
"""An operator and real hands at a running trial: what is waited for, refused, switched, tuned, faulted and cleared."""

import json
import pathlib
import shutil
import subprocess
import sys
import threading
import time
import unittest

import rosbag
import rospy
import rostest
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.msg import Config, DoubleParameter
from dynamic_reconfigure.srv import Reconfigure
from geometry_msgs.msg import WrenchStamped
from phri_msgs.msg import ControllerState
from phri_msgs.srv import ListControllers, RunTrial, RunTrialResponse, SwitchController
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "nodes"))

from drag_marker import Drag  # noqa: E402

LIMIT = 30.0  # [s] for anything that should happen soon
NEAR = 0.004  # [m] the spring pulls the object so close to a marker that stands still; friction there is none
START = (0.115, 0.12)  # [m] of the demo's maze


def service(name, kind):
    rospy.wait_for_service(name, LIMIT)
    return rospy.ServiceProxy(name, kind)


class Node:
    """An experiment node, its newest state, and one running trial."""

    def __init__(self, name, folder=""):
        self.name, self.folder, self.state, self.position = name, str(folder), None, None
        self.subscribers = [
            rospy.Subscriber(f"/{name}/experiment_node/state", ControllerState, self.on_state, queue_size=1),
            rospy.Subscriber(f"/{name}/joint_states", JointState, self.on_joints, queue_size=1)]
        run_trial = service(f"/{name}/experiment_node/run_trial", RunTrial)
        self.answer = []
        self.thread = threading.Thread(target=lambda: self.answer.append(
            run_trial(0, "pd", 1, 1, 0, 3, False, self.folder, "operator")), daemon=True)
        self.thread.start()

    def on_state(self, message):
        self.state = message

    def on_joints(self, message):
        self.position = message.position

    def call(self, name):
        return service(f"/{self.name}/experiment_node/{name}", Trigger)()

    def until(self, true, what):
        end = time.monotonic() + LIMIT
        while time.monotonic() < end:
            if self.state is not None and true(self.state):
                return
            time.sleep(0.01)
        raise AssertionError(f"{what}: not within {LIMIT:.0f} s; the last state was\n{self.state}")

    def until_state(self, state):
        self.until(lambda s: s.state == state, state)

    def until_message(self, *texts):
        self.until(lambda s: all(text in s.message for text in texts), f"message with {texts}")

    def end(self):
        self.call("reset")
        self.thread.join(LIMIT)
        return self.answer[0]


class Sensor:
    """A force/torque sensor at 500 Hz, in a thread of its own."""

    def __init__(self, topic):
        self.publisher = rospy.Publisher(topic, WrenchStamped, queue_size=100, tcp_nodelay=True)
        self.force, self.frame, self.silent, self.over = (0.0, 0.0), "maze", False, False
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.over:
            if not self.silent:
                message = WrenchStamped()
                message.header.stamp = rospy.Time.now()
                message.header.frame_id = self.frame
                message.wrench.force.x, message.wrench.force.y = self.force
                self.publisher.publish(message)
            time.sleep(0.002)


class Mouse:
    """A mouse that holds the marker still somewhere: rviz repeats where it is."""

    def __init__(self, name):
        self.drag, self.target, self.over = Drag(f"/{name}"), None, False
        assert self.drag.wait()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not self.over:
            target = self.target
            if target is not None:
                self.drag.move(target)
            time.sleep(0.05)

    def release(self):
        self.target, target = None, self.target
        self.drag.release(target)


class OperatorTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test")
        cls.folder = pathlib.Path(rospy.get_param("~folder"))
        shutil.rmtree(cls.folder, ignore_errors=True)
        cls.folder.mkdir(parents=True)

    def test_a_force_torque_handle(self):
        """Rows 2, 5 and 6 of the fault matrix with a sensor of one's own; the wrench rule: push +x, go to +x."""
        node = Node("topic")
        node.until_message("no wrench on /topic/ft_sensor/wrench", "nobody publishes it")
        sensor = Sensor("/topic/ft_sensor/wrench")
        sensor.frame = "nowhere"
        node.until_message('"nowhere"', '"maze"')
        refused = node.call("start")
        self.assertFalse(refused.success)
        self.assertIn('"nowhere"', refused.message)
        sensor.frame, sensor.force = "maze", (30.0, 0.0)
        node.until_message("let go of the handle, or tare the sensor", "30.0 N")
        sensor.force = (0.0, 0.0)
        node.until_message("ready: start")
        self.assertTrue(node.call("start").success)
        node.until_state("PASSIVE")
        self.assertEqual(node.state.message, "")

        before = node.position[0]
        sensor.force = (-8.0, 0.0)  # the start is near the right wall: to the left is room
        node.until(lambda s: abs(s.human_force - 8.0) < 1e-9, "8 N")
        node.until(lambda s: node.position[0] < before - 0.005, "5 mm to the left")
        sensor.force = (8.0, 0.0)
        left = node.position[0]
        node.until(lambda s: node.position[0] > left + 0.002, "and back to the right")
        sensor.force = (0.0, 0.0)

        sensor.silent = True
        node.until_state("FAULT")
        self.assertEqual(node.state.fault_name, "E_WRENCH_STALE")
        self.assertIn("check the force/torque sensor", node.state.message)
        self.assertFalse(node.call("start").success)
        self.assertTrue(node.call("clear_fault").success)  # asked for, but the cause is still there
        time.sleep(0.3)
        self.assertEqual(node.state.state, "FAULT")
        sensor.silent = False
        time.sleep(1.0)
        node.until(lambda s: node.call("clear_fault") and s.state == "IDLE", "a cleared fault")
        sensor.force = (30.0, 0.0)
        node.until_message("the sensor reads a force at rest")
        self.assertFalse(node.call("start").success)
        sensor.force = (0.0, 0.0)
        node.until_message("stopped: start to go on")
        self.assertTrue(node.call("start").success)
        node.until_state("PASSIVE")
        answer = node.end()
        sensor.over = True
        self.assertEqual((answer.success, answer.reason), (False, RunTrialResponse.ABORTED))

    def test_a_marker(self):
        """Dragged, let go, its menu, live tuning; all of it is in the bag."""
        node, mouse = Node("marker", self.folder), Mouse("marker")
        node.until_message("drag the handle to start")
        mouse.target = (START[0] - 0.015, START[1])
        node.until_state("PASSIVE")
        node.until(lambda s: abs(node.position[0] - mouse.target[0]) < NEAR, "the object follows the marker")
        mouse.target = (START[0] - 0.03, START[1])
        node.until(lambda s: s.human_force > 2.0, "a spring that pulls")
        mouse.release()
        node.until(lambda s: s.human_force < 0.5, "released")
        self.switching(node, mouse)
        self.tuning()
        mouse.drag.choose(2)  # stop
        node.until_state("IDLE")
        mouse.drag.choose(1)  # start
        node.until_state("PASSIVE")
        answer = node.end()
        mouse.over = True
        self.assertEqual(answer.controller, "pd")
        kept = list(self.folder.glob("*.aborted"))
        self.assertEqual(len(kept), 1, "an aborted trial leaves no bag that counts")
        self.next_trial(node)

    def switching(self, node, mouse):
        switch = service("/marker/experiment_node/switch_controller", SwitchController)
        unknown = switch("mahalanobi")
        self.assertFalse(unknown.success)
        self.assertIn('did you mean "mahalanobis"?', unknown.message)
        running = service("/marker/experiment_node/list_controllers", ListControllers)
        self.assertEqual(running().running, "pd")
        self.assertTrue(switch("mahalanobis").success)
        self.assertEqual(running().running, "mahalanobis")
        node.until(lambda s: s.controller == "mahalanobis", "the new controller in the state")
        mouse.drag.choose(10 + running().available.index("lqr"))
        node.until(lambda s: s.controller == "lqr", "the menu's controller in the state")

    def tuning(self):
        client = Client("/marker/experiment_node", timeout=LIMIT)
        set_parameters = service("/marker/experiment_node/set_parameters", Reconfigure)
        before = client.get_configuration(LIMIT)
        self.assertEqual(before["admittance/mass"], 90.0)
        descriptions = {d["name"]: d for d in client.get_parameter_descriptions(LIMIT)}
        self.assertIn("[N/m]", descriptions["pd/stiffness"]["description"])
        self.assertEqual((descriptions["pd/stiffness"]["min"], descriptions["pd/stiffness"]["max"]), (0.0, 1e4))
        for bad, text in (({"pd/stiffness": 2e4}, "expected a number from 0 to 10000"),
                          ({"pd/stiffness": float("nan")}, "expected a number from 0 to 10000"),
                          ({"pd/stifness": 1.0}, "did you mean pd/stiffness?"),
                          ({"admittance/damping": 0.0}, "expected a number from 40 to 2000"),
                          ({"admittance/mass": 20.0, "pd/damping": -1.0}, "pd/damping = -1")):
            request = Config(doubles=[DoubleParameter(name, value) for name, value in bad.items()])
            with self.assertRaises(rospy.ServiceException) as caught:
                set_parameters(request)
            self.assertIn(text, str(caught.exception))
            self.assertEqual(client.get_configuration(LIMIT), before, "a refused request changed something")
        now = client.update_configuration({"pd/stiffness": 350.0, "admittance/mass": 20.0})
        self.assertEqual((now["pd/stiffness"], now["admittance/mass"]), (350.0, 20.0))
        # the tool that Debian has
        done = subprocess.run(["rosrun", "dynamic_reconfigure", "dynparam", "set", "/marker/experiment_node",
                               "admittance/damping", "120.0"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual(client.update_configuration({"admittance/mass": 20.0})["admittance/damping"], 120.0)
        client.close()

    def next_trial(self, node):
        """What a person chose or tuned, while the hand was waited for too, holds for the next trial."""
        again = Node("marker", self.folder)
        again.until_message("drag the handle to start")
        switch = service("/marker/experiment_node/switch_controller", SwitchController)
        self.assertTrue(switch("none").success)  # while the hand is waited for: holds for the trial that comes
        mouse = Mouse("marker")
        mouse.target = (START[0] - 0.01, START[1])
        again.until(lambda s: s.state == "PASSIVE" and s.t > 0.2, "a running trial")
        answer = again.end()
        mouse.over = True
        self.assertEqual(answer.controller, "none")
        newest = max(self.folder.glob("*_none_*.aborted"), key=lambda path: path.stat().st_mtime)
        with rosbag.Bag(str(newest)) as bag:
            metadata = [json.loads(m.data) for _, m, _ in bag.read_messages(topics="/marker/metadata")]
        self.assertEqual(metadata[0]["human"], "marker")
        self.assertFalse(metadata[0]["simulated_participants"])
        self.assertEqual(metadata[0]["parameters"]["robot/admittance/mass"], [20.0, 20.0])
        self.assertEqual(float(metadata[0]["parameters"]["assistance/pd/stiffness"]), 350.0)


if __name__ == "__main__":
    rostest.rosrun("phri_sim", "operator_test", OperatorTest)
