"""How what simulated participants do depends on how their parameters are distributed.

The elasticity of an outcome y to a parameter p is (dy / y) / (dp / p), here the central difference between -20 % and
+20 % of p with the same people, obstacles and noise. Where p is 0 (a bias) there is no relative change: the step is one
standard deviation between people, and the value is dy / y for it, marked by `step` = "spread". Every value has a
jackknife standard error over people; one within three errors of 0 is not told from 0 (of 250 values of no effect, less
than one goes beyond).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from . import _people

CHANGE = 0.2
OUTCOMES = ("human_force", "human_power", "completion_time", "collision_force")
SPREAD = "spread_of_force"  # SD / mean of human_force between people
SIGNIFICANT = 3.0  # standard errors


@dataclass(frozen=True)
class Step:
    """One parameter of the population, and the two values it is given. `relative`: (high - low) / its value, None
    where that is 0."""

    key: str
    value: float
    low: float
    high: float
    relative: float | None


def steps(traits, keys=()) -> list:
    """A step for the median and the spread of each trait, or for the chosen keys (`speed/median`)."""
    found = []
    for trait in traits:
        for kind in ("median", "spread"):
            key, value = f"{trait.key}/{kind}", getattr(trait, kind)
            if keys and key not in keys:
                continue
            if value == 0.0:
                if trait.spread > 0.0:
                    found.append(Step(key, value, -trait.spread, trait.spread, None))
                continue
            found.append(Step(key, value, (1 - CHANGE) * value, (1 + CHANGE) * value, 2 * CHANGE))
    return found


def outcomes(whole: pd.DataFrame) -> pd.Series:
    """The numbers of a population: mean of each outcome over people, and SD / mean of the force."""
    values = whole[list(OUTCOMES)].mean()
    values[SPREAD] = whole["human_force"].std(ddof=1) / whole["human_force"].mean()
    return values


def elasticity(base: pd.DataFrame, low: pd.DataFrame, high: pd.DataFrame, relative) -> pd.DataFrame:
    """Rows: outcomes; columns: value, error (jackknife over people). The frames hold the same people, a row each."""
    scale = 2.0 if relative is None else relative  # two spreads apart: per spread

    def value(rows):
        return (outcomes(high[rows]) - outcomes(low[rows])) / outcomes(base[rows]) / scale

    n = len(base)
    rest = [value(np.arange(n) != left_out) for left_out in range(n)]
    deviation = pd.DataFrame(rest).std(ddof=0) * np.sqrt(n - 1)
    return pd.DataFrame({"value": value(np.ones(n, dtype=bool)), "error": deviation})


def _whole(seeds, people, settings=()):
    return _people.measures(seeds, people, settings).loc["whole"]


def table(base: pd.DataFrame, seeds, people: int, keys=(), jobs: int = 1, progress: bool = False) -> pd.DataFrame:
    """One row per parameter of the population and outcome: parameter, step, low, base, high, outcome, value, error,
    significant; `base` are the measures (subtask whole) of the same seeds and people as they are."""
    wanted = steps(_people.experiment().traits, keys)
    calls = [(seeds, people, ((step.key, value),)) for step in wanted for value in (step.low, step.high)]
    results = _people.spread(_whole, calls, jobs, progress, "sensitivity")
    rows = []
    for step, low, high in zip(wanted, results[::2], results[1::2]):
        found = elasticity(base, low, high, step.relative)
        for name, entry in found.iterrows():
            rows.append(
                {
                    "parameter": step.key,
                    "step": "spread" if step.relative is None else f"{CHANGE:.0%}",
                    "low": step.low,
                    "base": step.value,
                    "high": step.high,
                    "outcome": name,
                    "value": entry["value"],
                    "error": entry["error"],
                    "significant": bool(abs(entry["value"]) > SIGNIFICANT * entry["error"]),
                }
            )
    return pd.DataFrame(rows)


def correlations(parameters: pd.DataFrame, whole: pd.DataFrame) -> pd.DataFrame:
    """Rank correlation between people of each parameter with each outcome, rows parameters, columns outcomes."""
    ranks, targets = parameters.rank(), whole.loc[parameters.index, list(OUTCOMES)].rank()
    return pd.DataFrame({name: ranks.corrwith(targets[name]) for name in OUTCOMES})


def threshold(people: int, tests: int, level: float = 0.05) -> float:
    """|rank correlation| beyond which one of `tests` correlations of independent numbers goes with probability `level`
    (Bonferroni, normal approximation of Fisher's z)."""
    from scipy import stats

    return float(np.tanh(stats.norm.ppf(1 - level / tests / 2) / np.sqrt(people - 3)))
