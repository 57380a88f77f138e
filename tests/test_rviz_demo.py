#!/usr/bin/python3
"""The demo for people, end to end: real nodes, real rviz, marker and panel operated as a person would."""

import pathlib
import subprocess
import sys

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parent.parent
LIMIT = 400.0  # [s]; about 25 s on an idle machine
LEAST_COLORS = 400  # a window that drew nothing has a few


def test_a_person_drags_tunes_and_rates(tmp_path):
    pytest.importorskip("rospy")
    image = pytest.importorskip("PIL.Image")
    rosbag = pytest.importorskip("rosbag")
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "rviz_demo.py"), str(tmp_path)], timeout=LIMIT,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
    session = yaml.safe_load((tmp_path / "session.yaml").read_text())
    assert session["state"] == "complete" and session["human"] == "marker"
    assert not session["simulated_participants"]
    assert [rating["rating"] for rating in session["ratings"]] == [3, 5]
    assert all(bag["completed"] for bag in session["bags"]), "the object did not get to the goal"
    for name in ("waiting", "dragging", "assisted", "rating"):
        with image.open(tmp_path / f"{name}.png") as picture:
            colors = picture.convert("RGB").getcolors(1 << 20)
        assert len(colors) > LEAST_COLORS, name

    with rosbag.Bag(str(tmp_path / session["bags"][1]["file"])) as bag:
        metadata = [yaml.safe_load(m.data) for _, m, _ in bag.read_messages(topics="/phri/metadata")][-1]
        states = [m.state for _, m, _ in bag.read_messages(topics="/phri/experiment_node/state")]
    assert [change["what"] for change in metadata["changes"]] == ["controller = pd", "pd/stiffness = 400"]
    assert not metadata["evaluated"] and session["bags"][1]["changed"], "a switched trial counts for its controller"
    assert "ACTIVE" in states and "IDLE" in states, "the robot assisted, and was stopped"
