"""Pictures of figures 3.4 to 3.6."""

import numpy as np
from matplotlib.collections import EllipseCollection

from phri_analysis import plots

GREY, OURS, OTHER, TRUE, THIRD = "#b5b5b5", "#0072b2", "#d55e00", "black", "#009e73"
REGION = 2.4477  # radius of the 95 % ellipse of a plane Gaussian, sqrt(chi2.ppf(0.95, 2))
EVERY = 5  # samples between ellipses


def _ellipses(axes, mean, covariance):
    values, vectors = np.linalg.eigh(covariance[::EVERY, :2, :2])
    size = 2.0 * REGION * np.sqrt(values)
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    axes.add_collection(EllipseCollection(size[:, 1], size[:, 0], angles, units="xy", offsets=mean[::EVERY, :2],
                                          offset_transform=axes.transData, facecolors=OURS, alpha=0.12,
                                          edgecolors="none"))  # fmt: skip


@plots.styled
def output(models, petal, other):
    figure = plots.figure(11.0, 6.4)
    grid = figure.subplots(2, 2)
    for axes, name, mark in ((grid[0][0], petal, "a"), (grid[1][1], other, "d")):
        train, _, mean, covariance, states = models[name]
        for x in train:
            axes.plot(x[:, 0], x[:, 1], color=GREY, linewidth=0.7)
        if name == petal:  # of trials that differ threefold in length they would cover everything
            _ellipses(axes, mean, covariance)
        axes.plot(mean[:, 0], mean[:, 1], color=OURS, linewidth=2.0, label="generalised output, 95 % ellipses")
        axes.plot(states[:, 0], states[:, 1], "o", color=OTHER, markersize=4, label="means of the states")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_title(f"({mark}) {name}: {len(train)} demonstrations")
    grid[0][0].legend(loc="best")
    train, times, mean, covariance, _ = models[petal]
    dt = times[1] - times[0]
    for axes, first, unit, mark in ((grid[0][1], 2, "velocity [m/s]", "b"), (grid[1][0], 4, "force [N]", "c")):
        for j, colour in ((first, OURS), (first + 1, OTHER)):
            for x in train:
                axes.plot(dt * np.arange(len(x)), x[:, j], color=GREY, linewidth=0.6)
            deviation = 2.0 * np.sqrt(covariance[:, j, j])
            axes.fill_between(times, mean[:, j] - deviation, mean[:, j] + deviation, color=colour, alpha=0.15, lw=0)
            axes.plot(times, mean[:, j], color=colour, linewidth=2.0, label="xy"[j - first])
        axes.set_xlabel("time [s]")
        axes.set_ylabel(unit)
        axes.set_title(f"({mark}) {unit.split()[0]}, ±2 standard deviations")
        axes.legend()
    return figure


@plots.styled
def window(found, error, cuts):
    figure = plots.figure(10.0, 7.0)
    rows = figure.subplots(3, 1, sharex=True)
    for axes, j in zip(rows, (0, 1)):
        axes.plot(found["t"], found["ahead"][:, j], color=TRUE, label="place 0.3 s later")
        axes.plot(found["t"], found["own"][:, j], color=OTHER, label="likeliest node alone")
        axes.plot(found["t"], found["window"][:, j], "--", color=THIRD, label="window HMM")
        axes.set_ylabel(f"{'xy'[j]} [m]")
    rows[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    rows[2].plot(found["t"], 1e3 * error["own"], color=OTHER)
    rows[2].plot(found["t"], 1e3 * error["window"], "--", color=THIRD)
    rows[2].set_ylabel("error [mm]")
    rows[2].set_xlabel("time [s]; dotted: transitions between the parts")
    for axes in rows:
        for cut in cuts:
            axes.axvline(cut, color=GREY, linestyle=":", zorder=0)
    return figure


@plots.styled
def learning(data, members):
    figure = plots.figure(10.0, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=[2, 1])
    for reference, column, colour, name in (
        ("path", "error_mm", OURS, "thesis: reference to the path"),
        ("displacement", "error_mm", THIRD, "displacement form"),
        ("path", "velocity_error_mm", GREY, "constant velocity"),
    ):
        table = data[data["reference"] == reference].pivot(index="repetition", columns="person", values=column)
        mean, deviation = table.mean(axis=1), table.std(axis=1)
        left.errorbar(table.index, mean, deviation, color=colour, marker="o", markersize=3, capsize=2, label=name)
    left.set_ylim(bottom=0.0)
    left.set_xlabel("repetition")
    left.set_ylabel("error 0.3 s ahead [mm], mean and deviation over people")
    left.legend()
    table = data[data["reference"] == "path"].pivot(index="repetition", columns="person", values="primitives")
    right.plot(table.index, table, color=GREY, linewidth=0.8)
    right.plot(table.index, table.mean(axis=1), color=OURS, marker="o", markersize=3)
    right.axhline(5, color=OTHER, linestyle=":")
    right.xaxis.get_major_locator().set_params(integer=True)
    right.set_xlabel("repetition")
    right.set_ylabel("primitives (upper nodes); dotted: parts of the task")
    return figure
