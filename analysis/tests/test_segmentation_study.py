"""The segmentation study: what counts as a hit, its errors, and (where the recordings are) its numbers' range."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from phri_analysis.errors import DataError, MissingInputError

segmentation = pytest.importorskip("studies.segmentation")


def test_each_label_takes_one_cut_and_the_most_are_paired():
    assert segmentation.hits([1.0, 1.1], [1.05], 0.2) == 1
    # the first label must not take the cut that only the second can have
    assert segmentation.hits([0.9, 1.3], [1.0, 1.2], 0.15) == 2
    assert segmentation.hits([1.0], [1.0, 1.05], 0.1) == 1
    assert segmentation.hits([], [1.0], 0.1) == 0


def test_missing_and_wrong_data_are_named(tmp_path, monkeypatch):
    monkeypatch.delenv(segmentation.VARIABLE, raising=False)
    with pytest.raises(MissingInputError, match=segmentation.VARIABLE):
        segmentation.run(SimpleNamespace(out=tmp_path, data=None))
    with pytest.raises(MissingInputError, match="absent"):
        segmentation.read(tmp_path / "absent.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(DataError, match="rim_label_0"):
        segmentation.read(tmp_path / "other.npz")


def test_a_movement_of_three_velocities_is_cut_twice():
    pytest.importorskip("phri_learning")
    velocities = np.repeat([[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, -0.3]], 100, axis=0)
    for found in (segmentation.online(velocities), segmentation.offline(velocities)):
        assert [b.time for b in found] == pytest.approx([5.0, 10.0], abs=24 * segmentation.DT)


@pytest.mark.skipif(segmentation.VARIABLE not in os.environ, reason="the recordings may not be shipped")
def test_recorded_demonstrations_reach_their_aims():
    pytest.importorskip("phri_learning")
    sets = segmentation.read(os.environ[segmentation.VARIABLE])
    rows = segmentation.table({name: sets[name] for name in ("rim", "grating")})
    assert segmentation.f1(rows[rows["set"] == "rim"], "online") >= 0.85
    assert segmentation.f1(rows[rows["set"] == "grating"], "online") >= 0.70
