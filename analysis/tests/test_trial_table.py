import numpy as np
import pytest

import synthetic
from phri_analysis import trial_table
from phri_analysis.errors import DataError


def test_conform_orders_columns_and_keeps_every_bit():
    table = synthetic.plausible_trial()
    shuffled = table[list(reversed(table.columns))].assign(extra=1.0)
    shuffled.attrs = table.attrs
    again = trial_table.conform(shuffled)
    assert list(again.columns) == list(trial_table.NAMES)
    assert again.equals(table) and again.attrs == table.attrs
    assert again.to_numpy().tobytes() == table.to_numpy().tobytes()


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda table: table.drop(columns="human_x"), ["human_x", "missing"]),
        (lambda table: table.iloc[:0], ["no rows"]),
        (
            lambda table: table.assign(human_x=np.where(table["t"] == table["t"][5], np.nan, 0.0)),
            ["human_x", "nan", "row 5", "[N]"],
        ),
        (
            lambda table: table.assign(t=table["t"].where(table["t"] != table["t"][9], 0.0)),
            ["t does not rise", "row 9"],
        ),
    ],
)
def test_broken_tables_are_refused_with_the_cause(change, words):
    table = synthetic.constant_trial(ticks=20)
    broken = change(table)
    broken.attrs = table.attrs
    with pytest.raises(DataError) as error:
        trial_table.conform(broken)
    assert all(word in str(error.value) for word in [*words, "participant 1"])


def test_a_missing_participant_is_named():
    table = synthetic.constant_trial(ticks=5)
    table.attrs["participant"] = "seven"
    with pytest.raises(DataError, match="participant is 'seven', expected int"):
        trial_table.conform(table)


def test_predictions_are_distinct_and_end_inside_the_trial():
    # 1 s of ticks, a prediction every 20 ms that looks 0.2 s ahead: those made at 0, 0.02 .. 0.80 s can be checked.
    table = synthetic.predict(synthetic.constant_trial(velocity=(0.1, 0.0)), error=(3e-3, 4e-3))
    rows = trial_table.predictions(table)
    assert len(rows) == 41
    assert rows["prediction_t0"].to_numpy() == pytest.approx(np.arange(41) * 0.02)
    assert rows["error"].to_numpy() == pytest.approx(5e-3)  # 3-4-5 triangle
    assert rows["mahalanobis2"].to_numpy() == pytest.approx(25.0)  # 5 mm at a standard deviation of 1 mm


def test_mahalanobis_distance_equals_the_matrix_formula():
    covariance = np.array([[4e-6, 1.5e-6], [1.5e-6, 2e-6]])
    error = np.array([1e-3, -2e-3])
    rows = trial_table.predictions(synthetic.predict(synthetic.constant_trial(), error, covariance))
    assert rows["mahalanobis2"][0] == pytest.approx(error @ np.linalg.solve(covariance, error))


def test_a_degenerate_belief_holds_nothing():
    rows = trial_table.predictions(synthetic.predict(synthetic.constant_trial(), covariance=np.zeros((2, 2))))
    assert np.isinf(rows["mahalanobis2"]).all()
