#!/usr/bin/python3
"""The Python face of phri_sim: tables, seeds, overrides and errors."""

import copy

import numpy as np
import phri_learning
import phri_sim
import pytest

COLUMNS = (
    "t x y vx vy human_x human_y environment_x environment_y assistance_x assistance_y requested_x requested_y state "
    "fault limits tank passivity prediction_t0 prediction_horizon prediction_x prediction_y prediction_xx "
    "prediction_xy prediction_yy"
).split()


@pytest.fixture(scope="module")
def experiment():
    return phri_sim.Experiment("maze_assistance")


@pytest.fixture(scope="module")
def table(experiment):
    return phri_sim.run_trial(experiment, controller="mahalanobis", participant=0, seed=7)


def test_the_table_of_a_trial(table):
    assert list(table.columns) == COLUMNS
    assert np.diff(table.t) == pytest.approx(0.001, abs=1e-12)
    assert table.attrs["evaluated"] and table.attrs["completed"] and table.attrs["trial"] == 3
    assert table.attrs["simulated_participants"] is True
    assert (table.prediction_t0.dropna() <= table.t[table.prediction_t0.notna()] + 1e-12).all()
    assert (table.state == 3).mean() > 0.5, "the assistance was hardly ever active"


def test_it_ends_at_the_goal(table):
    assert np.hypot(table.x.iloc[-1] - table.attrs["goal"][0], table.y.iloc[-1] - table.attrs["goal"][1]) < 0.0065


def test_a_block_gives_the_same_as_its_last_trial(experiment):
    block = phri_sim.schedule(experiment, 1, 3, 7)[0]  # before a later block the person would have practised
    alone = phri_sim.run_trial(experiment, controller=block.controller, participant=0, seed=7)
    assert phri_sim.run_block(experiment, block)[-1].equals(alone)


def test_blocks_survive_the_way_to_another_process(experiment):
    for block in phri_sim.schedule(experiment, 2, 3, 7):
        twin = copy.deepcopy(block)  # the way of pickling, without pickle
        assert [t.seed for t in twin.trials] == [t.seed for t in block.trials]
        assert [t.practice for t in twin.trials] == [t.practice for t in block.trials]


def test_seeds_decide(experiment):
    first, again, other = (phri_sim.run_trial(experiment, participant=1, seed=s, trial=1) for s in (1, 1, 2))
    assert first.equals(again)
    assert not first.equals(other)


def test_demonstrations_are_every_twentieth_row(table):
    demonstration = phri_sim.demonstration(table)
    assert demonstration.shape == (int(np.ceil(len(table) / 20)), 6)
    assert (demonstration[1] == table[["x", "y", "vx", "vy", "human_x", "human_y"]].iloc[20]).all()


def test_shrinkage_keeps_two_demonstrations_from_being_learned_by_heart(experiment, record_property):
    """Predicting people's third trial from two, 0.2 s ahead: 40 states with plain Baum-Welch learn which demonstration
    they saw. The numbers go to the JUnit file, from where docs/decisions.md has them."""
    errors = {}
    for shrinkage in (0.0, 1.0):
        distances, inside = [], []
        for person in range(8):
            spec = [b for b in phri_sim.schedule(experiment, person + 1, 3, 7) if b.participant == person][0]
            *taught, unseen = [phri_sim.demonstration(t) for t in phri_sim.run_block(experiment, spec)]
            model = phri_learning.TimeHmm(40, dt=0.02, shrinkage=shrinkage).fit(taught)
            for k in range(30, len(unseen) - 10, 5):
                mean, covariance = model.predict(unseen[k - 30:k + 1], 0.2, reference="path", time="entry_corrected")
                off = unseen[k + 10, :2] - mean[:2]
                distances.append(np.hypot(*off))
                inside.append(off @ np.linalg.solve(covariance[:2, :2], off) < 5.991)
        errors[shrinkage] = np.mean(distances)
        record_property(f"shrinkage_{shrinkage:g}", f"{1e3 * np.mean(distances):.1f} mm, {np.mean(inside):.1%} inside")
    assert errors[1.0] < errors[0.0]


def test_overrides_and_errors():
    assert phri_sim.Experiment("maze_assistance", {"trials": 5}).trials == 5
    assert phri_sim.Experiment("maze_assistance", {"controllers": ["pd"], "timeout": 30.5}).controllers == ["pd"]
    with pytest.raises(ValueError, match="trials = true: expected a whole number"):
        phri_sim.Experiment("maze_assistance", {"trials": True})
    with pytest.raises(ValueError, match="did you mean model/states"):
        phri_sim.Experiment("maze_assistance", {"model/state": 5.0})
    with pytest.raises(ValueError, match="known: .*maze_assistance"):
        phri_sim.Experiment("maze_asistance")
    with pytest.raises(ValueError, match="did you mean"):
        phri_sim.run_trial("maze_assistance", controller="mahalanobi", trial=1)


def test_every_parameter_has_a_unit_and_a_range():
    reference = phri_sim.parameter_reference()
    rows = [line.split(" | ") for line in reference.splitlines() if line.startswith("| `")]
    assert len(rows) > 80
    assert all(row[-1].strip(" |") for row in rows), "a parameter without a meaning"
