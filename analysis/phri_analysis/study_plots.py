"""Pictures of a study table: measures per controller, and the share of time at each limit."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from . import metrics, style, study
from .plots import figure, legend_below, styled


@styled
def measures_figure(table, names=metrics.HEADLINE, subtask: str = "whole") -> Figure:
    """One panel per measure: mean over participants with its standard error, and every participant as a thin point,
    joined across controllers where they are few enough to follow."""
    known = metrics.all_measures(table.columns)
    means = study.per_participant(table, subtask)
    names = [name for name in names if name in means.columns and means[name].notna().any()]
    controllers = list(means.index.get_level_values("controller").unique())
    summary = study.per_controller(table, subtask)
    columns = min(3, max(1, len(names)))
    rows = max(1, -(-len(names) // columns))
    fig = figure(7.4, 2.15 * rows + 0.3)
    panels = fig.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names):
        unit = known[name].unit
        wide = means[name].unstack("participant").reindex(controllers) * style.scale(unit)
        if wide.shape[1] <= study.TRACKED_PARTICIPANTS:
            axes.plot(range(len(controllers)), wide.to_numpy(), color="#c4c4c4", linewidth=0.6, zorder=1)
        for i, controller in enumerate(controllers):
            values = wide.loc[controller].dropna().to_numpy()
            axes.plot(
                np.full(len(values), i) + _spread(len(values)),
                values,
                ".",
                color=style.colour(controller),
                alpha=0.45,
                markersize=4,
                markeredgewidth=0,
                zorder=2,
            )
            _point(axes, i, summary[controller].loc[name] * style.scale(unit), controller)
        axes.set_title(f"{known[name].label} [{style.shown_unit(unit)}]")
        axes.set_xticks(range(len(controllers)), [style.label(c).replace(" ", "\n", 1) for c in controllers])
        axes.set_xlim(-0.5, len(controllers) - 0.5)
        axes.grid(axis="y")
        if name == "prediction_coverage_95":
            axes.axhline(95, color="#444444", linewidth=0.8, linestyle="--", zorder=1)
        elif np.nanmin(wide.to_numpy()) >= 0:
            axes.set_ylim(0, max(1e-12, 1.1 * np.nanmax(wide.to_numpy())))
        if unit == "count":
            axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    return fig


def _point(axes, x, row, controller):
    """Mean and standard error of one controller; nothing where no participant has a value."""
    if not np.isnan(row["mean"]):
        axes.errorbar(
            x,
            row["mean"],
            yerr=np.nan_to_num(row["se"]),
            fmt=style.marker(controller),
            color=style.colour(controller),
            markersize=5.5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            elinewidth=1.4,
            capsize=2.5,
            zorder=3,
        )


def _spread(count):
    """Small offsets that keep equal values apart, the same for the same count."""
    return (np.arange(count) % 5 - 2) * 0.035 if count > 1 else np.zeros(count)


@styled
def subtasks_figure(table, names=("human_force", "human_power", "disagreement", "collision_force")) -> Figure:
    """The measures of figure 5.18 by subtask: mean over participants and standard error for MO and NC."""
    known = metrics.all_measures(table.columns)
    parts = [part for part in ("MO", "NC") if (table["subtask"] == part).any()]
    fig = figure(7.4, 2.6)
    panels = fig.subplots(1, len(names), squeeze=False).ravel()
    summaries = {part: study.per_controller(table, part) for part in parts}
    controllers = sorted({c for part in summaries.values() for c in part}, key=style.controller_order)
    for axes, name in zip(panels, names):
        scale = style.scale(known[name].unit)
        for i, controller in enumerate(controllers):
            offset = (i - (len(controllers) - 1) / 2) * 0.16
            for x, part in enumerate(parts):
                if controller in summaries[part]:
                    _point(axes, x + offset, summaries[part][controller].loc[name] * scale, controller)
        axes.set_title(f"{known[name].label} [{style.shown_unit(known[name].unit)}]")
        axes.set_xticks(range(len(parts)), parts)
        axes.set_xlim(-0.6, len(parts) - 0.4)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.grid(axis="y")
    handles = [
        Line2D([], [], marker=style.marker(c), color=style.colour(c), linestyle="", label=style.label(c))
        for c in controllers
    ]
    legend_below(fig, handles, len(handles))
    return fig


@styled
def limits_figure(table) -> Figure:
    """Share of time at each limit per controller, mean over participants; the dashed line is the 5 % above which a
    trial is marked `limited` (that mark counts the time at any limit of the assistance)."""
    names = [name for name in table.columns if name.startswith("limited_")]
    summary = study.per_controller(table, "whole")
    controllers = list(summary)
    fig = figure(7.4, 0.5 + 0.27 * max(1, len(names)) * max(1.0, 0.42 * len(controllers)))
    axes = fig.subplots()
    height = 0.8 / max(1, len(controllers))
    for i, controller in enumerate(controllers):
        shares = 100 * summary[controller].loc[names, "mean"].to_numpy(dtype=float)
        y = np.arange(len(names)) + (i - (len(controllers) - 1) / 2) * height
        axes.barh(y, shares, height=0.9 * height, color=style.colour(controller), label=style.label(controller))
    axes.axvline(
        100 * metrics.LIMITED_SHARE,
        color="#444444",
        linewidth=0.8,
        linestyle="--",
        zorder=0,
        label=f"{metrics.LIMITED_SHARE:.0%}".replace("%", " %") + " bound of the mark `limited`",
    )
    axes.set_yticks(range(len(names)), [name.removeprefix("limited_").replace("_", " ") for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(0, max(10.0, 1.05 * axes.get_xlim()[1]))
    axes.set_xlabel("share of time [%]")
    axes.grid(axis="x")
    axes.set_axisbelow(True)
    axes.legend(loc="lower right")
    return fig
