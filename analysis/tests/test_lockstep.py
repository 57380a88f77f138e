"""The real simulation against the contract of the trial table; skipped where the workspace is not built."""

import json
import math

import numpy as np
import pytest

import bag_writer
from phri_analysis import bags, metrics, simulate, study, trial_table

phri_sim = pytest.importorskip("phri_sim", reason="the workspace is not built")
EXPERIMENT = "maze_assistance"


def test_the_table_keeps_the_contract():
    # Without assistance, so that nothing but the contract decides.
    table = trial_table.conform(phri_sim.run_trial(EXPERIMENT, controller="none", participant=0, seed=7))
    assert json.loads(json.dumps(table.attrs)) == table.attrs  # the bag carries the attributes as JSON
    assert table.attrs["simulated_participants"] is True
    assert np.diff(table["t"]) == pytest.approx(1e-3)
    known = table["prediction_t0"].notna()
    assert (table["prediction_t0"][known] <= table["t"][known] + 1e-9).all()
    rows = {row["subtask"]: row for row in metrics.evaluate(table)}
    assert table.attrs["completed"] and math.isfinite(rows["whole"]["completion_time"])
    assert 0 < rows["MO"]["completion_time"] < rows["whole"]["completion_time"]
    finite = set(metrics.MEASURES) - {"contact_force", "tracking_rmse"}
    assert all(math.isfinite(rows["whole"][name]) for name in finite)


def test_a_bag_of_it_reads_back_bit_for_bit(tmp_path):
    # The whole way: what the tick recorded, through messages on a disk, to the same measures.
    table = trial_table.conform(phri_sim.run_trial(EXPERIMENT, controller="lqr", participant=0, seed=7))
    read = bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag"))
    for name in table.columns:
        assert read[name].to_numpy().tobytes() == table[name].to_numpy().tobytes(), name
    assert study.study_table([read]).equals(study.study_table([table]))


def test_a_study_is_the_same_to_the_byte_for_one_seed(tmp_path):
    request = simulate.Request(EXPERIMENT, participants=1, trials=2, controllers=("none", "mahalanobis"), seed=7)
    for name, jobs in (("one", 1), ("two", 2)):
        study.write_table(simulate.simulate(request, jobs, progress=False).table(), tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
