#!/usr/bin/python3
"""Stands in for experiment_node and session_runner in the tests of the panel: the same names, no physics.

Standard output: one JSON object per event, {"call": service, "argument": ...} for each service call when it begins,
{"end": service} when it has ended. Standard input: one JSON object per line that replaces fields of what it shows:
  {"state": {field of ControllerState: value}}   {"trial": {field of Trial: value}} (published)
  {"block": "start"}     calls of this service are not answered until {"release": "start"}, at most a minute
  {"limit": 500}         values above are refused by set_parameters with an error text
  {"clamp": 300}         values above are lowered to it without an error, as dynamic_reconfigure servers do
Run alone it is something to look at: stdin may be closed.
"""

import json
import math
import sys
import threading

import rospy
from dynamic_reconfigure.msg import (Config, ConfigDescription, DoubleParameter, Group, ParamDescription)
from dynamic_reconfigure.srv import Reconfigure
from geometry_msgs.msg import Point
from nav_msgs.msg import OccupancyGrid
from phri_msgs.msg import ControllerState, Trial
from phri_msgs.srv import ListControllers, ListControllersResponse, Rate, RateResponse
from phri_msgs.srv import SwitchController, SwitchControllerResponse
from std_srvs.srv import Trigger, TriggerResponse
from visualization_msgs.msg import Marker, MarkerArray

LONGEST_BLOCK = 60.0  # [s]
PARAMETERS = [  # name, default, minimum, maximum, meaning [unit]
    ("pd/stiffness", 200.0, 0.0, 1e14, "gain on the position error [N/m]"),
    ("pd/damping", 20.0, 0.0, 1e14, "gain on the velocity error [Ns/m]"),
    ("assistance/q_scale", 1e-3, 1e-12, 1e14, "scalar on the weight of the state [-]"),
    ("assistance/risk", 0.0, -1.0, 1.0, "how much uncertainty counts [-]"),
    ("admittance/mass", 2.0, 0.5, 20.0, "of the object [kg]"),
    ("admittance/damping", 10.0, 0.0, 200.0, "against motion [Ns/m]"),
    ("limits/assistance_force", 25.0, 0.0, 60.0, "norm of the assistance force [N]"),
    ("limits/assistance_power", 10.0, 0.0, 50.0, "power of the assistance [W]"),
    ("limits/tank", 2.0, 0.0, 10.0, "energy that the assistance may store [J]"),
]
EXPERIMENT = ["none", "lqr", "mahalanobis"]
AVAILABLE = ["none", "lqr", "mahalanobis", "pd", "lqr_risk"]


def say(**event):
    print(json.dumps(event), flush=True)


class Fake:
    def __init__(self):
        self.lock = threading.Lock()
        self.state = ControllerState(state="PASSIVE", controller="lqr", tank=2.0, lateness=2e-4)
        self.values = {name: default for name, default, *_ in PARAMETERS}
        self.limit, self.clamp = math.inf, math.inf
        self.blocks = {}
        self.start = rospy.get_time()
        self.states = rospy.Publisher("~state", ControllerState, queue_size=10)
        self.trials = rospy.Publisher("trial", Trial, queue_size=10, latch=True)
        self.updates = rospy.Publisher("~parameter_updates", Config, queue_size=10, latch=True)
        self.descriptions = rospy.Publisher("~parameter_descriptions", ConfigDescription, queue_size=1, latch=True)
        self.descriptions.publish(self.description())
        self.updates.publish(self.config())
        for name, after in (("start", "ACTIVE"), ("stop", "PASSIVE"), ("clear_fault", "PASSIVE"), ("reset", "IDLE")):
            self.serve("~" + name, name, Trigger, self.trigger(name, after))
        self.serve("~list_controllers", "list_controllers", ListControllers, self.list_controllers)
        self.serve("~switch_controller", "switch_controller", SwitchController, self.switch)
        self.serve("~set_parameters", "set_parameters", Reconfigure, self.set_parameters)
        self.serve("session_runner/rate", "rate", Rate, self.rate)
        rospy.Timer(rospy.Duration(0.01), self.tick)

    def serve(self, topic, name, kind, handler):
        def handle(request):
            if kind is Reconfigure:
                argument = {value.name: value.value for value in request.config.doubles}
            else:
                argument = next((getattr(request, field) for field in request.__slots__), None)
            say(call=name, argument=argument)
            block = self.blocks.get(name)
            if block is not None:
                block.wait(LONGEST_BLOCK)
            try:
                return handler(request)
            finally:
                say(end=name)

        rospy.Service(topic, kind, handle)

    def trigger(self, name, after):
        def handler(_):
            with self.lock:
                self.state.state = after
                self.state.fault_name, self.state.message = "", ""
            return TriggerResponse(True, f"{name} done")

        return handler

    def list_controllers(self, _):
        return ListControllersResponse(EXPERIMENT, AVAILABLE, self.state.controller)

    def switch(self, request):
        if request.controller not in AVAILABLE:
            return SwitchControllerResponse(False, f"unknown controller '{request.controller}'")
        self.state.controller = request.controller
        return SwitchControllerResponse(True, f"{request.controller} is in force")

    def rate(self, request):
        return RateResponse(True, "participant 0, trial 3")

    def set_parameters(self, request):
        asked = {value.name: value.value for value in request.config.doubles}
        for name, value in asked.items():
            if value > self.limit:
                raise rospy.ServiceException(f"{name} = {value:g} is unstable, at most {self.limit:g}")
        self.values.update({name: min(value, self.clamp) for name, value in asked.items()})
        self.updates.publish(self.config())
        return self.config()

    def config(self, values=None):
        values = values or self.values
        return Config(doubles=[DoubleParameter(name, value) for name, value in values.items()])

    def description(self):
        parameters = [ParamDescription(name, "double", 0, meaning, "") for name, *_, meaning in PARAMETERS]
        bounds = [self.config({row[0]: row[column] for row in PARAMETERS}) for column in (3, 2, 1)]
        return ConfigDescription([Group("Default", "", parameters, 0, 0)], *bounds)

    def tick(self, _):
        with self.lock:
            t = rospy.get_time() - self.start
            self.state.header.stamp = rospy.Time.from_sec(t)
            self.state.t = t
            self.state.human_force = abs(6 * math.sin(0.9 * t)) + 0.8 * math.sin(7 * t) ** 2
            active = self.state.state == "ACTIVE"
            self.state.assistance_force = 4 + 3 * math.sin(1.3 * t) if active else 0.0
            self.state.disagreement = max(0.0, 2 * math.sin(0.7 * t)) if active else 0.0
            self.states.publish(self.state)

    def obey(self, order):
        with self.lock:
            for field, value in order.get("state", {}).items():
                setattr(self.state, field, value)
        if "trial" in order:
            trial = Trial(controller="lqr", trial=3)
            for field, value in order["trial"].items():
                setattr(trial, field, value)
            self.trials.publish(trial)
        if "block" in order:
            self.blocks[order["block"]] = threading.Event()
        if "release" in order:
            self.blocks.pop(order["release"]).set()
        self.limit = order.get("limit", self.limit)
        self.clamp = order.get("clamp", self.clamp)


def scene():
    """A map and markers, so that the 3-D view has something to show."""
    grid = OccupancyGrid()
    grid.header.frame_id = "world"
    grid.info.resolution, grid.info.width, grid.info.height = 0.005, 60, 60
    grid.info.origin.position.x = grid.info.origin.position.y = -0.15
    grid.info.origin.orientation.w = 1.0
    grid.data = [100 if min(i, j, 59 - i, 59 - j) < 2 or (i % 15 < 2 and j > 12) else 0
                 for i in range(60) for j in range(60)]
    markers = MarkerArray()
    for number, (x, y, color) in enumerate([(-0.08, -0.1, (0.15, 0.15, 0.18)), (0.1, 0.1, (0.18, 0.62, 0.31))]):
        marker = Marker(type=Marker.CYLINDER, ns="fake", id=number)
        marker.header.frame_id = "world"
        marker.pose.position = Point(x, y, 0.01)
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = 0.02
        marker.color.r, marker.color.g, marker.color.b = color
        marker.color.a = 1.0
        markers.markers.append(marker)
    return grid, markers


def main():
    rospy.init_node("experiment_node", disable_signals=True)
    grid, markers = scene()
    publishers = (rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True),
                  rospy.Publisher("~markers", MarkerArray, queue_size=1, latch=True))
    publishers[0].publish(grid)
    publishers[1].publish(markers)
    fake = Fake()
    say(ready=True)
    for line in sys.stdin:
        fake.obey(json.loads(line))
    rospy.spin()


if __name__ == "__main__":
    main()
