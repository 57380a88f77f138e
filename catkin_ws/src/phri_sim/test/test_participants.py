#!/usr/bin/python3
"""Simulated participants from Python: one trial without a model, one person without a robot."""

import numpy as np
import phri_sim
import pytest


@pytest.fixture(scope="module")
def experiment():
    return phri_sim.Experiment("maze_assistance", {"controllers": ["none"]})


def quiet():
    person = phri_sim.Participant()
    person.force_variation = person.force_noise = person.tremor = person.wander = 0.0
    return person


def test_a_trial_alone_is_the_third_of_its_block(experiment):
    """Under condition (a) a model predicts and nobody assists: the movement and all forces are the same to the last
    bit. Only the loop knows that it has a policy (state)."""
    block = phri_sim.schedule(experiment, 1, 3, 7)[0]
    last = phri_sim.run_block(experiment, block)[-1]
    alone = phri_sim.run_alone(experiment, block.trials[-1])
    predictions = [name for name in last.columns if name.startswith("prediction_")]
    assert alone.drop(columns=[*predictions, "state"]).equals(last.drop(columns=[*predictions, "state"]))
    assert alone[predictions].isna().all().all() and not last[predictions].isna().all().any()
    assert alone.attrs == last.attrs


def test_traits_are_those_of_the_population(experiment):
    changed = phri_sim.Experiment("maze_assistance", {"override/participants/speed/median": 0.06})
    medians = [{t.key: t.median for t in e.traits}["speed"] for e in (experiment, changed)]
    assert medians == [0.075, 0.06]
    # common random numbers: the same person, slower by the same factor
    assert changed.person(7, 4).speed == pytest.approx(0.06 / 0.075 * experiment.person(7, 4).speed, rel=1e-12)
    for index in range(50):
        person = experiment.person(11, index)
        assert all(trait.low <= getattr(person, trait.key) <= trait.high for trait in experiment.traits)


def test_a_person_alone_is_still_where_he_or_she_wants_to_be_and_a_spring_elsewhere(experiment):
    person = quiet()
    human = phri_sim.HumanPartner(experiment, person, 100, 90.0, 200.0, 1)
    home, still = np.array(human.intended_position), np.zeros(2)
    assert np.all(human.step(0.0, home, still) == 0.0)
    # the intrinsic half of the stiffness answers in the first millisecond: strong axis y, weak axis x
    for axis, stiffness in ((1, person.stiffness), (0, person.stiffness_ratio * person.stiffness)):
        away = home + 0.01 * np.eye(2)[axis]
        human = phri_sim.HumanPartner(experiment, person, 100, 90.0, 200.0, 1)
        expected = -0.5 * stiffness * 0.01 * np.eye(2)[axis]
        assert human.step(0.0, away, still) == pytest.approx(expected, abs=1e-6)


def test_a_person_starts_to_move_when_the_reaction_time_is_over(experiment):
    human = phri_sim.HumanPartner(experiment, quiet(), 2, 90.0, 200.0, 1)
    home, moved = np.array(human.intended_position), None
    for k in range(600):
        human.step(1e-3 * k, home, np.zeros(2))
        if moved is None and not np.array_equal(human.intended_position, home):
            moved = k
    assert moved is not None and 300 <= moved <= 302
