"""Reads a recorded trial back into the trial table. The only place of the analysis that knows bags and topics.

`read_trial(bag)` equals the table of the same trial run in process bit for bit: every number is recorded in double
precision, stamps only pair messages up, and the time axis is Tick.t. Messages are decoded by the definitions stored in
the bag itself, so no built message package is needed.

Trap: a recorder that could not keep up leaves holes. Ticks that not every topic has are left out and counted in
attrs["dropped_ticks"] (the measures weigh every tick by its real length); above `MAX_DROPPED` of them the bag is
refused.
"""

import hashlib
import json
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import rosbag
from genpy import DeserializationError, MessageException

from . import trial_table
from .errors import BagError, DataError, MissingInputError

NAMESPACE = "/phri"
MAX_DROPPED = 0.01  # share of ticks; more would shift means by more than participants differ
_UNREADABLE = (
    rosbag.ROSBagException,
    DeserializationError,
    MessageException,
    struct.error,
    EOFError,
    ValueError,
    KeyError,
    RuntimeError,
    IndexError,
)


def _joint_states(message):
    order = [message.name.index("handle_x"), message.name.index("handle_y")]
    return [message.position[i] for i in order] + [message.velocity[i] for i in order]


def _wrench(message):
    return message.wrench.force.x, message.wrench.force.y


def _tick(message):
    return message.t, message.state, message.fault, message.limits, message.tank, message.passivity


# topic -> message type, columns of the trial table, decoder. All at 1 kHz, equal stamps.
_TICK_TOPICS = {
    "experiment_node/tick": ("phri_msgs/Tick", ["t", "state", "fault", "limits", "tank", "passivity"], _tick),
    "joint_states": ("sensor_msgs/JointState", ["x", "y", "vx", "vy"], _joint_states),
    **{
        f"{agent}_wrench": ("geometry_msgs/WrenchStamped", [f"{agent}_x", f"{agent}_y"], _wrench)
        for agent in ("human", "environment", "assistance", "requested")
    },
}


def find_bags(paths) -> list:
    """The bags among files and folders (searched to the bottom), sorted. Raises MissingInputError."""
    found = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = sorted(path.rglob("*.bag"))
            if not inside:
                cut = sorted(path.rglob("*.bag.active"))
                hint = f"; {cut[0].name} was cut off while recording" if cut else ""
                raise MissingInputError(f"{path}: no bag in this folder, expected *.bag{hint}")
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise MissingInputError(f"{path}: no such file or folder, expected a bag or a folder of bags")
    return sorted(set(found))


def checksum(path) -> str:
    """SHA-256 of a file, as `sha256sum` prints it."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def read_trial(path, namespace: str = NAMESPACE) -> pd.DataFrame:
    """Trial table of one bag. Raises MissingInputError when there is no file, BagError for everything that is wrong in
    it."""
    if not Path(path).is_file():
        raise MissingInputError(f"{path}: no such bag")
    try:
        bag = rosbag.Bag(str(path))
    except rosbag.ROSBagUnindexedException:
        raise BagError(
            f"{path}: the bag has no index (the recording was cut off); `rosbag reindex` may repair it"
        ) from None
    except _UNREADABLE as error:
        raise BagError(f"{path}: not a readable ROS bag (truncated, or another format): {error}") from None
    with bag:
        table = _read(bag, str(path), namespace)
    try:
        return trial_table.conform(table)
    except DataError as error:
        raise BagError(f"{path}: {error}") from None


def _messages(bag, topics, path):
    """(topic, message) in recorded order; what rosbag raises on a damaged file becomes a BagError."""
    messages = bag.read_messages(topics=topics)
    while True:
        try:
            topic, message, _ = next(messages)
        except StopIteration:
            return
        except _UNREADABLE as error:
            raise BagError(f"{path}: damaged or truncated inside ({type(error).__name__}: {error})") from None
        yield topic, message


def _read(bag, path, namespace):
    present = {topic: info.msg_type for topic, info in bag.get_type_and_topic_info().topics.items()}
    prefix = f"{namespace}/prediction/"
    prediction_topics = sorted(topic for topic in present if topic.startswith(prefix))
    expected = {f"{namespace}/{name}": entry[0] for name, entry in _TICK_TOPICS.items()}
    expected[f"{namespace}/metadata"] = "std_msgs/String"
    missing = [f"{topic} ({kind})" for topic, kind in expected.items() if topic not in present]
    if missing:
        there = ", ".join(sorted(present)) or "nothing"
        raise BagError(f"{path}: topic {', '.join(missing)} is missing; the bag holds {there}")
    expected.update({topic: "phri_msgs/Prediction" for topic in prediction_topics})
    for topic, kind in expected.items():
        if present[topic] != kind:
            raise BagError(f"{path}: topic {topic} is of type {present[topic]}, expected {kind}")

    stamps = {name: [] for name in _TICK_TOPICS}
    values = {name: [] for name in _TICK_TOPICS}
    metadata, forecasts = None, {topic: [] for topic in prediction_topics}
    for topic, message in _messages(bag, list(expected), path):
        name = topic[len(namespace) + 1 :]
        if name in _TICK_TOPICS:
            try:
                values[name].append(_TICK_TOPICS[name][2](message))
            except (ValueError, IndexError):
                raise BagError(
                    f"{path}: topic {topic}: a message without handle_x and handle_y, their position and velocity; "
                    f"it names {', '.join(message.name) or 'no joint'}"
                ) from None
            stamps[name].append(message.header.stamp.to_nsec())
        elif name == "metadata":
            metadata = message.data
        else:
            forecasts[topic].append(message)

    frames = [_frame(name, stamps[name], values[name], path, namespace) for name in _TICK_TOPICS]
    table = pd.concat(frames, axis=1, join="inner").sort_index()
    ticks = len(pd.Index(np.unique(np.concatenate([frame.index for frame in frames]))))
    dropped = ticks - len(table)
    if dropped > MAX_DROPPED * ticks:
        counts = ", ".join(f"{namespace}/{name} {len(stamps[name])}" for name in _TICK_TOPICS)
        raise BagError(
            f"{path}: {dropped} of {ticks} ticks lack a topic, expected at most {MAX_DROPPED:.0%}; "
            f"messages: {counts}"
        )
    attrs = _attrs(metadata, f"{path}: topic {namespace}/metadata")
    for column, data in _forecast_columns(table.index, *_used(forecasts, attrs, path)).items():
        table[column] = data
    table = table.reset_index(drop=True)
    table.attrs = attrs
    if dropped:
        table.attrs["dropped_ticks"] = dropped
    return table


def _frame(name, stamps, values, path, namespace):
    """One topic as a frame indexed by its stamps [ns]; its numbers checked, so that an error names the topic."""
    columns = _TICK_TOPICS[name][1]
    frame = pd.DataFrame(values, columns=columns, index=np.array(stamps, dtype="int64"))
    topic = f"{path}: topic {namespace}/{name}"
    for column in columns:
        bad = ~np.isfinite(frame[column].to_numpy(dtype="float64"))
        if bad.any():
            row = int(np.argmax(bad))
            raise BagError(
                f"{topic}: {column} is {frame[column].iloc[row]} at {stamps[row] * 1e-9:.3f} s in {bad.sum()} of "
                f"{len(bad)} messages, expected finite numbers"
            )
    if not frame.index.is_unique:
        raise BagError(
            f"{topic}: stamp {frame.index[frame.index.duplicated()][0] * 1e-9:.3f} s comes twice, expected one "
            f"message per tick"
        )
    return frame


def _used(forecasts, attrs, path):
    """(name of the topic, its messages) of the predictions that the controller acted on: of several models the one that
    attribute `model` names."""
    wanted = [topic for topic in forecasts if len(forecasts) == 1 or topic.rsplit("/", 1)[1] == attrs.get("model")]
    if forecasts and not wanted:
        raise BagError(
            f"{path}: attribute model is {attrs.get('model')!r}, expected the model in use among {', '.join(forecasts)}"
        )
    return (f"{path}: topic {wanted[0]}", forecasts[wanted[0]]) if wanted else ("", [])


def _forecast_columns(stamps, topic, messages):
    """The last element of each prediction, from the row whose observation it answers (by stamp) until the next one's.
    An empty one means that the model could not tell; the one before it stays the newest."""
    rows, made = [], []
    for message in messages:
        size, mean, covariance = message.state_size, np.array(message.mean), np.array(message.covariance)
        count = len(mean) // size if size else 0
        if len(mean) == len(covariance) == 0:
            continue
        if size < 2 or len(mean) != count * size or len(covariance) != count * size * size:
            raise BagError(
                f"{topic}: mean has {len(mean)} and covariance {len(covariance)} numbers, expected K*{size}, K*{size}^2"
            )
        position, spread = mean.reshape(count, size)[-1], covariance.reshape(count, size, size)[-1]
        horizon = message.dt * (count - 1)
        row = [message.t0, horizon, position[0], position[1], spread[0, 0], spread[0, 1], spread[1, 1]]
        if not np.isfinite(row).all():
            raise BagError(f"{topic}: a number of the prediction made at {message.t0} s is not finite")
        rows.append(row)
        made.append(message.header.stamp.to_nsec())
    columns = {name: np.full(len(stamps), np.nan) for name in trial_table.PREDICTION}
    if rows:
        order = np.argsort(made, kind="stable")
        newest = np.searchsorted(np.array(made)[order], stamps, side="right") - 1
        known = newest >= 0
        for name, data in zip(trial_table.PREDICTION, np.array(rows)[order].T):
            columns[name][known] = data[newest[known]]
    return columns


def _attrs(metadata, where):
    try:
        attrs = json.loads(metadata)
    except (TypeError, ValueError) as error:
        raise BagError(f"{where}: not JSON ({error})") from None
    if not isinstance(attrs, dict):
        raise BagError(f"{where}: {type(attrs).__name__}, expected an object with the setting of the trial")
    return attrs
