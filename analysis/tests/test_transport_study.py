"""The study of the joint transport: where ways part, what is measured there, and that a missing effect is a MISS."""

import itertools

import numpy as np
import pandas as pd
import pytest

from phri_analysis.errors import DataError
from studies import transport as study


def walk(bend: float, at: float = 2.0, length: float = 4.0) -> pd.DataFrame:
    """Along x at 0.2 m/s, a row every 20 ms; from x = `at` on, dy/dx = `bend`. Forces: 3 N along x, -4 N along y from
    the bend on, 0.5 Nm."""
    x = np.arange(0.0, length, 0.004)
    later = np.maximum(x - at, 0.0)
    zero = np.zeros_like(x)
    return pd.DataFrame({
        "t": x / 0.2, "grasp_x": x, "grasp_y": bend * later, "human_x": zero + 3.0,
        "human_y": np.where(later > 0, -4.0, 0.0), "human_yaw": zero - 0.5, "assistance_x": zero,
        "assistance_y": zero + 2.0, "prediction_x": np.where(x > at, x, np.nan),
    })  # fmt: skip


def test_ways_part_where_they_are_farther_apart_than_the_limit():
    place = study.parting(walk(1.0), walk(0.0))
    # on the diagonal the straight way is |y| away
    np.testing.assert_allclose(place, [[2.1, 0.1]], atol=0.01)
    with pytest.raises(DataError, match="never part"):
        study.parting(walk(0.0), walk(0.0))


def test_window_is_measured_along_the_way():
    window = study.around(walk(1.0), np.array([[2.1, 0.1]]))
    assert window["way"].min() == pytest.approx(-study.AROUND, abs=0.01)
    assert window["way"].max() == pytest.approx(study.AROUND, abs=0.01)
    last = window.iloc[-1]
    assert np.hypot(last["grasp_x"] - 2.1, last["grasp_y"] - 0.1) == pytest.approx(study.AROUND, abs=0.01)


def test_means_are_of_magnitudes():
    window = study.around(walk(0.0), np.array([[2.0, 0.0]]))
    found = study.means(window)
    assert found["human_x"] == pytest.approx(3.0) and found["human_phi"] == pytest.approx(0.5)
    assert found["human_y"] == pytest.approx(2.0, abs=0.03)  # half of the window
    assert found["human_force"] == pytest.approx((3.0 + 5.0) / 2, abs=0.03)
    assert found["late_y"] == pytest.approx(4.0)
    assert found["predicted"] == pytest.approx(0.5, abs=0.01)


def parted(agreement: float, disagreement: float, late: float = 1.0) -> pd.DataFrame:
    """Every component is 10 times a person's factor without assistance, and so many times that with."""
    share = {"no assistance": 1.0, "agreement": agreement, "disagreement": disagreement}
    rows = []
    for (taken, other), condition, person in itertools.product(study.FURCATIONS, study.CONDITIONS, range(4)):
        value = 10.0 * (1 + person / 10) * share[condition]
        late_y = 5.0 * (late if condition == "disagreement" else 1.0)
        rows.append({"taken": taken, "other": other, "condition": condition, "participant": person, "human_x": value,
                     "human_y": value, "human_phi": value, "human_force": value, "late_y": late_y,
                     "assistance_force": 1.0})  # fmt: skip
    return pd.DataFrame(rows)


def test_what_the_thesis_states_is_seen_where_it_is():
    found = study.successes(parted(0.7, 1.3))
    assert all(seen for *_, seen in found) and len(found) == 7
    assert {cases for *_, cases, _ in found} == {4 * len(study.FURCATIONS)}
    changes = {claim: change for claim, change, *_ in found}
    assert changes["torque falls with a successful prediction"] == pytest.approx(-0.3)


@pytest.mark.parametrize("agreement, disagreement, late, missed", [
    (1.1, 1.3, 1.0, 4), (0.95, 1.3, 1.0, 1), (0.7, 0.9, 1.0, 2), (0.7, 1.3, 1.5, 1), (1.1, 0.9, 0.5, 7),
])  # fmt: skip
def test_what_is_not_there_is_a_miss(agreement, disagreement, late, missed):
    _, cells = study.statement_rows(study.successes(parted(agreement, disagreement, late)))
    assert [row[-1] for row in cells].count("MISS") == missed


def test_one_person_alone_shows_nothing():
    table = parted(1.02, 1.3)
    table.loc[(table["participant"] == 0) & (table["condition"] == "agreement"), "human_y"] = 0.1
    line = next(row for row in study.successes(table) if "along y" in row[0])
    assert line[1] < 0 and not line[-1]


def test_nine_trials_compare_the_last_of_each_way():
    rows = [{"condition": condition, "participant": person, "trial": trial,
             "human_force": 8.0 if condition == "assistance" and trial > 6 else 10.0, "human_torque": 1.0}
            for condition in study.ASSISTED for person in range(3) for trial in range(1, 10)]  # fmt: skip
    force, torque = study.learning(pd.DataFrame(rows))
    assert force[1] == pytest.approx(-0.2) and force[2:] == (9, 9, True)
    assert not torque[-1]
