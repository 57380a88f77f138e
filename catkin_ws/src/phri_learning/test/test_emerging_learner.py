"""The learner node's part of emerging assistance: learning where it is called, in a thread, again after a restart."""

import sys
import time
from pathlib import Path

import numpy as np
import phri_core
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "nodes"))
emerging_learner = pytest.importorskip("emerging_learner", reason="needs the messages of ROS")

SETTINGS = {"horizon": 0.3, "reference": "path", "time": "entry_corrected", "recognition": "motion", "states": 6,
            "window": 30, "members": 2, "cutoff": 0.6, "window_states": 12, "learning_dt": 0.05, "segment_window": 16,
            "switch_cost": 6.0, "lag": 20, "dt": 0.02, "threaded": False}
PATIENCE = 30.0  # [s] on the wall for a thread


def squares(count):
    """Laps (T, 6) around a square at 0.05 m/s, with a stop at each corner and a little variation."""
    random = np.random.default_rng(3)
    corners = np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]])
    laps = []
    for _ in range(count):
        places = []
        for a, b in zip(corners[:-1], corners[1:]):
            u = np.linspace(0, 1, 100)[:, None]
            places.append(a + (b - a) * (3 * u**2 - 2 * u**3) + random.normal(0, 0.001, 2) * np.sin(np.pi * u))
        x = np.vstack(places)
        v = np.gradient(x, SETTINGS["dt"], axis=0)
        laps.append(np.hstack([x, v, 90 * v]))
    return laps


def go_through(model, lap, until=None):
    """The predicted end points of a lap."""
    model.reset()
    ends = []
    for index, row in enumerate(lap[:until]):
        model.observe(phri_core.Observation(index * 20_000_000 * 1e-9, row[:4], row[4:], np.zeros(2)))
        belief = model.predict(0.3, 0.02)
        ends.append(belief.desired_state[-1].mean if belief else np.full(4, np.nan))
        model.study()
    return np.array(ends)


def refuse(error):
    raise AssertionError(error)


def test_a_restarted_learner_predicts_as_if_nothing_had_happened():
    laps = squares(6)
    whole = emerging_learner.Emerging(SETTINGS, [], lambda known: None, refuse)
    for lap in laps[:-1]:
        go_through(whole, lap)
    assert whole.primitives > 0
    again = emerging_learner.Emerging(SETTINGS, laps[:-1], lambda known: None, refuse)
    first, second = go_through(whole, laps[-1]), go_through(again, laps[-1])
    assert np.isfinite(first).any()
    np.testing.assert_array_equal(first, second)


def test_a_thread_learns_the_same_while_predictions_go_on():
    laps, seen = squares(5), []
    here = emerging_learner.Emerging(SETTINGS, laps, lambda known: None, refuse)
    here.reset()
    there = emerging_learner.Emerging({**SETTINGS, "threaded": True}, [], seen.append, refuse)
    for lap in laps:
        go_through(there, lap)
    there.reset()
    expected = here.learner.snapshot.library.segment_count
    end = time.monotonic() + PATIENCE
    while seen[-1].library.segment_count < expected:
        assert time.monotonic() < end, "the thread is late"
        time.sleep(0.02)
    assert np.isfinite(go_through(there, laps[0])).any()  # and it is used
    there.end()
    # segmentation does not depend on what is known, so neither does what is learned
    assert seen[-1].nodes == here.learner.snapshot.nodes
    expected = here.learner.snapshot.library
    for node in seen[-1].nodes:
        np.testing.assert_array_equal(seen[-1].library.node(node).output, expected.node(node).output)


def test_the_tree_names_every_node_once():
    model = emerging_learner.Emerging(SETTINGS, squares(5), lambda known: None, refuse)
    library = model.learner.snapshot.library
    markers = emerging_learner.tree(model.learner.snapshot).markers
    first, *numbers = [m.text for m in markers if m.ns == "primitives"]
    assert first == f"{library.node(0).count} segments seen"
    assert numbers == [str(node) for node in library.upper_nodes]
    lines = [line for m in markers if m.ns == "primitive tree" for line in m.text.split("\n")]
    assert sorted(int(line.partition(":")[0]) for line in lines) == sorted(set(library.node_ids) - {0})
    paths = [m for m in markers if m.points]
    assert len(paths) == len(library.upper_nodes) > 0
    for path, node in zip(paths, library.upper_nodes):
        np.testing.assert_array_equal([[p.x, p.y] for p in path.points], library.node(node).output[:, :2])
    assert all(m.header.frame_id == "maze" for m in markers)
