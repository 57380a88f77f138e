"""What the lab tools take from a bag: orientations with raw wrenches, and single numbers over time."""

import re

import numpy as np

from .bag_check import read_verified
from .bags import decoded
from .errors import BagError, UsageError

ORIENTATIONS = {  # type -> where its quaternion is
    "geometry_msgs/PoseStamped": lambda message: message.pose.orientation,
    "geometry_msgs/TransformStamped": lambda message: message.transform.rotation,
    "geometry_msgs/PoseWithCovarianceStamped": lambda message: message.pose.pose.orientation,
    "nav_msgs/Odometry": lambda message: message.pose.pose.orientation,
}
WRENCHES = {"geometry_msgs/WrenchStamped": lambda message: message.wrench}


def poses_and_wrenches(path, pose: str = "", wrench: str = "") -> tuple:
    """t (N,) [s], q (N, 4) as x, y, z, w, wrenches (N, 6), all at the wrenches' stamps; the orientation is the last one
    before. `pose` and `wrench` name topics, empty: the only one of its type."""
    messages, present = _messages(path)
    chosen = [_topic(path, present, pose, ORIENTATIONS, "pose"), _topic(path, present, wrench, WRENCHES, "wrench")]
    series = []
    for topic, kinds in zip(chosen, (ORIENTATIONS, WRENCHES)):
        at, rows = kinds[present[topic]], []
        for message, stamp, time in _decoded(path, messages, topic):
            value = at(message)
            parts = (value,) if kinds is ORIENTATIONS else (value.force, value.torque)
            numbers = [getattr(part, axis) for part in parts for axis in "xyzw" if hasattr(part, axis)]
            rows.append((stamp or time, numbers))
        rows.sort(key=lambda row: row[0])
        series.append((np.array([row[0] for row in rows], dtype="int64"), np.array([row[1] for row in rows])))
    (pose_times, q), (times, wrenches) = series
    newest = np.searchsorted(pose_times, times, side="right") - 1
    known = newest >= 0
    if not known.any():
        raise BagError(f"{path}: every message of {chosen[1]} is older than the first of {chosen[0]}")
    times = times[known]
    return (times - times[0]) * 1e-9, q[newest[known]], wrenches[known]


def signals(path, names) -> list:
    """(t (N,) [s], values (N,)) of each name, `TOPIC:FIELD` with fields as rostopic echo writes them, for instance
    `/phri/joint_states:position[0]`. Times are header stamps where all have them, else those of recording."""
    messages, present = _messages(path)
    found = []
    for name in names:
        topic, _, field = name.partition(":")
        if not field:
            raise UsageError(f"{name!r}: expected TOPIC:FIELD, for instance /odom:twist.twist.linear.x")
        if topic not in present:
            raise BagError(f"{path}: no topic {topic}; the bag holds {_listed(present)}")
        rows = list(_decoded(path, messages, topic))
        values = np.array([_number(path, topic, field, message) for message, _, _ in rows])
        found.append(([stamp for _, stamp, _ in rows], [time for _, _, time in rows], values))
    stamped = all(all(stamps) for stamps, _, _ in found)
    series = [(np.array(stamps if stamped else times, dtype="int64"), values) for stamps, times, values in found]
    start = min(times.min() for times, _ in series)
    ordered = [(times[order], values[order]) for times, values in series
               for order in [np.argsort(times, kind="stable")]]  # fmt: skip
    return [((times - start) * 1e-9, values) for times, values in ordered]


def _messages(path):
    messages, _ = read_verified(path)
    return messages, {message.connection.topic: message.connection.type for message in messages}


def _decoded(path, messages, topic):
    """(message, stamp or None, time of recording) [ns] of one topic."""
    for message in messages:
        if message.connection.topic == topic:
            yield *decoded(message, path), message.time


def _listed(present):
    return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(present.items())) or "nothing"


def _topic(path, present, given, kinds, name):
    if given and present.get(given) in kinds:
        return given
    found = [topic for topic, kind in present.items() if kind in kinds]
    if given or len(found) != 1:
        what = f"topic {given}" if given else f"{len(found)} {name} topics"
        raise BagError(
            f"{path}: {what}, expected one of type {' or '.join(kinds)} (--{name} TOPIC); it holds {_listed(present)}"
        )
    return found[0]


def _number(path, topic, field, message):
    value = message
    for part in field.split("."):
        match = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", part)
        try:
            value = getattr(value, match[1])
            value = value if match[2] is None else value[int(match[2])]
        except (AttributeError, IndexError, TypeError):
            raise BagError(f"{path}: topic {topic}: no field {field!r} (at {part!r})") from None
    try:
        return float(value)
    except (TypeError, ValueError):
        raise BagError(f"{path}: topic {topic}: field {field!r} is not a number") from None
