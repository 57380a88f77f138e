"""Small multiples of trajectories with the gains as ellipses."""

import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from phri_analysis.plots import figure, styled

ROBOT, GOAL, OBSTACLE, STATIC = "#d55e00", "#0072b2", "#444444", "#c9ccd1"
COLOURS = {"robot": ROBOT, "goal": GOAL, "obstacle": OBSTACLE}
MARKERS = {"robot": "o", "goal": "s", "obstacle": "D"}
ELLIPSES = 7  # per trajectory: more overlap
REACH = 0.08  # the largest ellipse of the reference panel, as a share of the width of the axes
LEGEND_HEIGHT = 0.55  # [inch]
LARGEST = 1.8  # times that: ellipses beyond are drawn so, and dashed


@styled
def trajectories(panels, spacing: float, columns: int, with_gains: bool, window=None) -> Figure:
    """`spacing` [s] between dots; `window` ((x0, x1), (y0, y1)) [m] cuts panels that run far out of it."""
    rows = -(-len(panels) // columns)
    window = window or _window(panels)
    ratio = np.diff(window[1])[0] / np.diff(window[0])[0]
    width = 9.6
    body_height = 0.4 + rows * (0.34 + (width - 0.6) / columns * ratio)
    fig = figure(width, body_height + LEGEND_HEIGHT)
    upper, lower = fig.subfigures(2, 1, height_ratios=(body_height, LEGEND_HEIGHT))
    axes = upper.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    scale = {}
    if with_gains:
        for body in panels[0].scene.movers:
            strongest = np.linalg.norm(panels[0].gains(body), ord=2, axis=(1, 2)).max()
            scale[body] = REACH * np.diff(window[0])[0] / strongest if strongest > 0.0 else 0.0
    for ax, panel in zip(axes.flat, panels):
        _panel(ax, panel, spacing, scale, window)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    for ax in axes[-1]:
        ax.set_xlabel("x$_1$ [m]")
    for ax in axes[:, 0]:
        ax.set_ylabel("x$_2$ [m]")
    lower.legend(handles=_legend(panels[0], scale), loc="center", ncols=3)
    return fig


def _window(panels):
    """Of the reference's bodies and the robots, the outer tenth of these cut off."""
    bodies = np.vstack([panels[0].places(body) for body in ("robot", *panels[0].scene.movers)])
    robots = np.vstack([panel.places("robot") for panel in panels])
    low = np.minimum(bodies.min(axis=0), np.quantile(robots, 0.05, axis=0))
    high = np.maximum(bodies.max(axis=0), np.quantile(robots, 0.95, axis=0))
    middle, size = 0.5 * (low + high), 1.24 * (high - low)
    size[1] = np.clip(size[1], 0.55 * size[0], 1.1 * size[0])
    return tuple((c - 0.5 * s, c + 0.5 * s) for c, s in zip(middle, size))


def _panel(ax, panel, spacing, scale, window):
    step = max(1, round(spacing / panel.scene.dt))
    for obstacle in panel.scene.static_obstacles:
        values, vectors = np.linalg.eigh(obstacle.covariance)
        ax.add_patch(
            Ellipse(obstacle.mean, *(2.0 * np.sqrt(values)), angle=np.degrees(np.arctan2(*vectors[::-1, 0])),
                    facecolor=STATIC, edgecolor="none", alpha=0.45, zorder=0)
        )
        ax.plot(*obstacle.mean, "x", color=OBSTACLE, markersize=4, zorder=1)
    for body in (*panel.scene.movers, "robot"):
        places = panel.places(body)
        ax.plot(*places.T, color=COLOURS[body], linewidth=0.7, alpha=0.6)
        ax.plot(*places[::step].T, ".", color=COLOURS[body], markersize=2.6, markeredgewidth=0)
        ax.plot(*places[0], MARKERS[body], color=COLOURS[body], markersize=5, markerfacecolor="white", zorder=4)
        if scale.get(body):
            _ellipses(ax, panel, body, scale[body], window)
    share = f", {panel.result.share:.3g} of it" if panel.reduced else ""
    ax.set_title(f"({panel.letter}) {_short(panel.name)}{share}", fontsize=8.2)
    ax.set_xlim(*window[0])
    ax.set_ylim(*window[1])
    ax.set_aspect("equal")


def _ellipses(ax, panel, body, scale, window):
    """Images of the unit circle under the gain: half axes are its singular values along the left singular vectors."""
    gains = panel.gains(body)
    at = np.unique(np.linspace(0, 0.9 * (len(gains) - 1), ELLIPSES).round().astype(int))
    vectors, sizes, _ = np.linalg.svd(gains[at])
    lengths = 2.0 * scale * sizes
    limit = 2.0 * LARGEST * REACH * np.diff(window[0])[0]
    angles = np.degrees(np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]))
    places = panel.places("robot" if body == "goal" else body)[at]
    for cut, style in ((False, "-"), (True, "--")):
        chosen = (lengths[:, 0] > limit) == cut
        if not chosen.any():  # an empty collection draws something all the same
            continue
        shown = lengths[chosen] * np.minimum(1.0, limit / np.maximum(lengths[chosen, :1], 1e-300))
        ax.add_collection(
            EllipseCollection(shown[:, 0], shown[:, 1], angles[chosen], units="xy", offsets=places[chosen],
                              offset_transform=ax.transData, facecolors="none", edgecolors=COLOURS[body],
                              linewidths=0.7, linestyles=style, alpha=0.8)
        )


def _short(name: str) -> str:
    for long, short in (("mean-variance, goal seeking and obstacle averse", "mean-variance"),
                        ("risk-sensitive, goal seeking and obstacle averse", "risk-sensitive"),
                        (" cumulant", "")):
        name = name.replace(long, short)
    return name


def _legend(panel, scale):
    handles = [
        Line2D([], [], color=COLOURS[body], marker=MARKERS[body], markersize=5, markerfacecolor="white",
               linewidth=0.8, label=f"{body}, its start")
        for body in ("robot", *panel.scene.movers)
    ]
    if panel.scene.static_obstacles:
        handles.append(Line2D([], [], color=STATIC, marker="o", markersize=9, alpha=0.6, linewidth=0,
                              label="static obstacle, 1 SD"))
    size = {body: _note(scale[body]) for body in scale if scale[body]}
    for body, text in size.items():
        where = "at the robot" if body == "goal" else "at the obstacle"
        handles.append(Line2D([], [], color=COLOURS[body], marker="o", markersize=9, markerfacecolor="none",
                              linewidth=0, label=f"gain on the {body} {where}: 0.1 m is {text}"))
    return handles


def _note(scale):
    return f"{0.1 / scale:.3g} N/m"
