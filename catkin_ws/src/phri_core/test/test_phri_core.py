#!/usr/bin/python3
"""The Python face of phri_core: sizes are checked where numpy meets stack-sized vectors."""

import numpy as np
import phri_core
import pytest


def test_admittance_reaches_the_steady_speed():
    admittance = phri_core.Admittance([90.0, 90.0], [200.0, 200.0], 0.001)
    for _ in range(10000):
        admittance.step([10.0, 0.0])
    assert admittance.velocity == pytest.approx([0.05, 0.0], abs=1e-9)  # u / D


def test_sizes_are_checked():
    admittance = phri_core.Admittance([90.0, 90.0], [200.0, 200.0], 0.001)
    with pytest.raises(ValueError, match="wrench has 3 elements: expected 2"):
        admittance.step(np.ones(3))
    with pytest.raises(ValueError, match="mass has 7 elements: expected at most 6"):
        phri_core.Admittance(np.ones(7), np.ones(2), 0.001)
    observation = phri_core.Observation(0.0, np.zeros(4), np.zeros(2))
    with pytest.raises(ValueError, match="state has 13 elements"):
        observation.state = np.zeros(13)


def test_random_streams_are_seeded():
    first, again, other = (phri_core.Random.stream(7, name) for name in ("plan", "plan", "noise"))
    numbers = [first.normal() for _ in range(5)]
    assert numbers == [again.normal() for _ in range(5)]
    assert numbers != [other.normal() for _ in range(5)]


def test_names_of_limits_and_states():
    assert phri_core.limit_names()[3] == "power"
    assert set(phri_core.assistance_limits()) <= set(phri_core.limit_names())
    assert phri_core.state_names() == ["INIT", "IDLE", "PASSIVE", "ACTIVE", "FAULT"]
    assert phri_core.fault_name(1) == "E_WRENCH_STALE"


def test_prediction_lists_round_trip():
    prediction = phri_core.Prediction()
    prediction.desired_state = [phri_core.Gaussian(np.arange(4.0), np.eye(4))]
    assert prediction.desired_state[0].mean == pytest.approx([0, 1, 2, 3])
