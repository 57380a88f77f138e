"""Writes a trial table as a bag, the way the ROS shell records it, so that reading it back can be compared bit for bit.

Message classes come from the .msg files of phri_msgs; nothing needs to be built.
"""

import io
import json
import struct
import zlib
from pathlib import Path

import genpy
import numpy as np
import pytest
import rosbag
from genpy.dynamic import generate_dynamic
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import JointState
from std_msgs.msg import String

MESSAGES = Path(__file__).resolve().parents[2] / "catkin_ws" / "src" / "phri_msgs" / "msg"
HEADER = "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
HORIZON_STEPS = 10  # 0.2 s in steps of 0.02 s, as the experiments have it


def message_class(name):
    path = MESSAGES / f"{name}.msg"
    if not path.is_file():
        pytest.skip(f"phri_msgs/{name} is not defined yet")
    return generate_dynamic(f"phri_msgs/{name}", f"{path.read_text()}\n{HEADER}")[f"phri_msgs/{name}"]


def _stamp(t):
    return genpy.Time(1, round(t * 1e9))  # the session began before the trial


def _stamped(message, stamp):
    message.header.stamp = stamp
    return message


def _wrench(table, agent, i, stamp):
    message = _stamped(WrenchStamped(), stamp)
    message.wrench.force.x, message.wrench.force.y = table[f"{agent}_x"][i], table[f"{agent}_y"][i]
    return message


def _joints(row):
    names, position, velocity = ["handle_x", "handle_y"], [row["x"], row["y"]], [row["vx"], row["vy"]]
    return JointState(name=names, position=position, velocity=velocity)


def _prediction(cls, row, model, stamp):
    steps = HORIZON_STEPS + 1
    mean, covariance = np.zeros((steps, 4)), np.tile(np.eye(4), (steps, 1, 1))
    mean[-1, :2] = row["prediction_x"], row["prediction_y"]
    covariance[-1, :2, :2] = [
        [row["prediction_xx"], row["prediction_xy"]],
        [row["prediction_xy"], row["prediction_yy"]],
    ]
    return _stamped(
        cls(
            t0=row["prediction_t0"],
            dt=row["prediction_horizon"] / HORIZON_STEPS,
            mean=mean.ravel().tolist(),
            covariance=covariance.ravel().tolist(),
            state_size=4,
            model=model,
        ),
        stamp,
    )


def _grid(description):
    message = OccupancyGrid(data=[100 * (cell == "#") for row in description["grid"] for cell in row])
    message.info.width, message.info.height = len(description["grid"][0]), len(description["grid"])
    message.info.resolution = description["resolution"]
    message.info.origin.position.x, message.info.origin.position.y = description["origin"]
    return message


class Digest:
    """The recorder's digests made once more by their definition (phri_sim/ros/bag_digest.hpp), all bytes of a stretch
    at once."""

    def __init__(self):
        self.bytes, self.counts, self.messages, self.number = {}, {}, 0, 0

    def add(self, topic, message, stamp):
        buffer = io.BytesIO()
        message.serialize(buffer)
        data = buffer.getvalue()
        start = "\0".join([topic, message._type, message._md5sum, message._full_text, ""]).encode()
        self.bytes.setdefault(topic, bytearray(start))
        self.bytes[topic] += struct.pack("<III", stamp.secs, stamp.nsecs, len(data)) + data
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.messages += 1

    def take(self, stamp, final):
        topics = {name: [self.counts[name], f"{zlib.crc32(data):08x}"] for name, data in self.bytes.items()}
        body = {"final": final, "messages": self.messages, "number": self.number, "time_ns": stamp.to_nsec(),
                "topics": topics, "version": 1}
        text = json.dumps(body, separators=(",", ":"))[:-1]
        self.bytes, self.counts, self.number = {}, {}, self.number + 1
        return String(f'{text},"crc32":"{zlib.crc32(text.encode()):08x}"}}')


def write_bag(table, path, omit=(), drop=(), model="time_hmm", metadata=None, change=None, compression="lz4",
              chunk=16384, digest_every=500):
    """`omit`: topics left out; `drop`: (topic, row) pairs that the recorder lost; `change(topic, row, message)`
    tampers; a digest after every `digest_every` rows and at the end, none if 0."""
    tick, prediction = message_class("Tick"), message_class("Prediction")
    lost, digest = set(drop), Digest()
    attrs = {name: value for name, value in table.attrs.items() if name != "map"}
    safety = [name for name in ("t", "state", "fault", "limits", "tank", "passivity", "lateness") if name in table]
    with rosbag.Bag(str(path), "w", compression=compression, chunk_threshold=chunk) as bag:

        def put(topic, row, message, stamp):
            if topic not in omit and (topic, row) not in lost:
                message = message if change is None else change(topic, row, message)
                digest.add("/phri/" + topic, message, stamp)
                bag.write("/phri/" + topic, message, stamp)

        put("metadata", 0, String(json.dumps(attrs) if metadata is None else metadata), _stamp(0.0))
        if "map" in table.attrs:
            put("map", 0, _grid(table.attrs["map"]), _stamp(0.0))
        made = np.nan
        for i, row in enumerate(table.to_dict("records")):
            stamp = _stamp(row["t"])
            put("experiment_node/tick", i, _stamped(tick(**{name: row[name] for name in safety}), stamp), stamp)
            put("joint_states", i, _stamped(_joints(row), stamp), stamp)
            for agent in ("human", "environment", "assistance", "requested"):
                put(f"{agent}_wrench", i, _wrench(table, agent, i, stamp), stamp)
            if row["prediction_t0"] == row["prediction_t0"] and row["prediction_t0"] != made:
                made = row["prediction_t0"]
                put(f"prediction/{model}", i, _prediction(prediction, row, model, stamp), stamp)
            if digest_every and (i + 1) % digest_every == 0:
                bag.write("/phri/digest", digest.take(stamp, False), stamp)
        if digest_every:
            bag.write("/phri/digest", digest.take(stamp, True), stamp)
    return path
