"""The trial table: what one trial looks like, whether it was run in ROS and recorded, or run in lockstep without ROS.

One pandas row per tick of 1 ms, the columns of `COLUMNS`, and the setting of the trial in `table.attrs`: experiment,
scene (str), participant, trial, seed (int), controller (str), evaluated, completed (bool), turning_point_x [m],
git_revision (str), and optionally map, start, goal, obstacles, desired_path (see `plots` and `metrics`).

Wrenches are exerted BY the named agent ON the object. The prediction columns repeat the newest prediction on every row
until the next one (50 Hz): its belief N(prediction_x/y, prediction_xx/xy/yy) is about the position at prediction_t0 +
prediction_horizon, not about the row that it stands in. They are NaN before the first prediction; nothing else may be
NaN.
"""

import functools
import importlib
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .errors import DataError


@dataclass(frozen=True)
class Column:
    """One column: its unit ("" for a pure number), numpy type and meaning."""

    name: str
    unit: str
    meaning: str
    dtype: str = "float64"


COLUMNS = (
    Column("t", "s", "time since the start of the trial"),
    Column("x", "m", "position of the object"),
    Column("y", "m", "position of the object"),
    Column("vx", "m/s", "velocity of the object"),
    Column("vy", "m/s", "velocity of the object"),
    Column("human_x", "N", "force by the human on the object"),
    Column("human_y", "N", "force by the human on the object"),
    Column("environment_x", "N", "force by walls and obstacles on the object"),
    Column("environment_y", "N", "force by walls and obstacles on the object"),
    Column("assistance_x", "N", "force by the robot on the object, as applied"),
    Column("assistance_y", "N", "force by the robot on the object, as applied"),
    Column("requested_x", "N", "assistance as the controller asked for it, before the limits"),
    Column("requested_y", "N", "assistance as the controller asked for it, before the limits"),
    Column("state", "", "state machine: 0 INIT, 1 IDLE, 2 PASSIVE, 3 ACTIVE, 4 FAULT", "int64"),
    Column("fault", "", "fault code, 0 without a fault", "int64"),
    Column("limits", "", "limits active in this tick, one bit each", "int64"),
    Column("tank", "J", "energy tank"),
    Column("passivity", "J", "passivity observer"),
    Column("prediction_t0", "s", "time that the newest prediction was made at"),
    Column("prediction_horizon", "s", "how far it looks ahead"),
    Column("prediction_x", "m", "predicted position at prediction_t0 + prediction_horizon"),
    Column("prediction_y", "m", "predicted position at prediction_t0 + prediction_horizon"),
    Column("prediction_xx", "m^2", "variance of the predicted position"),
    Column("prediction_xy", "m^2", "covariance of the predicted position"),
    Column("prediction_yy", "m^2", "variance of the predicted position"),
)
# of real-time trials only; a table may lack them
OPTIONAL = (Column("lateness", "s", "how late the tick came"),)
NAMES = tuple(column.name for column in COLUMNS)
PREDICTION = tuple(name for name in NAMES if name.startswith("prediction_"))
STATES = ("INIT", "IDLE", "PASSIVE", "ACTIVE", "FAULT")
REQUIRED_ATTRS = {"participant": int, "controller": str, "trial": int}


def limit_names() -> list:
    """Names of the bits of `limits`, bit i is element i; empty without the C++ library (bits are then called
    bit_<i>)."""
    core = _core()
    return list(core.limit_names()) if core else []


def assistance_mask() -> int:
    """The bits of `limits` that take something away from the assistance (the others bound the motion or the sensor).
    Without the C++ library, that knows, all bits: a trial is rather marked too often than not at all."""
    core = _core()
    if not core:
        return (1 << 32) - 1
    return sum(1 << bit for bit, name in enumerate(core.limit_names()) if name in core.assistance_limits())


@functools.cache
def _core():
    try:
        return importlib.import_module("phri_core")
    except ImportError:
        return None


def describe(attrs: dict) -> str:
    """How messages and pictures call a trial."""
    return (
        f"participant {attrs.get('participant', '?')}, controller {attrs.get('controller', '?')}, "
        f"trial {attrs.get('trial', '?')}"
    )


def conform(table: pd.DataFrame) -> pd.DataFrame:
    """The table in the order and types of `COLUMNS`, checked. Raises DataError naming the column, row and value."""
    what = describe(table.attrs)
    missing = [name for name in NAMES if name not in table.columns]
    if missing:
        raise DataError(f"{what}: column {', '.join(missing)} is missing from the trial table")
    for name, kind in REQUIRED_ATTRS.items():
        value = table.attrs.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise DataError(f"{what}: attribute {name} is {value!r}, expected {kind.__name__}")
    if len(table) == 0:
        raise DataError(f"{what}: the trial table has no rows")
    columns = [*COLUMNS, *(column for column in OPTIONAL if column.name in table.columns)]
    checked = pd.DataFrame({column.name: _typed(table[column.name], column, what) for column in columns})
    checked.attrs = dict(table.attrs)
    steps = np.diff(checked["t"].to_numpy())
    if len(steps) and not steps.min() > 0:
        row = int(np.argmin(steps)) + 1
        raise DataError(
            f"{what}: t does not rise at row {row}: {checked['t'][row - 1]!r} s, then {checked['t'][row]!r} s"
        )
    return checked


def _typed(series: pd.Series, column: Column, what: str) -> np.ndarray:
    values = series.to_numpy(dtype="float64") if column.dtype == "float64" else series.to_numpy()
    valid = np.isfinite(values)
    if column.name in PREDICTION:
        valid |= np.isnan(values)
    if not valid.all():
        row = int(np.argmin(valid))
        raise DataError(
            f"{what}: {column.name} is {values[row]!r} in row {row}, expected a finite number"
            + (f" [{column.unit}]" if column.unit else "")
        )
    return values.astype(column.dtype)


def vector(table: pd.DataFrame, name: str) -> np.ndarray:
    """The (n, 2) array of a planar quantity: "human" gives human_x, human_y; "" gives x, y; "v" gives vx, vy."""
    prefix = {"": "", "v": "v"}.get(name, name + "_")
    return table[[prefix + "x", prefix + "y"]].to_numpy()


def predictions(table: pd.DataFrame) -> pd.DataFrame:
    """One row per distinct prediction of the trial, in time order: the prediction columns and `target_t` [s], the time
    it speaks of, `actual_x`, `actual_y` [m], where the object was then, `error` [m] and `mahalanobis2`, the squared
    distance in units of the belief's own spread (chi-squared with 2 degrees of freedom where the belief is right).
    Predictions that speak of a time after the last tick are left out: nobody knows what was true. A covariance that is
    not positive definite gives mahalanobis2 = inf: no ellipse, nothing inside."""
    t0 = table["prediction_t0"].to_numpy()
    first = ~np.isnan(t0)
    first[1:] &= ~(t0[1:] == t0[:-1])
    rows = table.loc[first, list(PREDICTION)].reset_index(drop=True)
    t = table["t"].to_numpy()
    rows["target_t"] = rows["prediction_t0"] + rows["prediction_horizon"]
    slack = 1e-9  # [s], far below a tick: t0 + horizon may round to just after the last tick
    rows = rows[(rows["target_t"] <= t[-1] + slack) & (rows["target_t"] >= t[0] - slack)].reset_index(drop=True)
    rows["actual_x"] = np.interp(rows["target_t"], t, table["x"])
    rows["actual_y"] = np.interp(rows["target_t"], t, table["y"])
    ex, ey = rows["actual_x"] - rows["prediction_x"], rows["actual_y"] - rows["prediction_y"]
    rows["error"] = np.hypot(ex, ey)
    xx, xy, yy = rows["prediction_xx"], rows["prediction_xy"], rows["prediction_yy"]
    determinant = xx * yy - xy * xy
    definite = (xx > 0) & (determinant > 0)
    distance = (yy * ex * ex - 2 * xy * ex * ey + xx * ey * ey) / determinant.where(definite, np.nan)
    rows["mahalanobis2"] = distance.where(definite, np.inf)
    return rows
