"""Repeated-measures ANOVA of a study table, as in 5.3.4: every participant under every level of every factor.

F and degrees of freedom come from statsmodels' AnovaRM. On top of it the Greenhouse-Geisser correction: where the
differences between levels do not all have the same variance (no sphericity), F with the plain degrees of freedom is too
often significant; both of them are multiplied by

    epsilon = tr(C S C')^2 / (d tr((C S C')^2)),   1/d <= epsilon <= 1,

S the covariance over participants of the cells, C orthonormal contrasts of the effect (d of them; of an interaction:
the Kronecker product). With fewer participants than cells S is singular and epsilon still defined.

Trap: AnovaRM drops a factor whose name contains the name of the subject's column; here the latter is `participant`.
"""

import itertools

import numpy as np
import pandas as pd
from scipy import stats

from .errors import DataError

COLUMNS = ["measure", "effect", "participants", "F", "df1", "df2", "p", "epsilon_gg", "p_gg", "partial_eta2"]


def contrasts(levels: int) -> np.ndarray:
    """(levels - 1, levels) orthonormal rows, each of sum 0 (Helmert)."""
    rows = np.zeros((levels - 1, levels))
    for k in range(1, levels):
        rows[k - 1, :k], rows[k - 1, k] = 1.0, -k
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def greenhouse_geisser(cells: np.ndarray, contrast: np.ndarray) -> float:
    """epsilon of an effect. `cells` (participants, cells), `contrast` (d, cells) orthonormal rows. NaN where the
    effect does not vary between participants."""
    within = contrast @ np.atleast_2d(np.cov(cells, rowvar=False)) @ contrast.T
    squares = len(contrast) * np.sum(within * within)
    return float(np.trace(within) ** 2 / squares) if squares > 0 else np.nan


def anova(table: pd.DataFrame, measure: str, factors) -> pd.DataFrame:
    """One row per effect (factors, then interactions): F, df, p, epsilon and corrected p, partial eta squared. `table`
    has columns participant, the factors and the measure; several rows of a cell are averaged; participants without a
    value in some cell are left out. Raises DataError when fewer than two are left or a factor has one level."""
    from statsmodels.stats.anova import AnovaRM

    factors = list(factors)
    levels = [list(dict.fromkeys(table[factor])) for factor in factors]
    for factor, names in zip(factors, levels):
        if len(names) < 2:
            raise DataError(f"{measure}: factor {factor} has {len(names)} level, expected 2 or more")
    order = list(itertools.product(*levels))
    means = table.groupby(["participant", *factors])[measure].mean().to_dict()
    people = sorted(set(table["participant"]))
    cells = np.array([[means.get((person, *cell), np.nan) for cell in order] for person in people])
    cells = cells[~np.isnan(cells).any(axis=1)]
    if len(cells) < 2:
        raise DataError(f"{measure}: {len(cells)} participants with a value in every cell, expected 2 or more")
    rows = [(i, *cell, value) for i, person in enumerate(cells) for cell, value in zip(order, person)]
    flat = pd.DataFrame(rows, columns=["participant", *factors, measure])
    result = AnovaRM(flat, measure, "participant", within=factors).fit().anova_table
    rows = []
    for size in range(1, len(factors) + 1):
        for chosen in itertools.combinations(factors, size):
            rows.append(_effect(result, cells, measure, factors, levels, chosen))
    return pd.DataFrame(rows, columns=COLUMNS)


def _effect(result, cells, measure, factors, levels, chosen):
    f, df1, df2, p = result.loc[":".join(chosen), ["F Value", "Num DF", "Den DF", "Pr > F"]]
    contrast = np.ones((1, 1))
    for factor, names in zip(factors, levels):
        mean = np.full((1, len(names)), len(names) ** -0.5)
        contrast = np.kron(contrast, contrasts(len(names)) if factor in chosen else mean)
    epsilon = greenhouse_geisser(cells, contrast)
    corrected = float(stats.f.sf(f, epsilon * df1, epsilon * df2))
    eta = f * df1 / (f * df1 + df2)
    return [measure, " x ".join(chosen), len(cells), f, df1, df2, p, epsilon, corrected, eta]
