"""Many trials: one tidy table, and what pictures and report need besides it.

A `Study` takes trials one at a time and keeps only their measures, a thinned track, and the full tables of a few
examples, so that thousands of trials fit into memory. Studies of parts (one per process) merge into the study of the
whole; the order of the parts does not matter, because every table is sorted.
"""

import csv
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from . import metrics, trial_table
from .errors import DataError, MissingInputError, OutputError
from .style import controller_order

KEYS = (
    "experiment",
    "scene",
    "participant",
    "controller",
    "trial",
    "subtask",
    "evaluated",
    "completed",
    "seed",
    "limited",
)
TRACK_STEP = 20  # rows; a track at 50 Hz is all that a picture of the maze shows
TRACKED_PARTICIPANTS = 12  # more lines in one picture cannot be told apart


def study_table(trials) -> pd.DataFrame:
    """One row per participant x controller x trial x subtask with every measure, sorted. `trials` are trial tables."""
    rows = []
    for trial in trials:
        attrs = trial.attrs
        setting = {
            "experiment": str(attrs.get("experiment", "")),
            "scene": str(attrs.get("scene", "")),
            "participant": attrs["participant"],
            "controller": attrs["controller"],
            "trial": attrs["trial"],
            "evaluated": bool(attrs.get("evaluated", True)),
            "completed": bool(attrs.get("completed", True)),
            "seed": int(attrs.get("seed", -1)),
        }
        rows += [{**setting, **row} for row in metrics.evaluate(trial)]
    return tidy(pd.DataFrame(rows))


def tidy(table: pd.DataFrame) -> pd.DataFrame:
    """Rows and columns in their one order; a limit that a trial never met because its library did not name it is 0."""
    if table.empty:
        raise DataError("no trial to tabulate, expected at least one")
    measures = [name for name in metrics.all_measures(table.columns) if name in table.columns]
    late = [name for name in measures if name.startswith("limited_bit_")]
    table = table.assign(
        **{name: table[name].fillna(0.0) for name in late},
        _controller=table["controller"].map(controller_order),
        _subtask=table["subtask"].map(metrics.SUBTASKS.index),
    )
    table = table.sort_values(["experiment", "participant", "_controller", "trial", "_subtask"], kind="stable")
    return table[[*KEYS, *measures]].reset_index(drop=True)


def write_table(table: pd.DataFrame, path) -> None:
    """CSV whose bytes depend on the numbers only: shortest text that reads back to the same double, \\n, empty for
    NaN."""

    def text(value):
        if isinstance(value, (bool, np.bool_)):
            return "true" if value else "false"
        if isinstance(value, (float, np.floating)):
            return "" if np.isnan(value) else repr(float(value))
        return str(value)

    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows([text(value) for value in row] for row in table.itertuples(index=False, name=None))
    except OSError as error:
        raise OutputError(f"{path}: cannot write the table: {os.strerror(error.errno)}") from None


def read_table(path) -> pd.DataFrame:
    """What `write_table` wrote, every double unchanged."""
    if not Path(path).is_file():
        raise MissingInputError(f"{path}: no such table")
    # Only an empty field is NaN: pandas would otherwise take a controller called "null" or "NA" for one.
    return pd.read_csv(
        path,
        float_precision="round_trip",
        keep_default_na=False,
        na_values=[""],
        dtype={"controller": str, "experiment": str, "scene": str, "subtask": str},
    )


def judged(table: pd.DataFrame) -> pd.DataFrame:
    """The rows that a comparison rests on: the evaluated trials, or all where none is marked."""
    return table[table["evaluated"]] if table["evaluated"].any() else table


def per_participant(table: pd.DataFrame, subtask: str) -> pd.DataFrame:
    """Means over the judged trials of each participant: index (controller, participant), one column per measure, and
    `limited` where any of the trials was."""
    rows = judged(table)
    rows = rows[rows["subtask"] == subtask]
    names = [name for name in rows.columns if name not in KEYS]
    groups = rows.groupby(["controller", "participant"], sort=False)
    means = groups[names].mean()
    means["limited"] = groups["limited"].any()
    return means.sort_index(
        level=0, key=lambda index: index.map(controller_order) if index.name == "controller" else index
    )


def per_controller(table: pd.DataFrame, subtask: str = "whole") -> dict:
    """Over participants, who count once each: controller -> DataFrame with a row per measure and columns mean, sd (NaN
    for one participant), se, n (participants with a value)."""
    means = per_participant(table, subtask)
    result = {}
    for controller, group in means.groupby(level="controller", sort=False):
        values = group.drop(columns="limited")
        count = values.count()
        sd = values.std(ddof=1)
        result[controller] = pd.DataFrame({"mean": values.mean(), "sd": sd, "se": sd / np.sqrt(count), "n": count})
    return result


@dataclass
class Study:
    """What is kept of many trials. `sources`: (file, SHA-256) of the bags; `skipped`: bags left out, with the
    reason."""

    rows: list = field(default_factory=list)
    tracks: list = field(default_factory=list)
    examples: dict = field(default_factory=dict)
    settings: list = field(default_factory=list)
    sources: list = field(default_factory=list)
    skipped: list = field(default_factory=list)
    lateness: list = field(default_factory=list)  # tables with t and lateness of real-time trials
    speed: list = field(default_factory=list)  # (simulated [s], wall [s]) per block; never in the table

    def add(self, trial: pd.DataFrame, track: bool = True) -> None:
        """Measures the trial; keeps its track, and the whole of it when it is the example of its controller: the last
        evaluated trial of the participant with the lowest number."""
        trial = trial_table.conform(trial)
        self.rows.append(study_table([trial]))
        self.settings.append({key: value for key, value in trial.attrs.items() if _is_plain(value) or key == "changes"})
        if track:
            thin = trial.iloc[::TRACK_STEP][["t", "x", "y"]].reset_index(drop=True)
            thin.attrs = dict(trial.attrs)
            self.tracks.append(thin)
        if "lateness" in trial.columns:
            self.lateness.append(trial[["t", "lateness"]])
        self._offer(trial)

    def merge(self, other: "Study") -> None:
        """Takes over everything of another study."""
        for name in ("rows", "tracks", "settings", "sources", "skipped", "lateness", "speed"):
            getattr(self, name).extend(getattr(other, name))
        for example in other.examples.values():
            self._offer(example)

    def _offer(self, trial):
        def rank(attrs):
            return not attrs.get("evaluated", True), attrs["participant"], -attrs["trial"]

        controller = trial.attrs["controller"]
        kept = self.examples.get(controller)
        if kept is None or rank(trial.attrs) < rank(kept.attrs):
            self.examples[controller] = trial

    def table(self) -> pd.DataFrame:
        if not self.rows:
            raise DataError("no trial was read, expected at least one")
        return tidy(pd.concat(self.rows, ignore_index=True))

    def shown_tracks(self) -> list:
        """Tracks of the judged trials of the first participants, in order."""
        marked = any(track.attrs.get("evaluated", True) for track in self.tracks)
        tracks = [track for track in self.tracks if track.attrs.get("evaluated", True) or not marked]
        shown = sorted({track.attrs["participant"] for track in tracks})[:TRACKED_PARTICIPANTS]
        return sorted(
            (track for track in tracks if track.attrs["participant"] in shown),
            key=lambda track: (
                controller_order(track.attrs["controller"]),
                track.attrs["participant"],
                track.attrs["trial"],
            ),
        )

    def shown_examples(self) -> list:
        return [self.examples[name] for name in sorted(self.examples, key=controller_order)]


def _is_plain(value):
    return isinstance(value, (str, int, float, bool))
