#!/usr/bin/python3
"""Drags the interactive marker `hand` as a person with a mouse in rviz would: POSE_UPDATE at 20 Hz, then MOUSE_UP.

    from drag_marker import Drag, drag_along
    arrived = drag_along(points, speed=0.08)         # points [(x, y), ...] [m] in frame maze

    drag_marker.py --experiment maze_assistance --speed 0.08     # along the experiment's route
    drag_marker.py 0.1,0.1 0.0,0.1                               # along these points

The marker waits for the object: it is never farther than `lead` from it, whatever holds the object back. Times are of
the wall, so that it works before the session's clock runs. Exit codes: 0 the trial ended or the object came to rest at
the last point, 64 usage, 70 neither within the time, 76 nobody listens to the marker.
"""

import argparse
import sys
import threading
import time

import numpy as np
import rospy
from phri_msgs.msg import Trial
from sensor_msgs.msg import JointState
from visualization_msgs.msg import InteractiveMarkerFeedback

FRAME, MARKER = "maze", "hand"
RATE = 20.0  # [Hz]
NEAR, SLOW = 0.004, 0.01  # [m] from the last point, and [m/s]: arrived, not passing through
CONNECT_WAIT = 20.0  # [s]


class Drag:
    """The mouse on the marker. `namespace`: of the experiment node's topics. Needs an initialised node."""

    def __init__(self, namespace="/phri", client="drag_marker"):
        self.client, self.position, self.velocity, self.lock = client, None, None, threading.Lock()
        self.publisher = rospy.Publisher(f"{namespace}/hand/feedback", InteractiveMarkerFeedback, queue_size=10)
        self.started = self.over = False  # of a trial that was seen to start
        self.trials = rospy.Subscriber(f"{namespace}/trial", Trial, self.announced, queue_size=10)
        self.joints = rospy.Subscriber(f"{namespace}/joint_states", JointState, self.moved, queue_size=1)

    def moved(self, message):
        with self.lock:
            self.position, self.velocity = np.array(message.position[:2]), np.array(message.velocity[:2])

    def announced(self, message):
        if message.phase == Trial.STARTED:
            self.started, self.over = True, False
        elif self.started:
            self.over = True

    def object(self):
        """Where the object is [m]; None before the first message."""
        with self.lock:
            return self.position

    def rests_at(self, goal):
        with self.lock:
            return (self.position is not None and np.linalg.norm(self.position - goal) < NEAR
                    and np.linalg.norm(self.velocity) < SLOW)

    def connected(self):
        return self.publisher.get_num_connections() > 0

    def wait(self, timeout=CONNECT_WAIT):
        """True once somebody listens to the marker."""
        end = time.monotonic() + timeout
        while not self.connected() and time.monotonic() < end and not rospy.is_shutdown():
            time.sleep(0.05)
        return self.connected()

    def send(self, event, position, **fields):
        message = InteractiveMarkerFeedback(client_id=self.client, marker_name=MARKER, control_name="push",
                                            event_type=event, **fields)
        message.header.frame_id = FRAME
        message.pose.position.x, message.pose.position.y = float(position[0]), float(position[1])
        message.pose.orientation.w = 1.0
        self.publisher.publish(message)

    def press(self, position):
        self.over = False  # of an earlier trial
        self.send(InteractiveMarkerFeedback.MOUSE_DOWN, position)

    def move(self, position):
        self.send(InteractiveMarkerFeedback.POSE_UPDATE, position)

    def release(self, position):
        self.send(InteractiveMarkerFeedback.MOUSE_UP, position)

    def choose(self, entry):
        """Entry of the right-click menu: 1 start, 2 stop, 3 clear fault, 4 reset, 10 + k the k-th controller."""
        self.send(InteractiveMarkerFeedback.MENU_SELECT, (0.0, 0.0), menu_entry_id=entry)


def arc_length(points):
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))


def ahead(points, lengths, s):
    """The point at arc length s [m]."""
    return np.array([np.interp(s, lengths, points[:, axis]) for axis in (0, 1)])


def advance(points, lengths, s, step, position, lead):
    """The farthest arc length in [s, s + step] at which the marker is within `lead` of the object; s if there is none.
    `position` None: nothing is known of the object yet, and the marker stays."""
    if position is None:
        return s
    for fraction in (1.0, 0.75, 0.5, 0.25):
        candidate = min(s + fraction * step, lengths[-1])
        if np.linalg.norm(ahead(points, lengths, candidate) - position) <= lead:
            return candidate
    return s


def drag_along(points, speed=0.08, lead=0.025, timeout=120.0, namespace="/phri", drag=None, done=lambda: False):
    """Drags along `points` [(x, y), ...] [m], at up to `speed` [m/s], then lets go. Returns whether the trial ended,
    the object came to rest at the last point, or `done`, which is asked 20 times a second, said so; False after
    `timeout` [s]. Raises ConnectionError when nobody listens to the marker."""
    points = np.atleast_2d(np.asarray(points, dtype=float))
    if points.shape[1] != 2 or not np.isfinite(points).all():
        raise ValueError(f"points: shape {points.shape}, expected finite (N, 2)")
    drag = drag or Drag(namespace)
    if not drag.wait():
        raise ConnectionError(f"nobody listens to {drag.publisher.resolved_name}")
    lengths, s, end = arc_length(points), 0.0, time.monotonic() + timeout
    drag.press(points[0])
    arrived = False
    while not arrived and time.monotonic() < end and not rospy.is_shutdown():
        position = drag.object()
        s = advance(points, lengths, s, speed / RATE, position, lead)
        drag.move(ahead(points, lengths, s))
        arrived = done() or drag.over or (s == lengths[-1] and drag.rests_at(points[-1]))
        time.sleep(1.0 / RATE)
    drag.release(ahead(points, lengths, s))
    return bool(arrived)


def point(text):
    x, y = text.split(",")
    return float(x), float(y)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("points", nargs="*", type=point, metavar="X,Y", help="[m] in frame maze; write -- before them")
    parser.add_argument("--experiment", help="drag along the route of this experiment instead")
    parser.add_argument("--speed", type=float, default=0.08, help="[m/s] (0.08)")
    parser.add_argument("--lead", type=float, default=0.025, help="[m] of the marker before the object (0.025)")
    parser.add_argument("--timeout", type=float, default=120.0, help="[s] (120)")
    parser.add_argument("--namespace", default="/phri", help="of the experiment node's topics (/phri)")
    arguments = parser.parse_args(rospy.myargv()[1:])
    if bool(arguments.points) == bool(arguments.experiment):
        print("drag_marker: give points, or an experiment", file=sys.stderr)
        return 64
    points = arguments.points
    if arguments.experiment:
        import phri_sim
        points = phri_sim.Experiment(arguments.experiment).route()
    rospy.init_node("drag_marker", anonymous=True, disable_signals=True)
    try:
        arrived = drag_along(points, arguments.speed, arguments.lead, arguments.timeout, arguments.namespace)
    except ConnectionError as error:
        print(f"drag_marker: {error}", file=sys.stderr)
        return 76
    print("arrived" if arrived else "did not arrive")
    return 0 if arrived else 70


if __name__ == "__main__":
    sys.exit(main())
