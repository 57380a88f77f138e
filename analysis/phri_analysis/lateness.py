"""How late the ticks of real-time trials came: the histogram that the experiment node logs, from the bags.

A tick is late by what passed between its deadline and its start, on the monotonic clock. One that comes a whole period
late is not made up for: the deadlines move, and the trial takes that much longer on the wall (`slipped`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .errors import DataError
from .plots import figure, styled

EDGES = (50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 5e-3, 10e-3, 20e-3)  # [s], as in phri_sim/ros/realtime_loop.hpp
QUANTILES = (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999))


@dataclass(frozen=True)
class Lateness:
    """Of `ticks` ticks: `counts[i]` came up to EDGES[i] late (and later than the edge before), the last ones later than
    all edges. `quantiles`: the smallest lateness [s] that the share of the ticks does not exceed. `slipped`: whole
    periods lost."""

    ticks: int
    counts: tuple
    quantiles: dict
    worst: float
    slipped: int

    def line(self) -> str:
        """One line for people."""
        shown = ", ".join(f"{name} {1e3 * value:.3f} ms" for name, value in self.quantiles.items())
        return f"{self.ticks} ticks: {shown}, worst {1e3 * self.worst:.3f} ms, {self.slipped} slipped"

    def table(self) -> str:
        """The histogram for a terminal."""
        rows = [(label, count, 100 * count / self.ticks) for label, count in zip(labels(), self.counts)]
        return "\n".join(f"{label:>12}  {count:>9d}  {share:>7.3f} %" for label, count, share in rows)


def labels() -> list:
    """What the bins are called."""
    return [f"<= {1e3 * edge:g} ms" for edge in EDGES] + [f"> {1e3 * EDGES[-1]:g} ms"]


def summary(tables) -> Lateness:
    """Over all ticks of some trial tables. Raises DataError for a trial that has no lateness."""
    values, slipped = [], 0
    for table in tables:
        late, period = of_trial(table)
        values.append(late)
        slipped += int((np.rint(late * 1e9).astype("int64") // period).sum())
    return _summary(np.concatenate(values), slipped)


def of_trial(table) -> tuple:
    """(lateness of every tick [s], period [ns]) of a trial table."""
    if "lateness" not in table.columns:
        clock = table.attrs.get("clock")
        why = "it was recorded before bags held it" if clock == "realtime" else f"its clock is {clock!r}"
        raise DataError(f"no lateness: {why}, expected a recording of a real-time trial")
    steps = np.diff(table["t"].to_numpy())
    return table["lateness"].to_numpy(), int(round(np.median(steps) * 1e9)) if len(steps) else 10**6


def _summary(values, slipped):
    # a tick exactly on an edge belongs below it
    bins = np.searchsorted(EDGES, values, side="left")
    counts = np.bincount(bins, minlength=len(EDGES) + 1)
    quantiles = {name: float(np.quantile(values, share, method="inverted_cdf")) for name, share in QUANTILES}
    return Lateness(len(values), tuple(map(int, counts)), quantiles, float(values.max()), slipped)


@styled
def lateness_figure(result: Lateness) -> Figure:
    """Share of the ticks per bin, on a logarithmic axis: what matters is rare."""
    fig = figure(7.4, 2.8)
    axes = fig.subplots()
    shares = 100 * np.array(result.counts) / result.ticks
    least = 100 / result.ticks
    bars = axes.bar(range(len(shares)), np.maximum(shares, least / 3), color="#0072b2", width=0.8)
    for bar, count, share in zip(bars, result.counts, shares):
        bar.set_visible(count > 0)
        axes.annotate(
            f"{count}", (bar.get_x() + bar.get_width() / 2, max(share, least / 3)), ha="center", va="bottom", fontsize=7
        )
    axes.set_yscale("log")
    axes.set_ylim(least / 3, 300)
    axes.set_xticks(range(len(shares)), [label.removesuffix(" ms") for label in labels()])
    axes.set_xlabel("lateness of the tick [ms]")
    axes.set_ylabel("share of ticks [%]")
    axes.set_title(result.line())
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    return fig


def write_figure(result: Lateness, path) -> Path:
    """The picture as a file of the type that its name says. Raises OSError."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    lateness_figure(result).savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)
    return path
