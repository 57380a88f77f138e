"""Simulated participants against what the literature says about people: each property expected, found, met or missed.

Nothing is fitted to these properties; they were measured after the population was frozen. What is missed is a limit of
the model that whoever uses it should know. Leaves table.csv.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import optimize, signal

from phri_analysis import metrics, study

from . import _bench, _page, _people

PEOPLE = 8
SEED = 7
OBJECT = (90.0, 200.0)  # [kg], [Ns/m] of the thesis' maze
HAND_DAMPING = 10.0  # [Ns/m] of a hand that moves freely, as in published models of reaching
STOPPED = 0.05  # of the peak speed: the movement is over
PUSH = 10.0  # [N]
PRACTICE = 8  # trials of the learning curve
COLUMNS = ["property", "condition", "low", "high", "found", "unit", "met", "note"]


def row(name, condition, low, high, found, unit="", note="") -> dict:
    """`low`, `high`: None is no bound. A value that could not be found (NaN) misses."""
    low, high = (-np.inf if low is None else low), (np.inf if high is None else high)
    return dict(zip(COLUMNS, (name, condition, low, high, found, unit, bool(low <= found <= high), note)))


def minimum_jerk_r2(t: np.ndarray, speed: np.ndarray, distance: float) -> float:
    """Share of the variance of a speed profile that the best minimum-jerk movement of this distance explains; onset
    and duration are free (Flash and Hogan 1985)."""

    def profile(t, onset, duration):
        s = np.clip((t - onset) / duration, 0, 1)
        return distance / duration * 30 * s**2 * (1 - s) ** 2

    moving = t[speed > 0.05 * speed.max()]
    guess = (moving[0], moving[-1] - moving[0])
    found, _ = optimize.curve_fit(profile, t, speed, guess, bounds=([-np.inf, 0.05], np.inf))
    return float(1 - np.sum((speed - profile(t, *found)) ** 2) / np.sum((speed - speed.mean()) ** 2))


def reach(people: int, mass: float, damping: float, distance: float) -> list:
    """Straight reaches: R^2 of the speed against minimum jerk, and how far from the goal they rest; medians over
    people."""
    goal = np.array([-0.12 + distance, 0.0])
    # a goal too small to end the trial: the whole movement is seen
    loaded = _bench.experiment(_bench.free_room(), (-0.12, 0.0), goal.tolist(), mass, damping, 0.0005, timeout=8.0)
    fits, errors = [], []
    for person in range(people):
        table = _bench.move(loaded, person, SEED)
        t, speed = table["t"].to_numpy(), np.hypot(table["vx"], table["vy"]).to_numpy()
        after = np.arange(len(t)) > np.argmax(speed)
        stopped = np.flatnonzero(after & (speed < STOPPED * speed.max()))
        error = np.linalg.norm(table[["x", "y"]].to_numpy()[-1] - goal)
        if len(stopped) and error < distance / 4:
            fits.append(minimum_jerk_r2(t[: stopped[0]], speed[: stopped[0]], distance))
            errors.append(error)
    condition = f"{mass:g} kg, {damping:g} Ns/m, {100 * distance:g} cm"
    r2, error = (float(np.median(values)) if values else np.nan for values in (fits, errors))
    note = f"{len(fits)} of {people} come to rest near the goal"
    return [
        row("Speed of a reach is minimum jerk, R²", condition, 0.95, None, r2, "", note),
        row("Distance from the goal at rest", condition, None, 2.0, 1e3 * error, "mm", note),
    ]


def fitts(people: int, distances=(0.05, 0.1, 0.2), widths=(0.012, 0.024, 0.048)) -> list:
    """Time to reach targets of several distances and widths: slope over log2(2 D / W)."""
    rows = []
    for distance in distances:
        for width in widths:
            loaded = _bench.experiment(_bench.free_room(), (-0.12, 0), (-0.12 + distance, 0), *OBJECT, width / 2)
            times = [_bench.move(loaded, person, SEED)["t"].iloc[-1] for person in range(people)]
            rows.append((distance, width, np.mean(times)))
    distance, width, time = np.array(rows).T
    slope, offset = np.polyfit(np.log2(2 * distance / width), time, 1)
    # both parts of the difficulty on their own; by Fitts' law the slopes are one
    design = np.column_stack([np.log2(2 * distance), -np.log2(width), np.ones(len(time))])
    of_distance, of_width, _ = np.linalg.lstsq(design, time, rcond=None)[0]
    note = f"over distance alone {1e3 * of_distance:.0f}, over width alone {1e3 * of_width:.0f} ms/bit"
    return [row("Fitts' slope", "90 kg, 200 Ns/m", 80, 150, 1e3 * slope, "ms/bit", note)]


def two_thirds(people: int, mass: float, damping: float) -> dict:
    """Exponent of speed ~ curvature^-beta on the path that was moved, by regression of the logarithms away from the
    ends; median over people."""
    loaded = _bench.experiment(_bench.wave_room(0.05, 0.045, 0.13), (-0.1, 0.04), (0.1, -0.04), mass, damping)
    values = []
    for person in range(people):
        table = _bench.move(loaded, person, SEED).iloc[::10]
        if table.attrs["completed"]:
            values.append(_exponent(table["x"].to_numpy(), table["y"].to_numpy(), 0.01))
    found = float(np.median(values)) if values else np.nan
    note = f"{people} people, wave of 13 cm in a channel of 5 cm"
    return row("Exponent of speed over curvature", f"{mass:g} kg, {damping:g} Ns/m", 0.25, 0.4, found, "", note)


def _exponent(x, y, dt, low=5.0, high=100.0):
    """Curvature [1/m] from `low`, below which nobody is slowed, to `high`, beyond which it is noise."""
    window = 31  # [samples of 10 ms]
    d = [signal.savgol_filter(np.column_stack([x, y]), window, 3, deriv=k, delta=dt, axis=0) for k in (1, 2)]
    speed = np.hypot(*d[0].T)
    curvature = np.abs(d[0][:, 0] * d[1][:, 1] - d[0][:, 1] * d[1][:, 0]) / np.maximum(speed, 1e-6) ** 3
    s = np.cumsum(speed) * dt
    inner = (s > 0.03) & (s < s[-1] - 0.03) & (curvature > low) & (curvature < high)
    return -np.polyfit(np.log(curvature[inner]), np.log(speed[inner]), 1)[0]


def force_noise(seconds: float, offsets=(0.02, 0.05, 0.1, 0.15, 0.2)) -> list:
    """Isometric forces of the median person: the standard deviation over time is a line over the mean."""
    person = _bench.median_person(quiet=False)
    held = [_bench.hold_force(person, offset, seconds, seed) for seed, offset in enumerate(offsets)]
    mean, deviation = np.abs([h.mean() for h in held]), np.array([h.std() for h in held])
    slope, offset = np.polyfit(mean, deviation, 1)
    r2 = float(np.corrcoef(mean, deviation)[0, 1] ** 2)
    condition = f"held {mean.min():.0f} to {mean.max():.0f} N, {seconds:g} s each"
    return [
        row("SD of the force is linear in the force, R²", condition, 0.95, None, r2),
        row("Coefficient of variation of the force", condition, 2, 6, 100 * slope, "%", f"{offset:.2f} N at no force"),
    ]


def learning(people: int) -> list:
    """Trials 1, 2, ... of the maze without assistance: mean force over people against a + b exp(-n / tau)."""
    sim, loaded = _people.simulation(), _people.experiment()
    curves = []
    for person in range(people):
        # one trial's seed for all: what differs is practice alone
        specs = [sim.TrialSpec(person, "none", _people.TRIAL, _people.TRIAL, n, SEED) for n in range(PRACTICE)]
        curves.append([_mean_force(sim.run_alone(loaded, spec)) for spec in specs])
    curve, n = np.mean(curves, axis=0), np.arange(PRACTICE)
    try:
        fit, _ = optimize.curve_fit(_saturating, n, curve, (curve[-1], curve[0] - curve[-1], 2.0), maxfev=5000)
        r2 = 1 - np.sum((curve - _saturating(n, *fit)) ** 2) / np.sum((curve - curve.mean()) ** 2)
        note = f"from {curve[0]:.1f} to {curve[-1]:.1f} N, time constant {fit[2]:.1f} trials"
    except RuntimeError:
        r2, note = np.nan, "no exponential fits"
    return [row("Force over trials is exponential, R²", "maze, condition (a)", 0.95, None, float(r2), "", note)]


def _saturating(n, settled, gain, constant):
    return settled + gain * np.exp(-n / constant)


def _mean_force(table):
    return metrics.windows(table)["whole"].mean(np.hypot(table["human_x"], table["human_y"]).to_numpy()[:-1])


def step(mass: float, damping: float) -> dict:
    """A push of 10 N: acceleration over the first 10 ms against that of object and hand together."""
    person = _bench.median_person()
    velocity, _ = _bench.pushed(person, mass, damping, PUSH, by_robot=False)
    ratio = velocity[9] / (10 * _bench.DT) * (mass + person.hand_mass) / PUSH
    condition, note = f"{mass:g} kg, {damping:g} Ns/m", f"hand {person.hand_mass:g} kg; 1: hand and object are one mass"
    return row("Acceleration by a push over that of object and hand", condition, 0.95, 1.05, ratio, "", note)


def reflex(delay: float) -> dict:
    """When the force first differs from that of the same person with the longest reflex delay."""
    person, late = _bench.median_person(), _bench.median_person()
    person.reflex_delay, late.reflex_delay = delay, 0.12
    forces = [_bench.pushed(who, *OBJECT, PUSH, by_robot=False)[1] for who in (person, late)]
    differs = np.flatnonzero(np.abs(forces[0] - forces[1]) > 1e-9)
    onset = float(differs[0]) if len(differs) else np.nan
    low, high = 1e3 * delay - 1, 1e3 * delay + 3  # the muscle's two lags pass on nothing in their first ticks
    return row("Onset of the reflex after a push", f"delay {1e3 * delay:g} ms", low, high, onset, "ms")


def early() -> dict:
    """How much of a push by the robot is answered before the reflex delay by more than stiffness: the same push by
    nobody known is answered by stiffness alone."""
    person = _bench.median_person()
    forces = [_bench.pushed(person, *OBJECT, PUSH, by_robot)[1] for by_robot in (True, False)]
    at = round(person.reflex_delay / _bench.DT)
    found = abs(forces[0][at] - forces[1][at])
    note = "the model's expectation of the robot's help has no delay of its own"
    return row("Answer to a push of the robot before the reflex", f"{PUSH:g} N", None, 0.05, found, "N", note)


def stability() -> dict:
    """A person of any stiffness holds objects of any mass still."""
    cases, held = [(m, k) for m in (1.0, 10.0, 100.0) for k in (80.0, 220.0, 900.0)], 0
    for mass, stiffness in cases:
        person = _bench.median_person()
        person.stiffness = stiffness
        held += _bench.settles(person, mass, OBJECT[1])
    note = "1 to 100 kg, arms of 80 to 900 N/m"
    return row("Objects held still, of 9", f"{OBJECT[1]:g} Ns/m", len(cases), None, held, "", note)


def table(people: int, seconds: float = 20.0) -> pd.DataFrame:
    hand = _bench.median_person().hand_mass
    rows = [
        *reach(people, hand, HAND_DAMPING, 0.1),
        *reach(people, *OBJECT, 0.1),
        *reach(people, *OBJECT, 0.2),
        *fitts(people),
        two_thirds(people, *OBJECT),
        two_thirds(people, 10.0, 80.0),
        *force_noise(seconds),
        *learning(people),
        step(*OBJECT),
        step(10.0, 80.0),
        reflex(0.06),
        reflex(0.1),
        early(),
        stability(),
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def read_table(path) -> pd.DataFrame:
    """table.csv as `table` made it."""
    return study.read_table(path).fillna({"unit": "", "note": ""})


def rows_of_text(found: pd.DataFrame) -> tuple:
    def bound(entry):
        unit = f" {entry.unit}" if entry.unit else ""
        if np.isinf(entry.low):
            return f"at most {entry.high:g}{unit}"
        return f"at least {entry.low:g}{unit}" if np.isinf(entry.high) else f"{entry.low:g} to {entry.high:g}{unit}"

    def value(entry):
        return "none" if np.isnan(entry.found) else f"{entry.found:.3g}{' ' + entry.unit if entry.unit else ''}"

    rows = [
        [e.property, e.condition, bound(e), value(e), "met" if e.met else "**missed**", e.note]
        for e in found.itertuples()
    ]
    return ["Property", "Condition", "Expected", "Found", "", "Remark"], rows


def run(options) -> list:
    people = options.people or PEOPLE
    found = table(people)
    _page.write_csv(found, options.out / "table.csv")
    _page.write_session(options.out, "validation", {"seed": SEED, "participants": people})
    head, rows = rows_of_text(found)
    _page.write_page(
        options.out, "Validation of the simulated participants",
        f"{people} simulated participants of seed {SEED}, or the one of all medians. Nothing was fitted to these "
        "properties.", [_page.Section("Properties", head, rows)],
    )  # fmt: skip
    return [_page.aligned(head, rows), "", f"table:  {Path(options.out) / 'table.csv'}",
            f"report: {Path(options.out) / 'report.html'}"]
