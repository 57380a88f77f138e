"""Demonstrations from any bag with a pose topic and a wrench topic, or with the observations of our own experiments.

The bag is verified first (`bag_check`), then only the chosen topics are decoded, with or without ROS (`bags`).
A topic is chosen by its type where there is exactly one of that kind; else it must be named.
- observations (phri_msgs/Observation): position and human wrench. Every trial is a demonstration: its t begins anew.
- pose and wrench: times are header stamps, or where a message has none, or all are zero, the times of recording. The
  demonstration is where the two overlap; forces are interpolated at the poses' times.

Frames: positions are the pose's in its own frame. Forces are taken as given, in their own frame: nothing is rotated. It
is said when the two frames are not called the same. Torques and orientations are not used.
"""

from itertools import pairwise

import numpy as np

from . import demonstrations
from .bag_check import read_verified
from .bags import decoded as decode
from .demonstrations import FEWEST_SAMPLES
from .errors import BagError

OBSERVATION = "phri_msgs/Observation"
POSES = {  # type -> where its point is
    "geometry_msgs/PoseStamped": lambda message: message.pose.position,
    "geometry_msgs/PoseWithCovarianceStamped": lambda message: message.pose.pose.position,
    "geometry_msgs/TransformStamped": lambda message: message.transform.translation,
    "geometry_msgs/Pose": lambda message: message.position,
    "nav_msgs/Odometry": lambda message: message.pose.pose.position,
}
WRENCHES = {
    "geometry_msgs/WrenchStamped": lambda message: message.wrench.force,
    "geometry_msgs/Wrench": lambda message: message.force,
}
NONE = "none"  # of --wrench: learn from positions alone
GAP = 0.2  # [s] between poses that is said to be bridged


def read(path, pose: str = "", wrench: str = "") -> tuple:
    """(demonstrations, what a user should know of them). `pose` and `wrench` name topics, empty: by type; wrench
    "none": positions only. Raises MissingInputError, BagError naming the topics that are there."""
    messages, _ = read_verified(path)
    present = {message.connection.topic: message.connection.type for message in messages}
    chosen = _chosen(path, present, pose, wrench)
    decoded = {topic: [] for topic in chosen}
    for message in messages:
        if message.connection.topic in decoded:
            decoded[message.connection.topic].append((message.time, *decode(message, path)))
    if present[chosen[0]] == OBSERVATION:
        return _observed(path, chosen[0], decoded[chosen[0]])
    return _paired(path, present, chosen, decoded)


def _chosen(path, present, pose, wrench):
    """The topics: observations alone, or pose and wrench (one, if there shall be no wrench)."""
    if not pose and not wrench:
        observed = [topic for topic, kind in present.items() if kind == OBSERVATION]
        if len(observed) == 1:
            return observed
    if pose and present.get(pose) == OBSERVATION:
        return [pose]
    first = _topic(path, present, pose, POSES, "pose")
    return [first] if wrench == NONE else [first, _topic(path, present, wrench, WRENCHES, "wrench")]


def _topic(path, present, given, kinds, name):
    there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(present.items())) or "nothing"
    if given:
        if given not in present:
            raise BagError(f"{path}: no topic {given}; the bag holds {there}")
        if present[given] not in kinds:
            raise BagError(f"{path}: topic {given} is of type {present[given]}, expected {' or '.join(kinds)}")
        return given
    found = sorted(topic for topic, kind in present.items() if kind in kinds)
    if len(found) != 1:
        how_many = f"{len(found)} {name} topics ({', '.join(found)})" if found else f"no {name} topic"
        hint = f" or --wrench {NONE}" if name == "wrench" else ""
        raise BagError(f"{path}: {how_many}, name one by --{name} TOPIC{hint}; the bag holds {there}")
    return found[0]


def _observed(path, topic, entries):
    """Trials of observations; a trial ends where t does not rise."""
    t = np.array([message.t for _, message, _ in entries])
    sizes = {(len(message.state), len(message.human_wrench)) for _, message, _ in entries}
    if len(sizes) != 1 or (dof := next(iter(sizes))[1]) < 1 or next(iter(sizes))[0] != 2 * dof:
        raise BagError(f"{path}: topic {topic}: state and human_wrench of {sorted(sizes)} numbers, expected 2 n and n")
    states = np.array([message.state for _, message, _ in entries])
    forces = np.array([message.human_wrench for _, message, _ in entries])
    found, notes = [], []
    ends = [0, *(np.flatnonzero(np.diff(t) <= 0.0) + 1), len(t)]
    for number, (begin, end) in enumerate(pairwise(ends), start=1):
        if end - begin < FEWEST_SAMPLES:
            notes.append(f"{path}: trial {number} has {end - begin} observations and is left out")
            continue
        part = slice(begin, end)
        found.append(demonstrations._demonstration(f"{path}: trial {number}", t[part], states[part, :dof],
                                                   force=forces[part]))  # fmt: skip
    if not found:
        raise BagError(f"{path}: topic {topic}: no trial of at least {FEWEST_SAMPLES} observations")
    notes.append(f"{path}: {len(found)} trial(s) of {topic}, human wrench in the frame of the positions")
    return found, notes


def _paired(path, present, chosen, decoded):
    series, frames = [], []
    for topic, kinds in zip(chosen, (POSES, WRENCHES)):
        entries, at = decoded[topic], kinds[present[topic]]
        stamps = [stamp for _, _, stamp in entries]
        if any(stamp is None for stamp in stamps) or not any(stamps):
            stamps = [time for time, _, _ in entries]
        vectors = [at(message) for _, message, _ in entries]
        order = np.argsort(np.array(stamps, dtype="int64"), kind="stable")
        values = np.array([[vector.x, vector.y, vector.z] for vector in vectors])[order]
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            raise BagError(f"{path}: topic {topic}: a number at {stamps[order[bad[0]]] * 1e-9:.3f} s is not finite")
        series.append((np.array(stamps, dtype="int64")[order], values))
        header = getattr(entries[0][1], "header", None)
        frames.append(header.frame_id if header else "")
    stamps, positions = series[0]
    force, notes = None, []
    if len(series) == 2:
        inside = (stamps >= series[1][0][0]) & (stamps <= series[1][0][-1])
        if inside.sum() < FEWEST_SAMPLES:
            raise BagError(
                f"{path}: {inside.sum()} poses of {chosen[0]} while {chosen[1]} was recorded, expected at least "
                f"{FEWEST_SAMPLES}"
            )
        stamps, positions = stamps[inside], positions[inside]
        # differences first: times since 1970 in nanoseconds have more digits than a double
        since = [(of - stamps[0]) * 1e-9 for of in (stamps, series[1][0])]
        force = np.stack([np.interp(*since, column) for column in series[1][1].T], axis=1)
        same = frames[0] == frames[1]
        notes.append(
            f"{path}: {chosen[0]} with {chosen[1]}, "
            + (f"both in frame {frames[0]!r}" if same else f"forces as given in their frame {frames[1]!r}, not rotated "
               f"into the positions' {frames[0]!r}")
        )  # fmt: skip
    demo = demonstrations._demonstration(str(path), (stamps - stamps[0]) * 1e-9, positions, force=force)
    gap = np.diff(demo.t).max(initial=0.0)
    if gap > GAP:
        notes.append(f"{path}: up to {gap:.2f} s without a pose, bridged by a straight line")
    return [demo], notes


def is_bag(path) -> bool:
    """A bag, or a folder that holds bags and nothing else that demonstrations are read from."""
    if not path.is_dir():
        return path.suffix == ".bag"
    kinds = {file.suffix for file in path.rglob("*") if file.suffix in (".bag", ".mat", ".csv", ".npz")}
    return kinds == {".bag"}
