"""Prediction of motions not seen in training: the default predictor beside the thesis' and the simple ones.

Leave one demonstration out, every movement of the data set: mean distance in mm between the predicted and the real
place 0.1, 0.2 and 0.3 s ahead, share of real places inside the 95 % regions, error of the length by (3.10). The data
set is --data or the path in the environment variable PHRI_DEMONSTRATIONS (a LASA folder, an .npz, a folder of .csv; see
phri_analysis.demonstrations), else symbol 17 of the Panda co-manipulation set, which is shipped with the tests.

All methods see positions at 50 Hz, nothing later than the present sample, and are judged on the same samples: from
0.2 s after the start to 0.3 s before the end. Velocities are differences of positions. The thesis' modes are a time-HMM
of 10 states over [p; v] with the window of 30 samples; "pace" scales its horizon by observed / modelled speed. Constant
velocity takes the last difference; 5-NN takes the mean displacement of the five nearest training samples in (p, v),
each block divided by its standard deviation. Only the demonstrations that are not left out train anything.
"""

import concurrent.futures
import os
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree
from scipy.stats import chi2

from phri_analysis import demonstrations
from phri_analysis.errors import DataError, MissingInputError

from . import _page

TAKES_DATA = True
TITLE = "Prediction of motions not seen in training"
VARIABLE = "PHRI_DEMONSTRATIONS"
SHIPPED = Path(__file__).resolve().parents[1] / "tests/data/panda_comanip/symbol_17_100hz.npz"
DT = 0.02  # [s]
HORIZONS = (5, 10, 15)  # [samples]
FIRST = 10  # first judged sample
STATES, WINDOW = 10, 30  # of the thesis' modes
NEIGHBOURS = 5
REGION = 0.95
FEWEST = FIRST + HORIZONS[-1] + 1  # samples of a demonstration
# name -> (mode of TimeHmm, arguments of its predict, whether the pace is adapted)
THESIS = {
    "thesis (3.8) as printed": ("thesis", {"reference": "path", "time": "thesis"}, False),
    "entry-corrected": ("corrected", {"reference": "path", "time": "entry_corrected"}, False),
    "time-HMM displacement": ("corrected", {"reference": "displacement", "time": "regressed"}, False),
    "time-HMM displacement, pace": ("corrected", {"reference": "displacement", "time": "regressed"}, True),
}
DEFAULT, VELOCITY, NEAREST = "default", "constant velocity", "5-NN displacement"
METHODS = (DEFAULT, *THESIS, VELOCITY, NEAREST)


def velocity(x: np.ndarray) -> np.ndarray:
    """Backward differences (T, d); the first sample takes the second's."""
    v = np.diff(x, axis=0, prepend=x[:1]) / DT
    v[0] = v[1]
    return v


def inside(residual, covariance):
    """Which of the residuals (N, d) lie in the 95 % regions of the covariances (N, d, d)."""
    square = np.einsum("ti,ti->t", residual, np.linalg.solve(covariance, residual[..., None])[..., 0])
    return square < chi2.ppf(REGION, residual.shape[1])


def nearest(train, x, steps):
    """Mean displacement of the nearest training samples, (N, d) for the judged samples of x."""
    places = np.vstack([y[1 : len(y) - steps] for y in train])
    speeds = np.vstack([velocity(y)[1 : len(y) - steps] for y in train])
    moved = np.vstack([y[1 + steps :] - y[1:-steps] for y in train])
    scale = [max(block.std(axis=0).mean(), 1e-12) for block in (places, speeds)]
    tree = cKDTree(np.hstack([places / scale[0], speeds / scale[1]]))
    t = judged(x)
    _, index = tree.query(np.hstack([x[t] / scale[0], velocity(x)[t] / scale[1]]), k=min(NEIGHBOURS, len(places)))
    return moved[index.reshape(len(t), -1)].mean(axis=1)


def judged(x):
    return np.arange(FIRST, len(x) - HORIZONS[-1])


def fold(movement: str, positions: list, held_out: int, methods=METHODS) -> list:
    """Rows of one demonstration left out: per method and horizon the means over its judged samples. The length's error
    is NaN where no method is a time-HMM."""
    import phri_learning

    x, d = positions[held_out], positions[0].shape[1]
    train = [y for index, y in enumerate(positions) if index != held_out]
    t = judged(x)
    rows = []

    def add(method, steps, mean, covariance=None):
        residual = mean - x[t + steps]
        rows.append({
            "movement": movement, "held_out": held_out, "method": method, "horizon": steps * DT, "samples": len(t),
            "error_mm": 1e3 * np.linalg.norm(residual, axis=1).mean(),
            "coverage": np.nan if covariance is None else inside(residual, covariance).mean(),
        })  # fmt: skip

    if DEFAULT in methods:
        mixture = phri_learning.DisplacementMixture(axes=d, dt=DT, horizon=HORIZONS[-1] * DT).fit(train)
    motions = [np.hstack([y, velocity(y)]) for y in train]
    motion = np.hstack([x, velocity(x)])
    modes = dict.fromkeys(mode for name, (mode, _, _) in THESIS.items() if name in methods)
    models = {mode: phri_learning.TimeHmm(STATES, dt=DT, mode=mode).fit(motions) for mode in modes}
    for steps in HORIZONS:
        if DEFAULT in methods:
            mean, covariance = mixture.follow(x, steps * DT)
            add(DEFAULT, steps, mean[t], covariance[t])
        for name, (mode, arguments, pace) in THESIS.items():
            if name not in methods:
                continue
            arguments = {**arguments, "velocity": (d, 2 * d) if pace else None}
            windows = (motion[max(0, s - WINDOW + 1) : s + 1] for s in t)
            forecasts = [models[mode].predict(window, steps * DT, **arguments) for window in windows]
            add(name, steps, np.array([m[:d] for m, _ in forecasts]), np.array([c[:d, :d] for _, c in forecasts]))
        if VELOCITY in methods:
            add(VELOCITY, steps, x[t] + steps * DT * velocity(x)[t])
        if NEAREST in methods:
            add(NEAREST, steps, x[t] + nearest(train, x, steps))
    length = np.mean([len(y) for y in train]) * DT
    for row in rows:
        row["length_error"] = abs(models["corrected"].length_ / length - 1.0) if "corrected" in models else np.nan
    return rows


def evaluate(movements: list, jobs: int = 1, methods=METHODS) -> pd.DataFrame:
    """One row per movement, left-out demonstration, method and horizon."""
    tasks = []
    for movement in movements:
        positions = [demo.resampled(DT) for demo in movement.demonstrations]
        if len(positions) < 2:
            raise DataError(f"{movement.name}: {len(positions)} demonstration, expected at least 2 to leave one out")
        for demo, x in zip(movement.demonstrations, positions):
            if len(x) < FEWEST:
                raise DataError(f"{demo.name}: {len(x) * DT:.2f} s long, expected at least {FEWEST * DT:.2f} s")
        tasks += [(movement.name, positions, held_out, methods) for held_out in range(len(positions))]
    if jobs == 1:
        results = [fold(*task) for task in tasks]
    else:
        with concurrent.futures.ProcessPoolExecutor(jobs) as pool:
            results = list(pool.map(fold, *zip(*tasks)))
    return pd.DataFrame([row for rows in results for row in rows])


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Per method and horizon: means over the samples of each movement, then over movements; `won` counts the movements
    on which the default's error is smaller."""
    weighted = table.assign(**{key: table[key] * table["samples"] for key in ("error_mm", "coverage")})
    groups = weighted.groupby(["movement", "method", "horizon"], sort=False)
    sums = groups[["error_mm", "coverage", "samples"]].sum(min_count=1)
    each = sums[["error_mm", "coverage"]].div(sums["samples"], axis=0).reset_index()
    default = each[each["method"] == DEFAULT].set_index(["movement", "horizon"])["error_mm"]
    each["won"] = each["error_mm"].to_numpy() > default.loc[list(zip(each["movement"], each["horizon"]))].to_numpy()
    return each.groupby(["method", "horizon"], sort=False).agg(
        error_mm=("error_mm", "mean"), coverage=("coverage", "mean"), won=("won", "sum"), movements=("won", "size")
    )


def text_rows(means: pd.DataFrame) -> tuple:
    """(header, rows) of text."""
    ahead = [steps * DT for steps in HORIZONS]
    header = ["Method", *[f"{h:.1f} s [mm]" for h in ahead], *[f"inside 95 % at {h:.1f} s" for h in ahead],
              f"default better at {ahead[-1]:.1f} s"]  # fmt: skip
    rows = []
    for method in METHODS:
        rows_of = [means.loc[(method, h)] for h in ahead]
        shares = ["" if np.isnan(row["coverage"]) else f"{100 * row['coverage']:.1f} %" for row in rows_of]
        won = "" if method == DEFAULT else f"{int(rows_of[-1]['won'])} of {int(rows_of[-1]['movements'])}"
        rows.append([method, *[f"{row['error_mm']:.2f}" for row in rows_of], *shares, won])
    return header, rows


def source() -> Path:
    """The data set asked for, or the shipped one."""
    path = os.environ.get(VARIABLE)
    if path:
        return Path(path).expanduser()
    if not SHIPPED.is_file():
        raise MissingInputError(f"{SHIPPED}: no such file; --data or {VARIABLE} name data (LASA folder, .npz, .csv)")
    return SHIPPED


def run(options) -> list:
    path = options.data or source()
    movements = demonstrations.load(path)
    table = evaluate(movements, options.jobs)
    header, rows = text_rows(summary(table))
    count = sum(len(movement.demonstrations) for movement in movements)
    lengths = table.drop_duplicates(["movement", "held_out"])["length_error"]
    notes = [
        f"Data: {path}, {len(movements)} movement(s), {count} demonstrations. Leave one demonstration out.",
        f"Length by (3.10) against the mean training demonstration: {100 * lengths.mean():.1f} % off on average, "
        f"{100 * lengths.max():.1f} % at worst.",
    ]
    _page.write_csv(table, options.out / "table.csv")
    _page.write_record(options.out, "prediction", {
        "data": str(path), "dt": DT, "horizons": [steps * DT for steps in HORIZONS], "first_judged_sample": FIRST,
        "thesis_states": STATES, "thesis_window": WINDOW, "neighbours": NEIGHBOURS,
    })  # fmt: skip
    section = _page.Section("Error and coverage", header, rows, note=" ".join(notes))
    page = _page.write_page(options.out, TITLE, __doc__.partition("\n\n")[2], [section], simulated=False)
    return [*notes, "", _page.aligned(header, rows), "", f"table:  {options.out / 'table.csv'}", f"report: {page}"]
