"""Trial tables made up for the tests: exact ones with hand-computable measures, and plausible ones to look at.

Nothing here is a model of a person; the plausible trial only fills every column with numbers of the right size.
"""

import numpy as np
import pandas as pd

from phri_analysis import trial_table

TICK = 1e-3  # [s]
HORIZON = 0.2  # [s]
PERIOD = 20  # ticks between predictions


def constant_trial(
    ticks=1001,
    velocity=(0.0, 0.0),
    human=(0.0, 0.0),
    assistance=(0.0, 0.0),
    environment=(0.0, 0.0),
    start=(0.1, 0.0),
    **attrs
):
    """Everything constant, so that every mean over time equals the constant. No prediction."""
    t = np.arange(ticks) * TICK
    columns = {name: np.zeros(ticks) for name in trial_table.NAMES}
    columns.update({name: np.full(ticks, np.nan) for name in trial_table.PREDICTION})
    columns["t"] = t
    for prefix, value in (
        ("v", velocity),
        ("human_", human),
        ("assistance_", assistance),
        ("requested_", assistance),
        ("environment_", environment),
    ):
        columns[prefix + "x"], columns[prefix + "y"] = np.full(ticks, value[0], float), np.full(ticks, value[1], float)
    columns["x"], columns["y"] = start[0] + velocity[0] * t, start[1] + velocity[1] * t
    columns["state"] = np.full(ticks, 3)
    table = pd.DataFrame(columns)
    table.attrs = {
        "experiment": "test",
        "scene": "flat",
        "participant": 1,
        "controller": "lqr",
        "trial": 3,
        "evaluated": True,
        "seed": 7,
        "completed": True,
        "turning_point_x": -0.04,
        "git_revision": "0" * 7,
        **attrs,
    }
    return trial_table.conform(table)


def predict(table, error=(0.0, 0.0), covariance=((1e-6, 0.0), (0.0, 1e-6)), period=PERIOD, horizon=HORIZON):
    """Adds predictions at every `period` ticks, off by `error` [m] (one pair, or one per prediction) from what came;
    predictions past the end extrapolate the last velocity."""
    table = table.copy()
    t = table["t"].to_numpy()
    made = np.arange(0, len(t), period)
    target = t[made] + horizon
    late = np.maximum(0.0, target - t[-1])
    error = np.broadcast_to(np.asarray(error, float), (len(made), 2))
    covariance = np.asarray(covariance, float)
    values = {
        "t0": t[made],
        "horizon": np.full(len(made), horizon),
        "x": np.interp(target, t, table["x"]) + late * table["vx"].iloc[-1] + error[:, 0],
        "y": np.interp(target, t, table["y"]) + late * table["vy"].iloc[-1] + error[:, 1],
        "xx": np.full(len(made), covariance[0, 0]),
        "xy": np.full(len(made), covariance[0, 1]),
        "yy": np.full(len(made), covariance[1, 1]),
    }
    newest = np.arange(len(t)) // period
    for name, column in values.items():
        table["prediction_" + name] = column[newest]
    return table


_WAY = np.array(
    [
        [0.12, 0.1],
        [0.11, 0.0],
        [0.06, -0.09],
        [0.0, -0.07],
        [-0.05, -0.02],
        [-0.03, 0.05],
        [-0.09, 0.06],
        [-0.12, 0.0],
        [-0.11, 0.1],
    ]
)


def maze_grid(pixels=300):
    """Walls around a channel along the way, as attribute map has them: rows from the bottom."""
    centre = (np.arange(pixels) + 0.5) / pixels * 0.3 - 0.15
    x, y = np.meshgrid(centre, centre)
    way = _smooth_way(400)
    distance = np.min(np.hypot(x[..., None] - way[:, 0], y[..., None] - way[:, 1]), axis=-1)
    width = np.where(x < -0.04, 0.014, 0.045)
    return ["".join(row) for row in np.where(distance < width, ".", "#")]


def _smooth_way(count):
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.linspace(0, 1, len(_WAY)), _WAY)(np.linspace(0, 1, count))


def plausible_trial(participant=1, controller="lqr", trial=3, seed=7, grid=None):
    """A wandering run along a curved way with forces, contacts, limits and predictions of the usual sizes."""
    random = np.random.default_rng([seed, participant, trial, sum(controller.encode())])
    duration = 10.0 + random.normal(0.0, 0.7)
    ticks = int(duration / TICK)
    table = constant_trial(
        ticks,
        participant=participant,
        controller=controller,
        trial=trial,
        evaluated=trial == 3,
        seed=seed,
        experiment="maze_assistance",
        scene="maze",
        simulated_participants=True,
    )
    s = np.linspace(0, 1, ticks)
    s = s * s * (3 - 2 * s)
    way = _smooth_way(2000)
    knots = np.linspace(0, 1, 2000)
    wobble = [
        sum(random.normal(0, 0.002) * np.sin(2 * np.pi * (k * s + random.uniform())) for k in (2, 3, 5)) for _ in "xy"
    ]
    for i, name in enumerate("xy"):
        position = np.interp(s, knots, way[:, i]) + wobble[i] * np.sin(np.pi * s)
        table[name] = position
        table["v" + name] = np.gradient(position, TICK)
        acceleration = np.convolve(np.gradient(table["v" + name], TICK), np.ones(100) / 100, mode="same")
        gain = 0.0 if controller == "none" else 0.35
        noise = np.convolve(random.normal(0, 8, ticks), np.ones(80) / 80, mode="same")
        need = 200 * table["v" + name] + 90 * acceleration
        table["human_" + name] = (1 - gain) * need + noise
        table["assistance_" + name] = gain * need - 0.5 * noise * (gain > 0)
        table["requested_" + name] = table["assistance_" + name] * 1.3
        table["environment_" + name] = np.where(np.sin(40 * s + i) > 0.97, random.normal(0, 6), 0.0)
    table["limits"] = np.where(np.hypot(table["assistance_x"], table["assistance_y"]) > 9, 4, 0)
    table["limits"] |= np.where(random.uniform(size=ticks) < 0.01, 16, 0)
    table["state"] = np.where(table["t"] < 0.4, 2, 2 if controller == "none" else 3)
    table["tank"] = 0.3 + 0.2 * np.sin(s * 9)
    table = predict(
        table,
        random.multivariate_normal([0, 0], [[9e-6, 3e-6], [3e-6, 6e-6]], -(-ticks // PERIOD)),
        [[7e-6, 3e-6], [3e-6, 5e-6]],
    )
    table.attrs.update(
        start=[0.12, 0.1],
        goal=[-0.11, 0.1],
        obstacles=[{"center": [0.07, 0.0], "half_size": [0.02, 0.01], "amplitude": 0.04}],
    )
    if grid is not None:
        # the bag's resolution is a float
        table.attrs["map"] = {"grid": grid, "resolution": float(np.float32(0.3 / len(grid))), "origin": [-0.15, -0.15]}
    return trial_table.conform(table)
