"""Tools for bringing up a robot: `calibrate` (payload and bias of a force/torque sensor from poses at rest) and
`measure_delay` (delay of a loop, and the contact stiffness that it admits).

A recording of poses is
- .npz: `R` (N, 3, 3) or `q` (N, 4) as x, y, z, w; `wrench` (N, 6); `t` (N,) [s] if it is continuous,
- .csv: columns qx, qy, qz, qw, fx, fy, fz, tx, ty, tz; t likewise,
- .bag: a pose and a wrench topic.
Orientations map the sensor's frame into an inertial frame, z up. Wrenches are raw readings, exerted BY what is beyond
the sensor ON the robot, force first [N, Nm]. Without times every row is one pose at rest; with times the stretches at
rest are found.

A recording of a loop is .npz or .csv with `t` and two named columns, or a .bag with two fields of topics.
The numerics are phri_control's.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import DataError, MissingInputError, UsageError

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
BLOCK = 0.1  # [s] rest is judged over
REST_TURN = 0.003  # [rad] largest turn from the first sample of a stretch on
REST_SCATTER = (0.5, 0.05)  # [N, Nm] largest standard deviation per axis in a block
REST_TIME = 0.5  # [s] shortest stretch, its first and last block not counted
GRAVITY = 9.81  # [m/s^2]
# Admittances of the thesis: where, mass [kg, kgm2], damping [Ns/m, Nms/rad]
ADMITTANCES = (
    ("5.1.1 maze", 40.0, 90.0),
    ("5.1.2 transport", 15.0, 80.0),
    ("5.1.2 transport, yaw", 0.3, 7.0),
    ("5.3.4 maze 1", 90.0, 200.0),
    ("5.3.4 maze 2", 100.0, 400.0),
    ("5.4 contact", 10.0, 80.0),
)


@dataclass(frozen=True)
class Calibration:
    """`estimate`: phri_control.PayloadEstimate; `when`: what each pose is called."""

    estimate: object
    when: tuple

    def worst(self) -> tuple:
        """(name of the pose, residual force [N], residual torque [Nm]) where the model fits worst."""
        force, torque = (np.linalg.norm(part, axis=1) for part in np.hsplit(self.estimate.residuals, 2))
        worst = int(np.argmax(force / max(force.max(), 1e-12) + torque / max(torque.max(), 1e-12)))
        return self.when[worst], force[worst], torque[worst]

    def lines(self) -> list:
        """For people; deviations are of 95 %."""
        e, (name, force, torque) = self.estimate, self.worst()
        spread = 2 * np.array([e.mass_deviation, *e.centre_deviation])
        weight = e.payload.mass * GRAVITY
        return [
            f"poses      {len(self.when)}, condition number {e.condition:.2f} (ideal 1.2)",
            f"mass       {e.payload.mass:.4f} +- {spread[0]:.4f} kg",
            *(f"centre {axis}   {1e3 * value:.2f} +- {1e3 * width:.2f} mm"
              for axis, value, width in zip("xyz", e.payload.centre, spread[1:])),
            *(f"bias {axis}    {value:.4f} +- {2 * width:.4f} {'N' if axis[0] == 'f' else 'Nm'}"
              for axis, value, width in zip(AXES, e.bias, e.bias_deviation)),
            f"residual   {e.force_residual:.4f} N ({100 * e.force_residual / weight:.2f} % of the weight), "
            f"{e.torque_residual:.5f} Nm, rms per axis",
            f"worst pose {name}: {force:.4f} N, {torque:.5f} Nm",
        ]  # fmt: skip

    def yaml(self) -> str:
        """The part of a robot's configuration that holds it."""
        e = self.estimate

        def row(values):
            return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"

        return (
            "ft_sensor:\n  payload:\n"
            f"    mass: {e.payload.mass:.6g}    # [kg]\n"
            f"    centre: {row(e.payload.centre)}    # [m] in the sensor's frame\n"
            f"  bias: {row(e.bias)}    # [N, Nm] reading without load\n"
        )


def calibrate(path, pose: str = "", wrench: str = "", max_residual: float = 0.5) -> Calibration:
    """Raises MissingInputError, DataError with the cause; also where the rms residual is above `max_residual` [N] (a
    tenth of it in Nm), naming the pose that fits worst."""
    path = Path(path)
    t, orientations, wrenches = _poses(path, pose, wrench)
    if t is None:
        when = tuple(f"{row}" for row in range(len(wrenches)))
    else:
        stretches = rests(t, orientations, wrenches)
        control = _control()
        if len(stretches) < control.FEWEST_POSES:
            raise DataError(
                f"{path}: {len(stretches)} stretches at rest of {REST_TIME} s or more in {t[-1] - t[0]:.1f} s, "
                f"expected at least {control.FEWEST_POSES}"
            )
        when = tuple(f"{number} (t = {t[part][0]:.1f} s)" for number, part in enumerate(stretches))
        orientations = np.array([orientations[(part.start + part.stop) // 2] for part in stretches])
        wrenches = np.array([wrenches[part].mean(axis=0) for part in stretches])
    try:
        found = Calibration(_control().identify_payload(orientations, wrenches), when)
    except ValueError as error:
        raise DataError(f"{path}: {error}") from None
    e = found.estimate
    if e.force_residual > max_residual or e.torque_residual > 0.1 * max_residual:
        name, force, torque = found.worst()
        raise DataError(
            f"{path}: the residual is {e.force_residual:.3f} N and {e.torque_residual:.4f} Nm rms, expected at most "
            f"{max_residual} N and {0.1 * max_residual} Nm; worst is pose {name} with {force:.3f} N, {torque:.4f} Nm: "
            "something touched the tool, or the orientations are not the sensor's"
        )
    return found


def rests(t, orientations, wrenches) -> list:
    """Slices of the samples at rest: orientation and wrench steady, first and last block left out."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1] + 0.5 * BLOCK, BLOCK))
    found, begin = [], None

    def close(end):
        if begin is not None and end - begin >= 3:
            part = slice(edges[begin + 1], edges[end - 1])
            if t[part.stop - 1] - t[part.start] >= REST_TIME - BLOCK / 2:
                found.append(part)

    for block, (low, high) in enumerate(zip(edges[:-1], edges[1:])):
        steady = high - low >= 3 and all(
            wrenches[low:high, axes].std(axis=0).max() <= bound
            for axes, bound in zip((slice(0, 3), slice(3, 6)), REST_SCATTER)
        )
        first = orientations[edges[begin] if begin is not None else low]
        # |R - R'| in the Frobenius norm is sqrt(2) times a small angle
        turned = np.linalg.norm(orientations[low:high] - first, axis=(1, 2)).max(initial=0.0) / np.sqrt(2.0)
        if steady and turned <= REST_TURN:
            begin = block if begin is None else begin
            continue
        close(block)
        begin = None
        if steady:
            turned = np.linalg.norm(orientations[low:high] - orientations[low], axis=(1, 2)).max() / np.sqrt(2.0)
            begin = block if turned <= REST_TURN else None
    close(len(edges) - 1)
    return found


@dataclass(frozen=True)
class Delay:
    """`estimate`: phri_control.DelayEstimate; `dt` [s] between samples; `admittances` as ADMITTANCES."""

    estimate: object
    dt: float
    admittances: tuple

    def lines(self) -> list:
        """For people; deviations are of 95 %."""
        e = self.estimate
        both = [
            f"delay T      {1e3 * e.delay:.2f} +- {2e3 * e.delay_deviation:.2f} ms",
            f"lag          {1e3 * e.lag:.2f} +- {2e3 * e.lag_deviation:.2f} ms, first order",
        ]
        return [
            *(both if e.lag_identified else ["lag          not told apart from delay by this recording"]),
            f"total        {1e3 * e.total:.2f} +- {2e3 * e.total_deviation:.2f} ms (samples every {1e3 * self.dt:g}"
            " ms)",
            f"gain         {e.gain:.4f}, explains {100 * e.explained:.2f} % of the response (correlation "
            f"{e.correlation:.3f})",
            "",
            f"{'admittance':<22}{'mass':>8}{'damping':>9}{'D/T':>11}{'stable to':>11}{'work below':>12}",
            *(self._row(*admittance) for admittance in self.admittances),
            "mass [kg, kgm2], damping [Ns/m, Nms/rad], stiffness [N/m, Nm/rad]; T is the total. Work below half of "
            "what is stable: a gain margin of 2.",
        ]  # fmt: skip

    def _row(self, name, mass, damping):
        e = self.estimate
        rule = damping / e.total if e.total > 0.0 else np.inf
        exact = _control().admitted_stiffness(mass, damping, e.delay, e.lag)
        return f"{name:<22}{mass:>8g}{damping:>9g}{rule:>11.0f}{exact:>11.0f}{exact / 2:>12.0f}"


def measure_delay(path, command="command", response="response", max_delay=0.2, admittance=None) -> Delay:
    """`command` and `response`: columns or, of a bag, TOPIC:FIELD. `admittance`: (mass, damping) of one's own. Raises
    MissingInputError, UsageError, DataError with the cause."""
    path = Path(path)
    if admittance is not None and not all(0.0 < value < np.inf for value in admittance):
        raise UsageError(f"admittance {admittance[0]:g} kg, {admittance[1]:g} Ns/m: expected two positive numbers")
    if path.suffix == ".bag":
        from .bag_lab import signals

        recorded = signals(path, (command, response))
    else:
        columns = _columns(path, ("t", command, response))
        recorded = [(columns["t"], columns[name]) for name in (command, response)]
    dt, (first, second) = _uniform(path, recorded)
    try:
        estimate = _control().estimate_delay(first, second, dt, max_delay)
    except ValueError as error:
        raise DataError(f"{path}: {error}") from None
    own = () if admittance is None else (("yours", *admittance),)
    return Delay(estimate, dt, own + ADMITTANCES)


def _uniform(path, recorded):
    """Both signals on one grid, with the longer of the two median steps, over the time that both have."""
    for times, values in recorded:
        if not np.isfinite(times).all():
            raise DataError(f"{path}: a time is not finite")
        if len(times) < 2 or not (np.diff(times) >= 0.0).all() or len(times) != len(values):
            raise DataError(f"{path}: times of {len(times)} samples, expected at least 2 that rise")
    kept = [(times[keep], values[keep]) for times, values in recorded
            for keep in [np.diff(times, prepend=-np.inf) > 0.0]]  # fmt: skip
    dt = max(float(np.median(np.diff(times))) for times, _ in kept)
    begin, end = max(times[0] for times, _ in kept), min(times[-1] for times, _ in kept)
    if end - begin < 2 * dt:
        raise DataError(f"{path}: command and response overlap by {end - begin:.3f} s")
    grid = begin + dt * np.arange(int((end - begin) / dt + 1e-6) + 1)
    return dt, [np.interp(grid, times, values) for times, values in kept]


def _poses(path, pose, wrench):
    """t or None, orientations (N, 3, 3), wrenches (N, 6)."""
    if path.suffix == ".bag":
        from .bag_lab import poses_and_wrenches

        t, q, wrenches = poses_and_wrenches(path, pose, wrench)
        return t, _rotations(path, q), wrenches
    if path.suffix == ".csv":
        columns = _columns(path, ("qx", "qy", "qz", "qw", *AXES), optional=("t",))
        q = np.stack([columns[name] for name in ("qx", "qy", "qz", "qw")], axis=1)
        wrenches = np.stack([columns[name] for name in AXES], axis=1)
        return _times(path, columns.get("t"), len(q)), _rotations(path, q), wrenches
    arrays = _arrays(path)
    if "wrench" not in arrays or not ("R" in arrays) ^ ("q" in arrays):
        raise DataError(f"{path}: arrays {', '.join(sorted(arrays)) or 'none'}; expected wrench (N, 6) and R or q")
    wrenches = arrays["wrench"]
    count = len(wrenches) if wrenches.ndim else 0
    name, shape = ("R", (count, 3, 3)) if "R" in arrays else ("q", (count, 4))
    if wrenches.shape != (count, 6) or arrays[name].shape != shape:
        raise DataError(
            f"{path}: wrench {wrenches.shape} and {name} {arrays[name].shape}, expected (N, 6) and (N, {shape[1:]})"
        )
    orientations = arrays["R"] if name == "R" else _rotations(path, arrays["q"])
    return _times(path, arrays.get("t"), count), orientations, wrenches


def _times(path, t, count):
    if t is not None and (t.shape != (count,) or count < 2 or not (np.diff(t) > 0.0).all()):
        raise DataError(f"{path}: t of shape {t.shape}, expected ({count},) that rises")
    return t


def _rotations(path, q):
    length = np.linalg.norm(q, axis=1)
    bad = np.flatnonzero(~(np.abs(length - 1.0) <= 1e-3))
    if bad.size:
        raise DataError(f"{path}: quaternion {bad[0]} has the length {length[bad[0]]:.4g}, expected 1")
    x, y, z, w = (q / length[:, None]).T
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w),
            1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w),
            1 - 2 * (x * x + y * y)]  # fmt: skip
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def _columns(path, names, optional=()):
    """Named columns of a .csv or .npz as arrays of numbers."""
    table = _arrays(path)
    missing = [name for name in names if name not in table]
    if missing:
        raise DataError(f"{path}: no column {', '.join(missing)}; found {', '.join(sorted(table)) or 'none'}")
    kept = {name: table[name] for name in (*names, *optional) if name in table}
    shapes = {values.shape for values in kept.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise DataError(f"{path}: columns of shapes {sorted(shapes)}, expected (N,) each")
    return kept


def _arrays(path):
    if not path.exists():
        raise MissingInputError(f"{path}: no such file")
    try:
        if path.suffix == ".csv":
            import pandas as pd

            table = pd.read_csv(path, skipinitialspace=True, float_precision="round_trip")
            return {str(name): table[name].to_numpy(dtype=float) for name in table.columns}
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as file:
                return {name: file[name].astype(float) for name in file.files}
    except Exception as error:  # zip, numpy and pandas each have their own
        raise DataError(f"{path}: not readable: {type(error).__name__}: {error}") from None
    raise DataError(f"{path}: unknown kind, expected .npz, .csv or .bag")


def _control():
    try:
        import phri_control
    except ImportError as error:
        raise MissingInputError(f"module phri_control is needed, build the workspace first ({error})") from None
    return phri_control
