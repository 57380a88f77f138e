#!/usr/bin/python3
"""Publishes a joystick, gamepad, space mouse or mouse as `joy` (sensor_msgs/Joy).

axes[0] is +1 to the left, axes[1] is +1 forward (away from the person), as every ROS joystick node has it; buttons[0]
starts, buttons[1] stops.

  joystick, gamepad  first stick; buttons in the order of their codes
  space mouse        the cap, pushed sideways and forward; its first two buttons
  mouse              its speed while the left button is held (that is the hand's grip); middle starts, right stops

A message per change, at most `rate` a second, and at least `repeat` a second while the device is held: out of the
middle, or gripped. One message tells that it was let go; then there is silence, which the hand takes for an open hand.

Exit codes: 0 ended by a signal, 66 no such device or none that may be read, 70 internal error, 74 the device is gone,
78 bad parameters.
"""

import glob
import math
import os
import select
import sys
import time

import evdev
import rospy
from evdev import ecodes
from node_parameters import ParameterError, read
from sensor_msgs.msg import Joy

OK, MISSING, INTERNAL, GONE, CONFIGURATION = 0, 66, 70, 74, 78

SCHEMA = {  # key: (default, lowest, highest, meaning)
    "device": ("", None, None, "path such as /dev/input/event5; empty: the first joystick, space mouse or mouse"),
    "deadzone": (0.05, 0.0, 0.9, "[-] of the full deflection, around the middle"),
    "rate": (50.0, 10.0, 500.0, "[Hz] at most"),
    "repeat": (20.0, 10.0, 500.0, "[Hz] at least, while the device is held"),
    "mouse_speed": (1500.0, 10.0, 1e5, "[counts/s] of a mouse that make a full deflection"),
    "exclusive": (False, None, None, "keep the device's events from everybody else (the desktop)"),
}

CAP_RANGE = 350.0  # of a space mouse that reports its cap as REL; one that reports ABS tells its range
CAP_SILENCE = 0.1  # [s] REL events of value 0 never arrive: an axis that is silent for so long is in the middle
MOUSE_DECAY = 0.05  # [s] time constant of the mouse's speed
SETTLED = 0.01  # [-] a decaying speed below this is 0


def kind_of(capabilities):
    """'joystick', 'space mouse', 'mouse' or None, by what a device says it can do: {type: codes}."""
    absolute, relative, keys = (set(capabilities.get(t, ())) for t in (ecodes.EV_ABS, ecodes.EV_REL, ecodes.EV_KEY))
    if ecodes.BTN_TOUCH in keys or ecodes.BTN_TOOL_PEN in keys:
        return None  # a pad, a screen, a tablet: a place is no deflection
    plane, cap = {ecodes.ABS_X, ecodes.ABS_Y}, {ecodes.ABS_Z, ecodes.ABS_RX, ecodes.ABS_RY, ecodes.ABS_RZ}
    if plane <= absolute and any(ecodes.BTN_JOYSTICK <= key < ecodes.BTN_DIGI for key in keys):
        return "joystick"
    if (plane | cap) <= absolute or (plane | cap) <= relative:  # the codes of REL_X .. REL_RZ are those of ABS_X ..
        return "space mouse"
    if {ecodes.REL_X, ecodes.REL_Y} <= relative and ecodes.BTN_LEFT in keys:
        return "mouse"
    return None


class JoyState:
    """What a device's events add up to. Times [s] by any one clock that only rises.

    capabilities: {EV_ABS: [(code, AbsInfo)], EV_REL: [code], EV_KEY: [code]} as evdev's capabilities() gives them.
    """

    def __init__(self, capabilities, deadzone=0.05, mouse_speed=1500.0):
        self.deadzone, self.mouse_speed = deadzone, mouse_speed
        self.ranges = dict(capabilities.get(ecodes.EV_ABS, ()))
        keys = capabilities.get(ecodes.EV_KEY, ())
        self.kind = kind_of({ecodes.EV_ABS: self.ranges, ecodes.EV_REL: capabilities.get(ecodes.EV_REL, ()),
                             ecodes.EV_KEY: keys})
        if self.kind is None:
            raise ValueError("not a joystick, space mouse or mouse")
        if self.kind == "mouse":
            self.keys = [ecodes.BTN_MIDDLE, ecodes.BTN_RIGHT]
        else:
            first = ecodes.BTN_JOYSTICK if self.kind == "joystick" else ecodes.BTN_MISC
            self.keys = sorted(key for key in keys if first <= key < ecodes.BTN_DIGI)
        self.down = set()
        # right and back, as evdev counts; and when that was
        self.raw = {code: (self.scaled(code, info.value), 0.0) for code, info in self.ranges.items()}
        self.is_relative = ecodes.ABS_X not in self.ranges

    def scaled(self, code, value):
        """-1 to 1 from the middle of the range."""
        info = self.ranges[code]
        half = 0.5 * (info.max - info.min)
        return (value - 0.5 * (info.max + info.min)) / half if half > 0 else 0.0

    def event(self, kind, code, value, now):
        if kind == ecodes.EV_SYN and code == ecodes.SYN_DROPPED:
            self.down.clear()  # events were lost: as if let go, until the next ones
            self.raw.clear()
        elif kind == ecodes.EV_KEY:
            (self.down.discard if value == 0 else self.down.add)(code)
        elif kind == ecodes.EV_ABS and code in self.ranges:
            self.raw[code] = self.scaled(code, value), now
        elif kind == ecodes.EV_REL and self.kind == "space mouse":
            self.raw[code] = value / CAP_RANGE, now
        elif kind == ecodes.EV_REL and self.kind == "mouse":
            # counts in, an exponential out: its integral is the counts, whatever the rate of the events
            self.raw[code] = self.speed(code, now) + value / MOUSE_DECAY / self.mouse_speed, now

    def speed(self, code, now):
        value, since = self.raw.get(code, (0.0, now))
        value *= math.exp(-max(0.0, now - since) / MOUSE_DECAY)
        return value if abs(value) > SETTLED else 0.0

    def axis(self, code, now):
        if self.kind == "mouse":
            return self.speed(code, now) if ecodes.BTN_LEFT in self.down else 0.0
        value, since = self.raw.get(code, (0.0, now))
        return 0.0 if self.is_relative and now - since > CAP_SILENCE else value

    def state(self, now):
        """(axes, buttons, held): [left, forward] in -1 to 1, 0 or 1 per button."""
        # REL_X, REL_Y have the codes of ABS_X, ABS_Y; evdev counts right and back as positive
        axes = [-min(1.0, max(-1.0, self.axis(code, now))) for code in (ecodes.ABS_X, ecodes.ABS_Y)]
        if math.hypot(*axes) <= self.deadzone:
            axes = [0.0, 0.0]
        axes = [axis + 0.0 for axis in axes]  # no -0
        held = any(axes) or (self.kind == "mouse" and ecodes.BTN_LEFT in self.down)
        return axes, [int(key in self.down) for key in self.keys], held


class Pacer:
    """When a state is worth a message."""

    def __init__(self, rate, repeat):
        self.shortest, self.longest = 1.0 / rate, 1.0 / min(rate, repeat)
        self.sent, self.at = None, -math.inf

    def due(self, state, now):
        if state == self.sent and not (state[2] and now - self.at >= self.longest - 1e-9):
            return False
        if now - self.at < self.shortest - 1e-9:
            return False
        self.sent, self.at = state, now
        return True


def suitable(path):
    """The device at `path` and its kind, or None and why not."""
    try:
        device = evdev.InputDevice(path)
    except OSError as error:
        return None, error.strerror or str(error)
    kind = kind_of(device.capabilities(absinfo=False))
    if kind is None:
        device.close()
        return None, f"{device.name}: not a joystick, space mouse or mouse"
    return device, kind


def find_device(path, folder="/dev/input"):
    """The device named, or the best there is. Raises LookupError that tells what there is and what helps."""
    order = {"joystick": 0, "space mouse": 1, "mouse": 2}
    found, others = [], []
    for candidate in [path] if path else sorted(glob.glob(os.path.join(folder, "event*"))):
        device, text = suitable(candidate)
        if device is None:
            others.append(f"{candidate}: {text}")
        else:
            found.append((order[text], candidate, device))
    if found:
        best = min(found, key=lambda entry: entry[:2])
        for entry in found:
            if entry is not best:
                entry[2].close()
        return best[2]
    there = "; ".join(others) if others else f"{folder} has no event devices"
    raise LookupError(f"no joystick, space mouse or mouse that can be read: {there}. Devices are readable by the group "
                      "input: 'sudo usermod -aG input $USER', then log in again; in a container, pass the device in")


def run(settings):
    try:
        device = find_device(settings["device"])
    except LookupError as error:
        rospy.logfatal("%s", error)
        return MISSING
    joy = JoyState(device.capabilities(), settings["deadzone"], settings["mouse_speed"])
    pacer = Pacer(settings["rate"], settings["repeat"])
    publisher = rospy.Publisher("joy", Joy, queue_size=10)
    rospy.loginfo("%s: %s, a %s", device.path, device.name, joy.kind)

    def publish(axes, buttons):
        message = Joy(axes=axes, buttons=buttons)
        message.header.stamp = rospy.Time.now()
        publisher.publish(message)

    try:
        if settings["exclusive"]:
            device.grab()
        while not rospy.is_shutdown():
            if select.select([device.fd], [], [], 1.0 / settings["rate"])[0]:
                for event in device.read():
                    joy.event(event.type, event.code, event.value, time.monotonic())
            now = time.monotonic()
            state = joy.state(now)
            if pacer.due(state, now):
                publish(*state[:2])
    except OSError as error:
        publish([0.0, 0.0], [0] * len(joy.keys))
        rospy.logfatal("%s: %s", device.path, error.strerror or error)
        return GONE
    return OK


def main():
    rospy.init_node("joy_node")
    try:
        return run(read(SCHEMA, rospy.get_param("~", {})))
    except ParameterError as error:
        for line in error.errors:
            rospy.logfatal("%s: %s", rospy.get_name(), line)
        return CONFIGURATION
    except rospy.ROSInterruptException:
        return OK
    except Exception as error:  # noqa: B902  a node that fails must say so
        rospy.logfatal("%s: %s: %s", rospy.get_name(), type(error).__name__, error)
        return INTERNAL


if __name__ == "__main__":
    sys.exit(main())
