"""Measures of a trial (thesis 2.1.5 and 5.3.4), each declared once: a function of a `Window` under `@measure`.

A measure is evaluated on the whole trial and on its two subtasks (5.3.4): MO "moving obstacle" until x first falls
below turning_point_x, NC "narrow channel" from there on. A window is a run of intervals [t_k, t_k+1]; every mean over
time is the left-rectangle sum  1/T sum_k f(t_k) (t_k+1 - t_k), T = sum of the intervals, so MO and NC add up to the
whole exactly and a dropped tick does not bias a mean. A window without an interval gives NaN, never an error.

Corrections of the printed formulas: 2.1.5 takes roots of mean norms and of the power, which is dimensionally wrong and
undefined for negative power; here they are mean |f| [N] and mean u_h.v [W], and only the tracking error is a root mean
square. Table 5.1 gives the collision force in [s], a misprint for [N].

Adding a measure: one function here, its expected value in a test.
"""

from dataclasses import dataclass
from typing import Callable

import numpy as np
import pandas as pd

from . import style, trial_table

SUBTASKS = ("whole", "MO", "NC")
CONTACT_FORCE = 0.1  # [N] below: no contact. Twice the noise SD of the force sensor, far below a felt touch
CONTACT_GAP = 0.1  # [s] a shorter release does not end a contact: one bounce along a wall is one collision
HEADLINE = (  # what fits the width of a page or a figure
    "completion_time",
    "human_force",
    "human_power",
    "disagreement",
    "collision_force",
    "collision_count",
    "assistance_force",
    "prediction_error",
    "prediction_coverage_95",
)
LIMITED_SHARE = 0.05  # share of time at any limit of the assistance above which a trial is marked `limited`
CHI2_95 = -2.0 * np.log(0.05)  # 95 % quantile of chi-squared with 2 degrees of freedom, 5.991


class Window:
    """Intervals [first, last) of a trial, with everything that measures need, as arrays with one row per interval."""

    def __init__(self, trial: pd.DataFrame, first: int, last: int, finished: bool, forecasts: pd.DataFrame):
        t = trial["t"].to_numpy()
        rows = trial.iloc[first:last]
        self.attrs = trial.attrs
        self.first, self.last, self.finished = first, last, finished
        self.t = t[first:last]
        self.weights = np.diff(t[first : last + 1])
        self.duration = float(t[last] - t[first])
        self.position, self.velocity = trial_table.vector(rows, ""), trial_table.vector(rows, "v")
        self.human, self.environment = trial_table.vector(rows, "human"), trial_table.vector(rows, "environment")
        self.assistance = trial_table.vector(rows, "assistance")
        self.limits = rows["limits"].to_numpy()
        contact = np.linalg.norm(trial_table.vector(trial, "environment"), axis=1) > CONTACT_FORCE
        self.contact = contact[first:last]
        begins = contact_begins(t, contact)
        self.collisions = int(np.sum((begins >= first) & (begins < last)))
        # The last window also holds the predictions that speak of the last tick.
        ends = np.inf if last == len(t) - 1 else t[last]
        inside = (forecasts["target_t"] >= t[first]) & (forecasts["target_t"] < ends)
        self.predictions = forecasts[inside] if last > first else forecasts.iloc[:0]

    def mean(self, values: np.ndarray) -> float:
        """Left-rectangle mean over time. Summed by numpy's own pairwise sum: a BLAS dot may change with its threads."""
        return float(np.sum(values * self.weights) / self.duration) if self.duration > 0 else np.nan


def contact_begins(t: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Rows at which an episode of contact begins: contact after at least CONTACT_GAP without it."""
    touching = np.flatnonzero(contact)
    if len(touching) == 0:
        return touching
    # The gap runs from the tick after the last contact to the tick of the next one.
    released = t[np.minimum(touching[:-1] + 1, len(t) - 1)]
    slack = 1e-9  # [s] so that a gap of exactly CONTACT_GAP counts in spite of rounding
    return touching[np.r_[True, t[touching[1:]] - released >= CONTACT_GAP - slack]]


@dataclass(frozen=True)
class Measure:
    """`label` for axes and tables, `unit` of the value in tables ("share" and "count" are pure numbers), `description`,
    `source` of the formula."""

    name: str
    label: str
    unit: str
    description: str
    source: str
    evaluate: Callable[[Window], float]

    @property
    def heading(self) -> str:
        """Label with the unit that tables and pictures show, see `style`."""
        return f"{self.label} [{style.shown_unit(self.unit)}]"


MEASURES = {}


def measure(label: str, unit: str, source: str):
    """Declares a function Window -> float as a measure called like the function, described by its docstring."""

    def register(function):
        text = " ".join(function.__doc__.split())
        MEASURES[function.__name__] = Measure(function.__name__, label, unit, text, source, function)
        return function

    return register


def _norm(values):
    return np.hypot(values[:, 0], values[:, 1])


def _sample_mean(values):
    return float(np.mean(values)) if len(values) else np.nan


@measure("Completion time", "s", "2.1.5, 5.3.4")
def completion_time(window):
    """Time from the first to the last tick of the task; empty when the task was not finished."""
    return window.duration if window.finished and window.duration > 0 else np.nan


@measure("Human force", "N", "2.1.5, 5.3.4 (corrected: no root)")
def human_force(window):
    """Mean over time of the norm of the force by the human on the object, |u_h|."""
    return window.mean(_norm(window.human))


@measure("Human power", "W", "2.1.5, 5.3.4 (corrected: no root)")
def human_power(window):
    """Mean over time of the power from the human into the object, u_h . v; negative where the human brakes."""
    return window.mean(np.sum(window.human * window.velocity, axis=1))


@measure("Disagreement", "N", "5.3.4")
def disagreement(window):
    """Mean over time of u_D = max(0, -(u_h / |u_h|) . u_r): how far the applied assistance u_r pushes against the
    human's force u_h; 0 where the human applies none."""
    norm = _norm(window.human)
    against = -np.sum(window.human * window.assistance, axis=1)
    return window.mean(np.maximum(0.0, np.divide(against, norm, out=np.zeros_like(norm), where=norm > 0)))


@measure("Collision force", "N", "5.3.4 (unit corrected)")
def collision_force(window):
    """Mean over the whole time of the norm of the force by walls and obstacles, |u_c|, 0 where nothing is touched."""
    return window.mean(_norm(window.environment))


@measure("Collisions", "count", "2.1.5")
def collision_count(window):
    """Episodes of contact (|u_c| above 0.1 N) that begin here; a release shorter than 0.1 s does not end an episode."""
    return float(window.collisions) if window.duration > 0 else np.nan


@measure("Force in contact", "N", "2.1.5")
def contact_force(window):
    """Mean of |u_c| over the time in contact only: how hard a collision is; empty without one."""
    time = np.sum(window.weights[window.contact])
    force = _norm(window.environment) * window.weights
    return float(np.sum(force[window.contact]) / time) if time > 0 else np.nan


@measure("Assistance force", "N", "5.3.4")
def assistance_force(window):
    """Mean over time of the norm of the applied assistance, |u_r|."""
    return window.mean(_norm(window.assistance))


@measure("Prediction error", "m", "section 3.1 (horizon of 5.3.4)")
def prediction_error(window):
    """Mean distance between the position that each distinct prediction foresaw for the end of its horizon and the
    position then; predictions that look past the end of the trial do not count."""
    return _sample_mean(window.predictions["error"])


@measure("Prediction RMSE", "m", "section 3.1 (horizon of 5.3.4)")
def prediction_rmse(window):
    """Root of the mean squared distance between foreseen and actual position, over the same predictions."""
    return float(np.sqrt(_sample_mean(window.predictions["error"] ** 2)))


@measure("Coverage of 95 % ellipses", "share", "section 3.1, chi-squared with 2 dof")
def prediction_coverage_95(window):
    """Share of predictions whose 95 % ellipse (squared Mahalanobis distance up to 5.991) holds the position that came;
    0.95 where the belief is right, less where it is too sure of itself."""
    return _sample_mean(window.predictions["mahalanobis2"] <= CHI2_95)


@measure("Tracking RMSE", "m", "2.1.5")
def tracking_rmse(window):
    """Root of the mean over time of the squared distance to the desired trajectory, where the trial knows one
    (attribute desired_path, rows of t [s], x [m], y [m]); empty where it does not."""
    path = window.attrs.get("desired_path")
    if path is None:
        return np.nan
    path = np.asarray(path, dtype=float)
    desired = np.column_stack([np.interp(window.t, path[:, 0], path[:, i]) for i in (1, 2)])
    return float(np.sqrt(window.mean(_norm(window.position - desired) ** 2)))


def limit_measures() -> dict:
    """One measure per limit of the library: the share of time that it was active."""

    def share(bit):
        return lambda window: window.mean((window.limits >> bit) & 1)

    together = Measure(
        "limited_assistance",
        "Time at any limit of the assistance",
        "share",
        "Share of time in which some limit took something away from the assistance.",
        "safety core",
        _limited_assistance,
    )
    each = {
        f"limited_{name}": Measure(
            f"limited_{name}",
            f"Time at limit {name.replace('_', ' ')}",
            "share",
            f"Share of time in which the limit {name} changed the command.",
            "safety core",
            share(bit),
        )
        for bit, name in enumerate(trial_table.limit_names())
    }
    return {**each, together.name: together}


def _limited_assistance(window) -> float:
    return window.mean((window.limits & trial_table.assistance_mask()) != 0)


def all_measures(columns=()) -> dict:
    """Every measure by name: the declared ones, the limits of the library, and limits that only a table knows."""
    known = {**MEASURES, **limit_measures()}
    for name in columns:
        if name.startswith("limited_") and name not in known:
            bit = name.removeprefix("limited_")
            known[name] = Measure(
                name,
                f"Time at limit {bit.replace('_', ' ')}",
                "share",
                f"Share of time in which the limit {bit} changed the command.",
                "safety core",
                None,
            )
    return known


def windows(trial: pd.DataFrame) -> dict:
    """The windows of a trial by subtask; only "whole" where the task has no turning point."""
    end, completed = len(trial) - 1, bool(trial.attrs.get("completed", True))
    forecasts = trial_table.predictions(trial)
    parts = {"whole": (0, end, completed)}
    turning_point = trial.attrs.get("turning_point_x")
    if turning_point is not None:
        passed = np.flatnonzero(trial["x"].to_numpy() < turning_point)
        turn = int(passed[0]) if len(passed) else end
        parts["MO"] = (0, turn, bool(len(passed)))
        parts["NC"] = (turn, end, completed)
    return {name: Window(trial, first, last, finished, forecasts) for name, (first, last, finished) in parts.items()}


def evaluate(trial: pd.DataFrame) -> list:
    """The measures of one trial: a dict per subtask, ready to be a row of the study table."""
    limits = limit_measures()
    used = int(np.bitwise_or.reduce(trial["limits"].to_numpy()))
    named = len(trial_table.limit_names())
    unnamed = [bit for bit in range(named, used.bit_length()) if used >> bit & 1]
    rows = []
    for subtask, window in windows(trial).items():
        row = {"subtask": subtask, **{name: entry.evaluate(window) for name, entry in MEASURES.items()}}
        row.update({name: entry.evaluate(window) for name, entry in limits.items()})
        row.update({f"limited_bit_{bit}": window.mean((window.limits >> bit) & 1) for bit in unnamed})
        row["limited"] = bool(row["limited_assistance"] > LIMITED_SHARE)
        rows.append(row)
    return rows
