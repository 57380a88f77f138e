"""Writes a trial table as a bag, the way the ROS shell records it, so that reading it back can be compared bit for bit.

Message classes come from the .msg files of phri_msgs; nothing needs to be built.
"""

import json
from pathlib import Path

import genpy
import numpy as np
import pytest
import rosbag
from genpy.dynamic import generate_dynamic
from geometry_msgs.msg import WrenchStamped
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


def write_bag(table, path, omit=(), drop=(), model="time_hmm", metadata=None, change=None):
    """`omit`: topics left out; `drop`: (topic, row) pairs that the recorder lost; `change(topic, row, message)`
    tampers."""
    tick, prediction = message_class("Tick"), message_class("Prediction")
    lost = set(drop)
    with rosbag.Bag(str(path), "w", compression="lz4") as bag:

        def put(topic, row, message, stamp):
            if topic not in omit and (topic, row) not in lost:
                bag.write("/phri/" + topic, message if change is None else change(topic, row, message), stamp)

        put("metadata", 0, String(json.dumps(table.attrs) if metadata is None else metadata), _stamp(0.0))
        made = np.nan
        for i, row in enumerate(table.to_dict("records")):
            stamp = _stamp(row["t"])
            safety = {name: row[name] for name in ("t", "state", "fault", "limits", "tank", "passivity")}
            put("experiment_node/tick", i, _stamped(tick(**safety), stamp), stamp)
            put("joint_states", i, _stamped(_joints(row), stamp), stamp)
            for agent in ("human", "environment", "assistance", "requested"):
                put(f"{agent}_wrench", i, _wrench(table, agent, i, stamp), stamp)
            if row["prediction_t0"] == row["prediction_t0"] and row["prediction_t0"] != made:
                made = row["prediction_t0"]
                put(f"prediction/{model}", i, _prediction(prediction, row, model, stamp), stamp)
    return path
