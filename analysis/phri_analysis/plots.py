"""Pictures of one trial or of some trials: the maze with trajectories, the predictions, the time series.

Every function takes tables and returns a matplotlib Figure; nothing is shown or written. What the pictures of the maze
draw besides the trajectories comes from `table.attrs`, each where given:
  map        {"grid": list of rows from the bottom, "#" where wall and "." where free, "resolution": [m per cell],
             "origin": [x, y] of the lower left corner [m]}; a map without a grid, as in bags of before they held it,
             is left out, and the panel says so
  start, goal  [x, y] [m]
  path       list of [x, y] [m]: a line to follow
  obstacles  list of {"center": [x, y], "half_size": [x, y], "amplitude"} [m]: boxes that swing along x
"""

import matplotlib
import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from . import metrics, style, trial_table
from .errors import DataError

RC = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#444444",
    "axes.grid": False,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "figure.dpi": 150,
    "savefig.dpi": 150,
    # Readable in the matplotlib of any machine, and the same bytes wherever that version is.
    "svg.hashsalt": "phri",
    "axes.titlelocation": "left",
    "figure.constrained_layout.use": True,
}
HUMAN, ROBOT, WALL, PREDICTED = "#0072b2", "#d55e00", "#555555", "#cc79a7"
WALL_FILL = "#c9ccd1"
REQUESTED = "#f3c9a8"  # pale: what the limits took away stands behind what was applied


def figure(width: float, height: float) -> Figure:
    """An empty figure [inch] in the house style; made without pyplot, so it needs no screen and is freed like any
    object."""
    with matplotlib.rc_context(RC):
        return Figure(figsize=(width, height), layout="constrained")


def styled(function):
    """Runs a plot function under the house style."""

    def run(*args, **kwargs):
        with matplotlib.rc_context(RC):
            return function(*args, **kwargs)

    run.__name__, run.__doc__ = function.__name__, function.__doc__
    return run


def walls_of(description: dict) -> np.ndarray:
    """The walls of a map as a 2-D boolean array, row 0 at the bottom. Raises DataError."""
    rows = description["grid"]
    if len({len(row) for row in rows}) != 1 or set("".join(rows)) - set("#."):
        raise DataError("map: expected a grid of rows of one length, of # and .")
    return np.array([[cell == "#" for cell in row] for row in rows])


def _draw_walls(axes, description):
    walls = walls_of(description)
    height, width = np.array(walls.shape) * description["resolution"]
    x, y = description["origin"][:2]
    extent = np.array([x, x + width, y, y + height]) * 1e3
    picture = np.zeros((*walls.shape, 4))
    picture[walls] = matplotlib.colors.to_rgba(WALL_FILL)
    axes.imshow(picture, extent=extent, interpolation="nearest", origin="lower", zorder=0)
    axes.set_xlim(extent[:2])
    axes.set_ylim(extent[2:])


def draw_maze(axes, attrs: dict) -> None:
    """Walls, swinging obstacles, turning point, start and goal of a scene; axes in mm with equal scale."""
    description = attrs.get("map")
    if description and "grid" in description:
        _draw_walls(axes, description)
    elif description:
        axes.set_title("no map in the recording", loc="right", fontsize=7, color="#888888")
    for box in attrs.get("obstacles") or ():
        half_x, half_y = box["half_size"][0] + box.get("amplitude", 0.0), box["half_size"][1]
        corner = 1e3 * (box["center"][0] - half_x), 1e3 * (box["center"][1] - half_y)
        frame = {"fill": False, "edgecolor": "#999999", "hatch": "/////", "linewidth": 0.6, "zorder": 1}
        axes.add_patch(Rectangle(corner, 2e3 * half_x, 2e3 * half_y, **frame))
    if attrs.get("path") is not None:
        axes.plot(*(1e3 * np.array(attrs["path"]).T), color="#9aa0a8", linewidth=2.4, alpha=0.6, zorder=1)
    if attrs.get("turning_point_x") is not None:
        axes.axvline(attrs["turning_point_x"] * 1e3, color="#888888", linewidth=0.8, linestyle=(0, (5, 3)), zorder=1)
    for name, face in (("start", "#2e9d4f"), ("goal", "#cc2121")):
        if attrs.get(name) is not None:
            x, y = attrs[name][:2]
            axes.plot(
                x * 1e3,
                y * 1e3,
                "o",
                markersize=9,
                markerfacecolor=face,
                markeredgecolor="black",
                markeredgewidth=0.9,
                zorder=5,
            )
            axes.annotate(
                name, (x * 1e3, y * 1e3), textcoords="offset points", xytext=(0, 7), ha="center", fontsize=7, zorder=6
            )
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")


@styled
def maze_figure(tracks) -> Figure:
    """One panel per controller with the trajectories of `tracks` (tables with x, y and attrs), over the scene."""
    groups = {}
    for track in tracks:
        groups.setdefault(track.attrs["controller"], []).append(track)
    names = sorted(groups, key=style.controller_order)
    columns = 2 if len(names) == 4 else min(3, max(1, len(names)))
    rows = max(1, -(-len(names) // columns))
    fig = figure(2.5 * columns + 0.4, 2.55 * rows + 0.6)
    panels = fig.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for i, (axes, name) in enumerate(zip(panels, names)):
        draw_maze(axes, groups[name][0].attrs)
        for track in groups[name]:
            axes.plot(
                track["x"] * 1e3,
                track["y"] * 1e3,
                color=style.colour(name),
                linewidth=1.1,
                alpha=max(0.35, 1.0 - 0.08 * len(groups[name])),
                zorder=3,
            )
        count = len({track.attrs["participant"] for track in groups[name]})
        axes.set_title(f"{style.label(name)}, {count} participant{'s' if count != 1 else ''}")
        axes.label_outer()
        if i + columns >= len(names):  # nothing below
            axes.set_xlabel("x [mm]")
            axes.tick_params(labelbottom=True)
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    handles = []
    attrs = tracks[0].attrs if tracks else {}
    if attrs.get("obstacles"):
        handles.append(Patch(fill=False, edgecolor="#999999", hatch="/////", label="range of a moving obstacle"))
    if attrs.get("turning_point_x") is not None:
        handles.append(
            Line2D(
                [],
                [],
                color="#888888",
                linestyle=(0, (5, 3)),
                linewidth=0.8,
                label="turning point between subtasks MO (right) and NC (left)",
            )
        )
    legend_below(fig, handles, 2 if columns > 2 else 1)
    return fig


def legend_below(fig: Figure, handles, columns: int) -> None:
    """One legend for all panels in a strip kept free under them."""
    if handles:
        strip = 0.22 * -(-len(handles) // columns) / fig.get_figheight()  # 0.22 inch per line of the legend
        fig.get_layout_engine().set(rect=(0, strip, 1, 1 - strip))
        fig.legend(handles=handles, loc="lower center", ncols=columns, columnspacing=1.5, borderaxespad=0.2)


@styled
def prediction_figure(trial) -> Figure:
    """Predictions of a trial: in the maze with their 95 % ellipses, and along time as error beside the ellipse's
    size."""
    forecasts = trial_table.predictions(trial)
    fig = figure(7.8, 4.1)
    maze, series = fig.subplots(1, 2)
    draw_maze(maze, trial.attrs)
    maze.plot(trial["x"] * 1e3, trial["y"] * 1e3, color="black", linewidth=1.0, zorder=4, label="actual")
    if not len(forecasts):
        maze.set_title("no prediction in this trial")
        series.set_visible(False)
        return fig
    inside = (forecasts["mahalanobis2"] <= metrics.CHI2_95).to_numpy()
    major, minor, angle = ellipses(forecasts)
    points = forecasts[["prediction_x", "prediction_y"]].to_numpy() * 1e3
    shown = np.arange(0, len(forecasts), max(1, len(forecasts) // 40))  # every ellipse would hide all others
    maze.add_collection(
        EllipseCollection(
            2e3 * major[shown],
            2e3 * minor[shown],
            np.degrees(angle[shown]),
            units="xy",
            offsets=points[shown],
            offset_transform=maze.transData,
            facecolors=matplotlib.colors.to_rgba(PREDICTED, 0.12),
            edgecolors=PREDICTED,
            linewidths=0.5,
            zorder=2,
        )
    )
    maze.plot(*points[inside].T, ".", color=PREDICTED, markersize=2.5, zorder=3, label="predicted, true inside")
    maze.plot(
        *points[~inside].T,
        "x",
        color="#222222",
        markersize=3.2,
        markeredgewidth=0.8,
        zorder=5,
        label="predicted, true outside",
    )
    horizon = forecasts["prediction_horizon"].median()
    maze.set_title(
        f"{style.label(trial.attrs['controller'])}, participant {trial.attrs['participant']}, "
        f"trial {trial.attrs['trial']}"
    )
    maze.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, handletextpad=0.3, columnspacing=1.0)
    time = forecasts["target_t"]
    series.fill_between(time, 0, 1e3 * major, color=PREDICTED, alpha=0.22, linewidth=0, label="half axis of ellipse")
    series.plot(time, 1e3 * forecasts["error"], color="black", linewidth=0.9, label="error")
    series.plot(
        time[~inside],
        1e3 * forecasts["error"][~inside],
        "x",
        color="#222222",
        markersize=3.2,
        markeredgewidth=0.8,
        label="outside",
    )
    series.set_xlabel("time [s]")
    series.set_ylabel("distance [mm]")
    series.set_ylim(bottom=0)
    series.set_title(
        f"{100 * inside.mean():.1f} % of {len(inside)} predictions inside their\n"
        f"95 % ellipse, {horizon:.2g} s ahead"
    )
    series.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, columnspacing=1.0)
    series.grid(axis="y")
    return fig


def ellipses(forecasts):
    """Half axes [m] (major, minor) and angle [rad] of the major axis of the 95 % ellipses."""
    xx, xy, yy = (forecasts[f"prediction_{name}"].to_numpy() for name in ("xx", "xy", "yy"))
    centre, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    major = np.sqrt(np.maximum(0.0, metrics.CHI2_95 * (centre + spread)))
    minor = np.sqrt(np.maximum(0.0, metrics.CHI2_95 * (centre - spread)))
    return major, minor, 0.5 * np.arctan2(2 * xy, xx - yy)


@styled
def trial_figure(trial) -> Figure:
    """Forces, speed, power and state of one trial along time."""
    t = trial["t"].to_numpy()
    fig = figure(7.4, 5.0)
    force, speed, power, state = fig.subplots(4, 1, sharex=True, gridspec_kw={"height_ratios": [2.2, 1.2, 1.2, 0.7]})

    def norm(name):
        return np.hypot(*trial_table.vector(trial, name).T)

    for name, colour, text in (
        ("human", HUMAN, "human"),
        ("assistance", ROBOT, "assistance"),
        ("environment", WALL, "walls and obstacles"),
    ):
        force.plot(t, norm(name), color=colour, linewidth=0.9, label=text)
    force.plot(t, norm("requested"), color=REQUESTED, linewidth=0.6, label="assistance requested", zorder=1)
    force.set_ylabel("force [N]")
    # Contact peaks and requests beyond the limits may be a hundred times the rest; the axis shows what people feel.
    top = max(
        np.percentile(norm("human"), 99.5), np.percentile(norm("assistance"), 99.5), np.max(norm("assistance")), 1.0
    )
    contact = float(np.max(norm("environment")))
    force.set_ylim(0, 1.15 * max(top, min(contact, 1.5 * top)))
    force.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4, borderaxespad=0.1, columnspacing=1.2)
    force.set_title(trial_table.describe({**trial.attrs, "controller": style.label(trial.attrs["controller"])}), pad=20)
    speed.plot(t, 1e3 * norm("v"), color="black", linewidth=0.9)
    speed.set_ylabel("speed [mm/s]")
    speed.set_ylim(bottom=0)
    velocity = trial_table.vector(trial, "v")
    for name, colour in (("human", HUMAN), ("assistance", ROBOT)):
        power.plot(t, np.sum(trial_table.vector(trial, name) * velocity, axis=1), color=colour, linewidth=0.9)
    power.axhline(0, color="#888888", linewidth=0.6)
    power.set_ylabel("power [W]")
    state.step(t, trial["state"], where="post", color="black", linewidth=0.9)
    state.set_ylabel("state")
    state.set_yticks(range(len(trial_table.STATES)), [name.lower() for name in trial_table.STATES], fontsize=6)
    state.set_ylim(-0.5, 4.5)
    state.set_xlabel("time [s]")
    for axes in (force, speed, power, state):
        axes.grid(axis="y")
        axes.set_xlim(t[0], max(t[-1], t[0] + 1e-3))
    fig.align_ylabels()
    return fig
