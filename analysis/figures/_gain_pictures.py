"""Pictures of the gains of section 4.6.1."""

import numpy as np
from matplotlib.colors import CenteredNorm
from matplotlib.figure import Figure

from phri_analysis.plots import figure, styled

from . import _gains

NEUTRAL, THESIS_AXIS = "#6b6b6b", "#f0f2f5"
# warm is averse, cold is seeking; the line style tells the strength or the order once more
AVERSE, SEEKING = ("#e69f00", "#d55e00", "#8c2d04"), ("#56b4e9", "#0072b2", "#08306b")
STYLES = ((0, (1, 1.2)), (0, (4, 1.5)), "-")
TICKS = (0.0, 0.4, 0.8, 1.2)
SCALE = 1e2  # Sigma^1/2 is shown in units of 1e-2, as in the thesis


@styled
def curves(panels) -> Figure:
    """`panels`: (title, neutral gain, curves, limits of the axis), a curve being (label, table, 0 to 2, averse, Sigma
    ^1/2 of the breakdown or NaN). Pale: the range of the thesis' axis."""
    fig = figure(3.3 * len(panels) + 0.9, 3.3)
    for axes, (title, neutral, lines, limits) in zip(fig.subplots(1, len(panels), squeeze=False)[0], panels):
        axes.axhspan(0.9, 1.1, color=THESIS_AXIS, zorder=0)
        axes.axhline(neutral, color=NEUTRAL, linewidth=1.6, label="E[J]")
        for label, table, shade, averse, limit in lines:
            colour = (AVERSE if averse else SEEKING)[shade]
            known = table[table["status"] == _gains.OK]
            axes.plot(SCALE * known["sigma_sqrt"], known["gain_position"], color=colour, linestyle=STYLES[shade],
                      label=label)
            if np.isfinite(limit) and SCALE * limit <= 1.2:
                axes.axvline(SCALE * limit, color=colour, linewidth=0.8, linestyle=STYLES[shade], alpha=0.6)
                axes.plot(SCALE * limit, limits[1], "x", color=colour, clip_on=False, markersize=5)
            elif len(known) < len(table):  # where a policy was last found; the breakdown is before the next value
                axes.plot(SCALE * known["sigma_sqrt"].iloc[-1], np.clip(known["gain_position"].iloc[-1], *limits), "x",
                          color=colour, markersize=5, clip_on=False)
        axes.set_title(title)
        axes.set_xlabel("Σ$^{1/2}$ [10$^{-2}$]")
        axes.set_xlim(0.0, 1.2)
        axes.set_ylim(*limits)
    handles, labels = fig.axes[0].get_legend_handles_labels()
    middle = (len(labels) + 1) // 2  # E[J], drawn first, is named where it lies: between averse and seeking
    places = [*range(1, middle), 0, *range(middle, len(labels))]
    fig.axes[-1].legend([handles[i] for i in places], [labels[i] for i in places], loc="center left",
                        bbox_to_anchor=(1.03, 0.5), handlelength=2.4)
    fig.axes[0].set_ylabel("L$_x$ [N/m]")
    return fig


@styled
def maps(rows) -> Figure:
    """`rows`: (label of the row, neutral gain, [(title, table)], largest difference shown [N/m]); white is the E[J]
    gain, the line is where the gain equals it, a cross is a pair of covariances without a policy."""
    fig = figure(10.6, 2.75 * len(rows))
    grid_of_axes = fig.subplots(len(rows), len(rows[0][2]), sharex=True, sharey=True, squeeze=False)
    for axes_of_row, (name, neutral, panels, reach) in zip(grid_of_axes, rows):
        for axes, (title, table) in zip(axes_of_row, panels):
            grid = table.pivot(index="sigma_sqrt_2", columns="sigma_sqrt_1", values="gain_position")
            x, y = SCALE * grid.columns.to_numpy(), SCALE * grid.index.to_numpy()
            difference = grid.to_numpy() - neutral
            image = axes.pcolormesh(
                x, y, difference, cmap="PuOr_r", norm=CenteredNorm(0.0, reach), shading="nearest"
            )
            if np.isfinite(difference).all():
                axes.contour(x, y, difference, levels=[0.0], colors=NEUTRAL, linewidths=1.0)
            missing = np.argwhere(~np.isfinite(difference))
            axes.plot(x[missing[:, 1]], y[missing[:, 0]], "x", color=NEUTRAL, markersize=4)
            axes.set_title(title)
            axes.set_aspect("equal")
            axes.set_xticks(TICKS)
            axes.set_yticks(TICKS)
        axes_of_row[0].set_ylabel(f"{name}\n\nseeking: Σ$_2^{{1/2}}$ [10$^{{-2}}$]")
        bar = fig.colorbar(image, ax=list(axes_of_row), extend="both", shrink=0.9, pad=0.01)
        bar.set_label("L$_x$ − E[J] gain [N/m]")
    for axes in grid_of_axes[-1]:
        axes.set_xlabel("averse: Σ$_1^{1/2}$ [10$^{-2}$]")
    return fig
