"""On-line and off-line segmentation of kinesthetic demonstrations against labels set by hand, with one fixed setting.

Data: icsc_kinesthetic_ft.npz, arrays of the public ICSC-HMM test data (Figueroa and Billard), which may not be shipped;
its path is --data or in the environment variable PHRI_ICSC_DATA. Every demonstration is resampled to 20 Hz and cut by
its hand's velocity alone, a difference of past positions. A cut within 5 % of the demonstration's length of a label
is right, each label counts once; F1 is taken over all cuts of a set. The boundaries still open when a demonstration
ends are what `finish` makes of them.

CHOSEN names the demonstrations on which window, switch cost, lag and scale were chosen; an earlier choice on rim 0-2
and grating 0-3 had not carried over to the others, which is how its members came to be one of each person.
The grating demonstrations of one person are nearly copies of each other, so those left out are not quite independent.
table.csv has a row per demonstration: set, cuts found and labelled, delays. No person is simulated here.
"""

import os
from pathlib import Path

import numpy as np
import pandas as pd

from phri_analysis.errors import DataError, MissingInputError

from . import _page

TITLE = "Segmentation of recorded motions"
TAKES_DATA = True
VARIABLE = "PHRI_ICSC_DATA"
DT = 0.05  # [s]
DT_UNSTATED = 0.01  # [s] of the recordings where the file names no sampling time: grating, peeling
TOLERANCE = 0.05  # of a demonstration's length
SCALE = 0.1  # [m/s] speed of a guided hand
SETTING = {"window": 24, "switch_cost": 9.5, "lag": 35, "slack": 3, "horizon": 600}
SETS = {"rim": 6, "grating": 12, "peeling": 2}
CHOSEN = {"rim": (0, 2, 4), "grating": (0, 4, 8), "peeling": ()}


def read(path) -> dict:
    """{set: [(velocities (T, 3), label times [s], length [s]), ..]}."""
    try:
        with np.load(path) as data:
            return {name: [_demonstration(data, name, i) for i in range(count)] for name, count in SETS.items()}
    except FileNotFoundError:
        raise MissingInputError(f"{path}: no such file") from None
    except (OSError, KeyError, ValueError) as error:
        raise DataError(f"{path}: not the expected arrays: {error}") from None


def _demonstration(data, name, i):
    array = "peeling_active" if name == "peeling" else name
    labels = np.ravel(data[f"{name}_label_{i}"])
    positions = data[f"{array}_X_{i}"][: len(labels), :3].astype(float)
    dt = float(data[f"{array}_dt_{i}"]) if f"{array}_dt_{i}" in data.files else DT_UNSTATED
    given = np.arange(len(positions)) * dt
    times = np.arange(0.0, given[-1], DT)
    resampled = np.stack([np.interp(times, given, column) for column in positions.T], axis=1)
    cuts = (np.flatnonzero(np.diff(labels)) + 1) * dt
    return np.diff(resampled, axis=0) / DT, cuts, given[-1]


def options(dimension: int):
    import phri_learning

    result = phri_learning.SegmentationOptions()
    for key, value in SETTING.items():
        setattr(result, key, value)
    result.dt = DT
    result.scale = np.full(dimension, SCALE)
    return result


def online(velocities) -> list:
    """All boundaries: those committed on the way, then those of the end."""
    import phri_learning

    segmentation = phri_learning.OnlineSegmentation(options(velocities.shape[1]), velocities.shape[1])
    committed = [found for found in map(segmentation.push, velocities) if found is not None]
    return committed + segmentation.finish()


def offline(velocities) -> list:
    import phri_learning

    return phri_learning.segment_offline(velocities, options(velocities.shape[1]))


def hits(found, labels, tolerance: float) -> int:
    """How many labels have a cut of their own within the tolerance: the most that any pairing reaches."""
    found, count = sorted(found), 0
    for label in sorted(labels):
        near = next((cut for cut in found if abs(cut - label) <= tolerance), None)
        if near is not None:
            found.remove(near)
            count += 1
    return count


def f1(rows: pd.DataFrame, way: str) -> float:
    both = rows[f"{way}_found"].sum() + rows["labelled"].sum()
    return 2.0 * rows[f"{way}_hits"].sum() / both if both else float("nan")


def table(sets: dict) -> pd.DataFrame:
    rows = []
    for name, demonstrations in sets.items():
        for i, (velocities, labels, length) in enumerate(demonstrations):
            row = {"set": name, "demonstration": i, "chosen_on": i in CHOSEN[name], "length": length,
                   "labelled": len(labels)}  # fmt: skip
            for way, segment in (("online", online), ("offline", offline)):
                found = segment(velocities)
                row[f"{way}_found"] = len(found)
                row[f"{way}_hits"] = hits([b.time for b in found], labels, TOLERANCE * length)
                if way == "online":
                    on_the_way = [b.delay * DT for b in found if b.index + b.delay < len(velocities) - 1]
                    row["committed_before_end"] = len(on_the_way)
                    row["delay"] = float(np.mean(on_the_way)) if on_the_way else float("nan")
            rows.append(row)
    return pd.DataFrame(rows)


def summary(rows: pd.DataFrame) -> tuple:
    """(header, rows) of text."""
    header = ["Set", "Demonstrations", "Labels", "F1 on-line", "F1 off-line", "Mean delay [s]"]
    result = []
    for name in dict.fromkeys(rows["set"]):
        whole = rows[rows["set"] == name]
        for text, part in (("all", whole), ("chosen on", whole[whole["chosen_on"]]),
                           ("left out", whole[~whole["chosen_on"]])):  # fmt: skip
            if len(part):
                result.append([name, f"{len(part)}, {text}", str(part["labelled"].sum()), f"{f1(part, 'online'):.2f}",
                               f"{f1(part, 'offline'):.2f}", f"{part['delay'].mean():.1f}"])  # fmt: skip
    return header, result


def run(options) -> list:
    path = options.data or os.environ.get(VARIABLE)
    if not path:
        what = "it names icsc_kinesthetic_ft.npz, which may not be shipped"
        raise MissingInputError(f"no --data, and {VARIABLE} is not set: {what}")
    rows = table(read(path))
    _page.write_csv(rows, options.out / "table.csv")
    _page.write_record(options.out, "segmentation", {"data": Path(path).name, "dt": DT, "scale": SCALE,
                                                     "tolerance": TOLERANCE, **SETTING})  # fmt: skip
    sections = [_page.Section("F1 against the labels", *summary(rows))]
    page = _page.write_page(options.out, TITLE, __doc__.partition("\n\n")[2], sections, simulated=False)
    return [_page.aligned(*summary(rows)), "", f"table:  {options.out / 'table.csv'}", f"report: {page}"]
