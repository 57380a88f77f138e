"""Demonstrations of movements from files: what a study of learning runs on.

`load(path)` takes
- a .mat file of the LASA handwriting set, the folder of them, or the folder above it (`DataSet`). Each file is one
  movement: a cell array `demos` of structs with `pos` (2, T) [mm] and `t` (1, T) [s]; the set itself is not shipped.
- an .npz file with arrays `pos_0`, `pos_1`, ... (T, d) [m] and one number `Ts` [s]: one movement, one array per
  demonstration; forces `F_0`, `F_1`, ... (T, d) [N] if it has them.
- a folder of .csv files (header line with t, x, y and possibly z; forces fx, fy, fz) or .npz files (arrays `t` (T,) and
  `pos` (T, d); forces `F` (T, d)), one demonstration per file [s, m, N]: one movement.

Positions are returned in metres. Velocities in the files are not read: in more than one public set they do not agree
with the positions. Either all demonstrations of a movement have forces or none. DataError names the file, what is wrong
and what was expected.
"""

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import DataError, MissingInputError

MILLIMETRE = 1e-3  # LASA's unit of length [m]
FEWEST_SAMPLES = 10
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Demonstration:
    """`t` (T,) [s], rising; `x` (T, d) [m]; `force` (T, d) [N] or None; `name` says where it was read from."""

    name: str
    t: np.ndarray
    x: np.ndarray
    force: np.ndarray | None = None

    def times(self, dt: float) -> np.ndarray:
        """Every `dt` from the first sample on."""
        return self.t[0] + dt * np.arange(int(np.floor((self.t[-1] - self.t[0]) / dt + 1e-6)) + 1)

    def resampled(self, dt: float) -> np.ndarray:
        """Positions (N, d) every `dt` from the first sample on, linear between samples."""
        grid = self.times(dt)
        return np.stack([np.interp(grid, self.t, column) for column in self.x.T], axis=1)

    def resampled_force(self, dt: float) -> np.ndarray:
        """Forces (N, d) at the same times: means over the `dt` before, since a sensor's noise is not the person's.
        The first one is the first sample."""
        areas = np.diff(self.t)[:, None] * (self.force[1:] + self.force[:-1]) / 2.0
        integral = np.vstack([np.zeros(self.force.shape[1]), np.cumsum(areas, axis=0)])
        grid = self.times(dt)
        past = np.stack([np.interp(grid, self.t, column) for column in integral.T], axis=1)
        return np.vstack([self.force[:1], np.diff(past, axis=0) / dt])


@dataclass(frozen=True)
class Movement:
    """Demonstrations of the same movement, at least one, all of the same dimension."""

    name: str
    demonstrations: tuple


def load(path) -> list:
    """The movements of a file or folder, by name."""
    path = Path(path)
    if not path.exists():
        raise MissingInputError(f"{path}: no such file or folder")
    if path.is_dir():
        return _folder(path)
    if path.suffix == ".mat":
        return [_lasa(path)]
    if path.suffix == ".npz":
        return [_numbered(path)]
    raise DataError(f"{path}: unknown kind, expected .mat (LASA), .npz (pos_0, pos_1, ..., Ts) or a folder")


def _folder(path):
    for folder in (path, path / "DataSet"):
        files = sorted(folder.glob("*.mat"))
        if files:
            return [_lasa(file) for file in files]
    found = {suffix: sorted(path.glob(f"*{suffix}")) for suffix in (".csv", ".npz")}
    found = {suffix: files for suffix, files in found.items() if files}
    if not found:
        raise MissingInputError(f"{path}: no .mat, .csv or .npz file in this folder")
    if len(found) > 1:
        raise DataError(f"{path}: .csv and .npz files side by side, expected one kind")
    read = _csv if ".csv" in found else _single
    return [movement(path, [read(file) for file in next(iter(found.values()))])]


def movement(path, demonstrations):
    """A movement named as the file; DataError where dimensions or forces differ."""
    first = demonstrations[0]
    for other in demonstrations:
        if other.x.shape[1] != first.x.shape[1]:
            raise DataError(
                f"{other.name}: {other.x.shape[1]} dimensions, expected {first.x.shape[1]} as in {first.name}"
            )
        if (other.force is None) != (first.force is None):
            raise DataError(f"{other.name} and {first.name}: one has forces, expected all demonstrations or none")
    return Movement(path.stem, tuple(demonstrations))


def _demonstration(name, t, x, unit=1.0, force=None):
    """Checks shapes and values; drops samples that repeat a time, as recorders write them."""
    try:
        t, x = np.asarray(t, dtype=float).ravel(), np.asarray(x, dtype=float)
        force = None if force is None else np.asarray(force, dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{name}: positions, times or forces are not numbers") from None
    if x.ndim != 2 or x.shape[0] != t.size or not 1 <= x.shape[1] <= 6:
        raise DataError(f"{name}: {t.size} times and positions of shape {x.shape}, expected ({t.size}, 1 to 6)")
    if force is not None and force.shape != x.shape:
        raise DataError(f"{name}: forces of shape {force.shape}, expected {x.shape} as the positions")
    if t.size < FEWEST_SAMPLES:
        raise DataError(f"{name}: {t.size} samples, expected at least {FEWEST_SAMPLES}")
    bad = np.flatnonzero(~(np.isfinite(t) & np.isfinite(x if force is None else x + force).all(axis=1)))
    if bad.size:
        raise DataError(f"{name}: sample {bad[0]} is not finite")
    falling = np.flatnonzero(np.diff(t) < 0.0)
    if falling.size:
        raise DataError(f"{name}: time falls after sample {falling[0]}, expected rising times")
    keep = np.diff(t, prepend=t[0] - 1.0) > 0.0
    return Demonstration(name, t[keep], unit * x[keep], None if force is None else force[keep])


def _lasa(path):
    import scipy.io

    try:
        content = scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError:  # MATLAB 7.3 files are HDF5
        raise DataError(f"{path}: MATLAB 7.3 file, expected version 5 to 7 as in the official release") from None
    except Exception as error:  # scipy's reader raises whatever the damage leads it to
        raise DataError(f"{path}: not readable as a .mat file: {type(error).__name__}: {error}") from None
    if "demos" not in content:
        names = ", ".join(sorted(name for name in content if not name.startswith("__"))) or "none"
        raise DataError(f"{path}: no variable 'demos', expected a cell array of structs; found: {names}")
    result = []
    for index, demo in enumerate(np.atleast_1d(content["demos"])):
        name = f"{path}: demos{{{index + 1}}}"
        missing = [field for field in ("pos", "t") if not hasattr(demo, field)]
        if missing:
            raise DataError(f"{name}: no field {missing[0]!r}, expected a struct with pos (2, T) and t (1, T)")
        result.append(_demonstration(name, demo.t, np.atleast_2d(demo.pos).T, MILLIMETRE))
    return movement(path, result)


def _arrays(path):
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise DataError(f"{path}: not readable as an .npz file: {error}") from None


def _numbered(path):
    arrays = _arrays(path)
    numbers = sorted(int(match.group(1)) for match in (re.fullmatch(r"pos_(\d+)", name) for name in arrays) if match)
    if not numbers or "Ts" not in arrays:
        found = ", ".join(sorted(arrays)) or "none"
        raise DataError(f"{path}: expected arrays pos_0, pos_1, ... and Ts; found: {found}")
    step = np.asarray(arrays["Ts"])
    if step.size != 1 or step.dtype.kind not in "fiu" or not 0.0 < float(step.item()) < np.inf:
        raise DataError(f"{path}: Ts is {arrays['Ts']}, expected one positive number of seconds")
    result = []
    for number in numbers:
        x = arrays[f"pos_{number}"]
        times = float(step.item()) * np.arange(len(x))
        result.append(_demonstration(f"{path}: pos_{number}", times, x, force=arrays.get(f"F_{number}")))
    return movement(path, result)


def _single(path):
    arrays = _arrays(path)
    missing = [name for name in ("t", "pos") if name not in arrays]
    if missing:
        found = ", ".join(sorted(arrays)) or "none"
        raise DataError(f"{path}: no array {missing[0]!r}, expected t (T,) [s] and pos (T, d) [m]; found: {found}")
    return _demonstration(str(path), arrays["t"], arrays["pos"], force=arrays.get("F"))


def _csv(path):
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True, float_precision="round_trip")
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise DataError(f"{path}: not readable as CSV: {error}") from None
    columns = [axis for axis in AXES if axis in table.columns]
    if "t" not in table.columns or "x" not in columns:
        raise DataError(f"{path}: columns {', '.join(map(str, table.columns))}; expected t, x, y and possibly z")
    forces = [f"f{axis}" for axis in columns if f"f{axis}" in table.columns]
    if forces and len(forces) != len(columns):
        raise DataError(f"{path}: forces {', '.join(forces)} for positions {', '.join(columns)}, expected one each")
    return _demonstration(str(path), table["t"], table[columns], force=table[forces] if forces else None)
