"""The study of emerging assistance: what it compares, and that it says so when a trend is missing."""

import numpy as np
import pandas as pd
import pytest

from phri_analysis.errors import DataError
from studies import emerging_assistance as study

OFF = [16, 17, 18]


def table(assisted_force=2.0, alone_force=4.0, people=6, condition="paced"):
    """Force `alone_force` in the first three repetitions and without assistance, else `assisted_force`; person p has
    1 + p / 10 times as much; the error falls from 9 mm by 0.3 mm per repetition."""
    rows = []
    for person in range(people):
        for trial in range(1, 21):
            alone = trial <= 3 or trial in OFF
            rows.append({
                "condition": condition, "participant": person, "trial": trial, "assisted": trial not in OFF,
                "prediction_error": np.nan if trial <= 3 else 9e-3 - 3e-4 * trial,
                "human_force": (alone_force if alone else assisted_force) * (1 + person / 10),
                "completion_time": 25.0 if alone else 20.0, "predicted": 0.9 if trial > 3 else 0.0, "primitives": 5,
            })  # fmt: skip
    return pd.DataFrame(rows)


def test_ratio_is_of_the_repetitions_without_assistance_over_their_neighbours():
    rows = table()
    # far from the ones without assistance nothing counts
    rows.loc[rows["trial"].between(4, 12), "human_force"] = 1e6
    compared = study.ratios(rows, OFF, 20)
    np.testing.assert_allclose(compared["human_force_off_over_on"], 2.0)  # whatever the person's own level
    np.testing.assert_allclose(compared["completion_time_off_over_on"], 1.25)
    assert study.neighbours(OFF, 20) == ([13, 14, 15], [19, 20])
    assert study.neighbours([2], 3) == ([1], [3])


@pytest.mark.parametrize("off, trials", [([], 20), ([16, 18], 20), ([1, 2], 20), ([19, 20], 20)])
def test_without_neighbours_there_is_nothing_to_compare(off, trials):
    with pytest.raises(DataError, match="assistance_off is"):
        study.neighbours(off, trials)


def test_trends_are_seen_where_they_are():
    rows = pd.concat([table(condition=name) for name in study.CONDITIONS])
    found = study.trends(study.ratios(rows, OFF, 20)) + study.learning_trend(rows)
    assert len(found) == 9 and all(seen for *_, seen in found)
    assert {row[2] for row in found} == {6}


def test_a_missing_trend_is_a_miss():
    rows = pd.concat([table(assisted_force=4.0, condition=name) for name in study.CONDITIONS])
    rows["prediction_error"] = rows["trial"].map(lambda trial: np.nan if trial <= 3 else 1e-3 * trial)
    rows["completion_time"] = 20.0
    found = study.trends(study.ratios(rows, OFF, 20)) + study.learning_trend(rows)
    _, cells = study.trend_rows(found)
    missed = [row[1] for row in cells if row[-1] == "MISS"]
    assert len(missed) == len(cells) - 1  # force is equal throughout: so it is "recovered"
    assert [row[-1] for row in cells if "recovered" in row[1]] == ["seen"]


def test_a_mean_that_one_person_makes_is_a_miss():
    rows = table(assisted_force=4.1)
    rows.loc[(rows["participant"] == 0) & ~rows["trial"].isin(OFF), "human_force"] = 0.1
    rows.loc[(rows["participant"] == 0) & (rows["trial"] <= 3), "human_force"] = 40.0
    compared = study.ratios(rows, OFF, 20)
    claim = next(row for row in study.trends(compared) if row[1] == "force rises when assistance is off")
    assert claim[2] == 1 and claim[4] > 0 and not claim[5]


def test_the_simulated_study_has_a_row_per_repetition_and_is_the_same_again():
    pytest.importorskip("phri_sim", reason="the workspace is not built")
    rows, experiment = study.measure(2, 1, False, {"self-paced": 0.0}, trials=3)
    assert list(rows["trial"]) == [1, 2, 3] * 2 and rows["completed"].all()
    assert experiment.assistance_off == OFF
    assert rows[rows["trial"] == 1]["prediction_error"].isna().all()  # nothing learned, nothing predicted
    assert (rows[rows["trial"] == 3]["primitives"] > 0).all()
    again, _ = study.measure(2, 2, False, {"self-paced": 0.0}, trials=3)
    pd.testing.assert_frame_equal(rows, again)
