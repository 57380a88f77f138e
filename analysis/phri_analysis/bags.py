"""Reads a recorded trial back into the trial table. The only place of the analysis that knows topics and messages.

`read_trial(bag)` equals the table of the same trial run in process bit for bit: every number is recorded in double
precision, stamps only pair messages up, and the time axis is Tick.t. First the whole bag is verified (`bag_check`),
then messages are decoded by the definitions stored in the bag itself, with ROS's genpy, or without ROS with the package
`rosbags` (pip install phri-analysis[noros]); no message package needs to be built.

Trap: a recorder that could not keep up leaves holes. Ticks that not every topic has are left out and counted in
attrs["dropped_ticks"] (the measures weigh every tick by its real length); above `MAX_DROPPED` of them the bag is
refused.
"""

import functools
import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd

try:
    from genpy.dynamic import generate_dynamic
except ImportError:
    generate_dynamic = None

from . import bag_check, trial_table
from .errors import BagError, DataError, MissingInputError

NAMESPACE = "/phri"
MAX_DROPPED = 0.01  # share of ticks; more would shift means by more than participants differ


def _joint_states(message):
    order = [message.name.index("handle_x"), message.name.index("handle_y")]
    return [message.position[i] for i in order] + [message.velocity[i] for i in order]


def _wrench(message):
    return message.wrench.force.x, message.wrench.force.y


def _tick(message):
    # bags of before the field existed have no lateness
    lateness = getattr(message, "lateness", np.nan)
    return message.t, message.state, message.fault, message.limits, message.tank, message.passivity, lateness


# topic -> message type, columns of the trial table, decoder. All at 1 kHz, equal stamps.
_TICK_TOPICS = {
    "experiment_node/tick": (
        "phri_msgs/Tick",
        ["t", "state", "fault", "limits", "tank", "passivity", "lateness"],
        _tick,
    ),
    "joint_states": ("sensor_msgs/JointState", ["x", "y", "vx", "vy"], _joint_states),
    **{
        f"{agent}_wrench": ("geometry_msgs/WrenchStamped", [f"{agent}_x", f"{agent}_y"], _wrench)
        for agent in ("human", "environment", "assistance", "requested")
    },
}


def find_bags(paths) -> list:
    """The bags among files and folders (searched to the bottom), sorted. Of a folder only complete recordings:
    `*.recovered.bag` must be named, for the trial may have been repeated. Raises MissingInputError."""
    found = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = sorted(bag for bag in path.rglob("*.bag") if not bag.name.endswith(".recovered.bag"))
            if not inside:
                cut = sorted(path.rglob("*.bag.active"))
                hint = f"; {cut[0].name} was cut off while recording (phri-analysis recover)" if cut else ""
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
    """Trial table of one bag. Real-time trials have a column more, `lateness` [s], where it was recorded; a recovered
    bag is marked by attribute `recovered`. Raises MissingInputError when there is no file, BagError for everything that
    is wrong in it."""
    messages, notes = bag_check.read_verified(path)
    table = _read(messages, str(path), namespace)
    if "recovered_from" in notes:
        table.attrs["recovered"] = True
    try:
        return trial_table.conform(table)
    except DataError as error:
        raise BagError(f"{path}: {error}") from None


@functools.lru_cache(maxsize=256)
def _decoder(connection):
    """(bytes -> message, stamp of a message -> ns) for one definition."""
    if generate_dynamic:
        cls = generate_dynamic(connection.type, connection.definition)[connection.type]
        return (lambda data: cls().deserialize(data)), (lambda stamp: stamp.to_nsec())
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MissingInputError(
            "reading bags needs ROS's genpy or the package rosbags: pip install phri-analysis[noros]"
        ) from None
    store = get_typestore(Stores.EMPTY)
    name = connection.type.replace("/", "/msg/")
    store.register(get_types_from_msg(connection.definition, name))
    return (lambda data: store.deserialize_ros1(data, name)), (lambda stamp: stamp.sec * 10**9 + stamp.nanosec)


def decoded(message, path):
    """(message, its stamp in ns or None)."""
    try:
        decode, to_ns = _decoder(message.connection)
        content = decode(message.data)
        header = getattr(content, "header", None)
        return content, header and to_ns(header.stamp)
    except MissingInputError:
        raise
    except Exception as error:  # whatever a generated decoder makes of bytes that are not what the definition says
        raise BagError(
            f"{path}: topic {message.connection.topic}: a message at {message.time * 1e-9:.3f} s cannot be decoded "
            f"({type(error).__name__}: {error})"
        ) from None


def _read(messages, path, namespace):
    present = {message.connection.topic: message.connection.type for message in messages}
    prefix = f"{namespace}/prediction/"
    prediction_topics = sorted(topic for topic in present if topic.startswith(prefix))
    expected = {f"{namespace}/{name}": entry[0] for name, entry in _TICK_TOPICS.items()}
    expected[f"{namespace}/metadata"] = "std_msgs/String"
    missing = [f"{topic} ({kind})" for topic, kind in expected.items() if topic not in present]
    if missing:
        there = ", ".join(sorted(present)) or "nothing"
        raise BagError(f"{path}: topic {', '.join(missing)} is missing; the bag holds {there}")
    expected.update({topic: "phri_msgs/Prediction" for topic in prediction_topics})
    if f"{namespace}/map" in present:
        expected[f"{namespace}/map"] = "nav_msgs/OccupancyGrid"
    for topic, kind in expected.items():
        if present[topic] != kind:
            raise BagError(f"{path}: topic {topic} is of type {present[topic]}, expected {kind}")

    stamps = {name: [] for name in _TICK_TOPICS}
    values = {name: [] for name in _TICK_TOPICS}
    metadata, grid, forecasts = None, None, {topic: [] for topic in prediction_topics}
    for recorded in messages:
        topic = recorded.connection.topic
        if topic not in expected:
            continue
        message, stamp = decoded(recorded, path)
        name = topic[len(namespace) + 1 :]
        if name in _TICK_TOPICS:
            try:
                values[name].append(_TICK_TOPICS[name][2](message))
            except (ValueError, IndexError):
                raise BagError(
                    f"{path}: topic {topic}: a message without handle_x and handle_y, their position and velocity; "
                    f"it names {', '.join(message.name) or 'no joint'}"
                ) from None
            stamps[name].append(stamp)
        elif name == "metadata":
            metadata = message.data
        elif name == "map":
            grid = message
        else:
            forecasts[topic].append((stamp, message))

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
    if grid is not None:
        attrs["map"] = _map(grid, f"{path}: topic {namespace}/map")
    if attrs.get("clock") != "realtime" or table["lateness"].isna().any():
        del table["lateness"]
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
        if bad.any() and column != "lateness":
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
    for stamp, message in messages:
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
        made.append(stamp)
    columns = {name: np.full(len(stamps), np.nan) for name in trial_table.PREDICTION}
    if rows:
        order = np.argsort(made, kind="stable")
        newest = np.searchsorted(np.array(made)[order], stamps, side="right") - 1
        known = newest >= 0
        for name, data in zip(trial_table.PREDICTION, np.array(rows)[order].T):
            columns[name][known] = data[newest[known]]
    return columns


def _map(grid, where):
    """The walls as text: `grid` is a list of rows from the bottom, "#" where wall, "." where free."""
    info, cells = grid.info, np.asarray(grid.data, dtype="int8")
    if len(cells) != info.width * info.height:
        raise BagError(f"{where}: {len(cells)} cells, expected {info.width} x {info.height}")
    walls = np.where(cells.reshape(info.height, info.width) > 50, b"#", b".")
    return {
        "grid": [row.tobytes().decode() for row in walls],
        "resolution": float(info.resolution),
        "origin": [info.origin.position.x, info.origin.position.y],
    }


def _attrs(metadata, where):
    try:
        attrs = json.loads(metadata)
    except (TypeError, ValueError) as error:
        raise BagError(f"{where}: not JSON ({error})") from None
    if not isinstance(attrs, dict):
        raise BagError(f"{where}: {type(attrs).__name__}, expected an object with the setting of the trial")
    return attrs
