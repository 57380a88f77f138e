"""Repeated-measures ANOVA against a textbook's numbers, limiting cases of epsilon, and the paired t test."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from phri_analysis import statistics
from phri_analysis.errors import DataError

# Field, Discovering Statistics: eight people, four foods, time until they gave up; the printed result is
# F(3, 21) = 3.79, p = .026, epsilon = .533, corrected F(1.60, 11.19), p = .063.
FIELD = np.array([
    [8, 7, 1, 6], [9, 5, 2, 5], [6, 2, 3, 8], [5, 3, 1, 9], [8, 4, 5, 8], [7, 5, 6, 7], [10, 2, 7, 2], [12, 6, 8, 1],
])  # fmt: skip


def long(cells, names=("a", "b", "c", "d", "e")):
    rows = [
        {"participant": i, "controller": names[j], "force": value}
        for i, row in enumerate(cells)
        for j, value in enumerate(row)
    ]
    return pd.DataFrame(rows)


def two_factors(cells):
    """Cells (people, 2 subtasks x 3 controllers)."""
    rows = [
        {"participant": i, "subtask": "MN"[j // 3], "controller": "abc"[j % 3], "force": value}
        for i, row in enumerate(cells)
        for j, value in enumerate(row)
    ]
    return pd.DataFrame(rows)


def test_a_textbook_example():
    row = statistics.anova(long(FIELD), "force", ["controller"]).iloc[0]
    assert row["F"] == pytest.approx(3.79, abs=0.005) and (row["df1"], row["df2"]) == (3, 21)
    assert row["p"] == pytest.approx(0.026, abs=0.0005)
    assert row["epsilon_gg"] == pytest.approx(0.533, abs=0.0005)
    assert row["epsilon_gg"] * row["df1"] == pytest.approx(1.60, abs=0.005)
    assert row["epsilon_gg"] * row["df2"] == pytest.approx(11.19, abs=0.005)
    assert row["p_gg"] == pytest.approx(0.063, abs=0.0005)


def test_two_levels_are_a_paired_t_test():
    cells = np.random.default_rng(1).normal(size=(19, 2)) + [0.0, 0.5]
    row = statistics.anova(long(cells), "force", ["controller"]).iloc[0]
    t = stats.ttest_rel(cells[:, 0], cells[:, 1])
    assert row["F"] == pytest.approx(t.statistic**2)
    assert row["p"] == pytest.approx(t.pvalue) and row["p_gg"] == pytest.approx(t.pvalue)
    assert row["epsilon_gg"] == pytest.approx(1.0)


@pytest.mark.parametrize("levels", [3, 5])
def test_epsilon_is_one_under_sphericity_and_at_its_bound_with_one_direction(levels):
    rng = np.random.default_rng(2)
    # whitened: sample covariance exactly the identity, plus what is common to all levels
    raw = rng.normal(size=(40, levels))
    raw = (raw - raw.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(raw, rowvar=False))).T
    spherical = raw + 3.0 * raw.sum(axis=1, keepdims=True)
    assert statistics.greenhouse_geisser(spherical, statistics.contrasts(levels)) == pytest.approx(1.0)
    single = rng.normal(size=(40, 1)) * np.arange(levels)
    assert statistics.greenhouse_geisser(single, statistics.contrasts(levels)) == pytest.approx(1 / (levels - 1))


def test_contrasts_are_orthonormal_and_do_not_see_a_constant():
    for levels in (2, 4, 7):
        rows = statistics.contrasts(levels)
        assert rows @ rows.T == pytest.approx(np.eye(levels - 1))
        assert rows.sum(axis=1) == pytest.approx(np.zeros(levels - 1))


def test_effects_of_two_factors_are_those_of_what_they_average():
    # The main effect of the controller is the one-way ANOVA of the means over subtasks, and the interaction with two
    # subtasks that of their differences.
    cells = np.random.default_rng(3).normal(size=(12, 6)) + [0, 1, 2, 0, 0, 1]
    found = statistics.anova(two_factors(cells), "force", ["subtask", "controller"]).set_index("effect")
    assert list(found.index) == ["subtask", "controller", "subtask x controller"]
    means, differences = (cells[:, :3] + cells[:, 3:]) / 2, cells[:, :3] - cells[:, 3:]
    for effect, reduced in (("controller", means), ("subtask x controller", differences)):
        alone = statistics.anova(long(reduced), "force", ["controller"]).iloc[0]
        for column in ("F", "df1", "df2", "p", "epsilon_gg", "p_gg", "partial_eta2"):
            assert found.loc[effect, column] == pytest.approx(alone[column]), (effect, column)


def test_participants_without_a_value_are_left_out_and_counted():
    cells = FIELD.astype(float)
    cells[2, 1] = np.nan
    found = statistics.anova(long(cells), "force", ["controller"]).iloc[0]
    alone = statistics.anova(long(np.delete(FIELD, 2, axis=0)), "force", ["controller"]).iloc[0]
    assert found["participants"] == 7 and found["F"] == pytest.approx(alone["F"])
    with pytest.raises(DataError, match="force: 1 participants with a value in every cell"):
        statistics.anova(long(cells[2:4]), "force", ["controller"])
    with pytest.raises(DataError, match="factor controller has 1 level"):
        statistics.anova(long(FIELD[:, :1]), "force", ["controller"])
