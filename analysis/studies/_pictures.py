"""Pictures of the studies."""

import numpy as np
from matplotlib.figure import Figure

from phri_analysis import metrics
from phri_analysis.plots import figure, styled

from . import _sensitivity

BARS = 11  # parameters in a tornado; the rest does less
LOWER, RAISED, THESIS_COLOUR = "#0072b2", "#d55e00", "#444444"


@styled
def calibration_figure(whole, sensitivity, thesis: dict, band: float) -> Figure:
    """Left: every simulated participant, mean and SD per seed, the thesis' mean and the band. Right: tornado of force
    and power."""
    fig = figure(7.4, 5.6)
    left, right = fig.subfigures(1, 2, width_ratios=(1.2, 2.2))
    for axes, name in zip(left.subplots(2, 1), ("human_force", "human_power")):
        _population(axes, whole[name], thesis[name], band, metrics.MEASURES[name])
    for axes, name in zip(right.subplots(1, 2, sharey=True), ("human_force", "human_power")):
        _tornado(axes, sensitivity, name)
    return fig


def _population(axes, values, thesis, band, measure):
    axes.axhspan((1 - band) * thesis, (1 + band) * thesis, color="#e9edf2", zorder=0)
    axes.axhline(thesis, color=THESIS_COLOUR, linewidth=0.9, linestyle="--", zorder=1)
    seeds = list(dict.fromkeys(values.index.get_level_values("seed")))
    for x, seed in enumerate(seeds):
        people = values.loc[seed].to_numpy()
        offsets = (np.arange(len(people)) % 5 - 2) * 0.06
        axes.plot(x + offsets, people, ".", color="#6b6b6b", alpha=0.5, markersize=4, markeredgewidth=0)
        axes.errorbar(x, people.mean(), people.std(ddof=1), fmt="o", color=RAISED, markersize=5, capsize=2.5)
    axes.set_xticks(range(len(seeds)), [f"seed {seed}" for seed in seeds])
    axes.set_xlim(-0.5, len(seeds) - 0.5)
    axes.set_ylim(0, 1.1 * max(values.max(), (1 + band) * thesis))
    axes.set_title(f"{measure.heading}, thesis ±{100 * band:g} %")


def _tornado(axes, sensitivity, name):
    """Bars of the change of the outcome for -20 % and +20 % of a parameter (to first order), strongest on force on
    top; pale where it is within three standard errors of 0."""
    ranks = sensitivity[sensitivity["outcome"] == "human_force"].set_index("parameter")["value"].abs()
    top = ranks.sort_values(ascending=False, kind="stable").index[:BARS]
    part = sensitivity[sensitivity["outcome"] == name].set_index("parameter").loc[top]
    scale = np.where(part["step"] == "spread", 100.0, 100.0 * _sensitivity.CHANGE)
    change, error = part["value"] * scale, part["error"] * scale
    y = np.arange(len(top))
    pale = np.where(part["significant"], 1.0, 0.3)
    for sign, colour, text in ((-1, LOWER, "less"), (1, RAISED, "more")):
        for i in y:
            axes.barh(i, sign * change.iloc[i], color=colour, alpha=pale[i], height=0.7,
                      label=f"parameter 20 % {text}" if i == 0 else None)
    axes.errorbar(change, y, xerr=error, fmt="none", ecolor="#333333", elinewidth=0.7, capsize=1.5)
    axes.axvline(0, color="#444444", linewidth=0.7)
    labels = [key.replace("/median", "").replace("/spread", ", spread").replace("_", " ") for key in top]
    axes.set_yticks(y, [text + (" *" if step == "spread" else "") for text, step in zip(labels, part["step"])])
    axes.set_ylim(len(top) + 0.6, -0.6)  # room for the legend
    axes.set_title(f"Change of {name.removeprefix('human_')} [%]")
    axes.grid(axis="x")
    axes.set_axisbelow(True)
    if name == "human_power":
        axes.legend(loc="lower right", fontsize=7)
