"""Figures 5.6 to 5.9: joint transport with a mobile manipulator (5.1.2), drawn from what the study `transport` runs."""

import numpy as np
import pandas as pd
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from phri_analysis.plots import figure, styled
from studies import transport as study

from . import Page, finding

IDS = ("5.6", "5.7", "5.8", "5.9")
WAYS = {"left_of_car": "#0072b2", "between": "#d55e00", "right_of_trolley": "#009e73"}
TEXTS = {
    "5.6": ("The nine trials of the joint transport",
            "Paths of nine trials along three ways through the lab. The odometry's drift makes the paths diverge."),
    "5.7": ("What was learned of the nine trials",
            "Generalised output of the graph's nodes after all trials: ways that fork before the trolley, left of it "
            "and on. In the region close to the car the data could not be segmented."),
    "5.8": ("Force at the first furcation",
            "Human force along y around the node transition from before the trolley to left or right of it. Without "
            "assistance a significant force is needed; a successful prediction reduces it significantly; after a "
            "false one the force comes back to a comparable value within about 0.5 m."),
    "5.9": ("Force and torque per furcation",
            "Mean human force and torque per bifurcation. A successful prediction reduces them significantly against a "
            "passive follower, a false one exceeds it, torque included."),
}
FIRST = study.FURCATIONS[0]
NEAR = 0.3  # [m] of a node's output: that place was learned
CAR = 1.0  # [m] from the car: close to it


def _settings(people: int) -> dict:
    return {"experiment": study.EXPERIMENT, "seed": int(study.simulate.plan(study.request())[1].seed),
            "participants": people, "trials": study.TRIALS}  # fmt: skip


def page(id, options) -> Page:
    title, thesis = TEXTS[id]
    data, picture, findings, people = {"5.6": _paths, "5.7": _nodes, "5.8": _force, "5.9": _bars}[id](options)
    return Page(
        id=id, title=title, thesis=thesis, setting=_settings(people),
        deviations=(
            "The participants are simulated: no person took part. The thesis had one user.",
            "Places and sizes of trolley, car and wall are ours: the thesis shows paths only.",
            "Learned from [x, y, yaw; their rates; fx, fy, tz]: height and level are held, so of the twelve dimensions "
            "of the thesis height, tilt rates, vertical force and tilting torques say nothing here.",
        ),
        data=data, figure=picture, findings=tuple(findings),
    )  # fmt: skip


def _draw_lab(axes, boxes) -> None:
    for box in boxes:
        (x, y), (width, depth) = box["center"], box["size"]
        turn = Affine2D().rotate_around(x, y, box["yaw"])
        axes.add_patch(Rectangle((x - width / 2, y - depth / 2), width, depth, color="#c9cdd4", zorder=0,
                                 transform=turn + axes.transData))
        axes.annotate(box["name"], (x, y), ha="center", va="center", fontsize=8)
    axes.set(xlim=(0, 10), ylim=(0, 10), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def _paths(_):
    trials = study.nine_trials()
    names = ["t", "x", "y", "yaw", "grasp_x", "grasp_y"]
    data = pd.concat([trial[names].iloc[::5].assign(trial=k, way=trial.attrs["route"])
                      for k, trial in enumerate(trials, 1)])  # fmt: skip
    drift = np.array([trial.attrs["odometry_drift"] for trial in trials])
    return data, _path_picture(trials), _drift_findings(drift, trials), 1


def _drift_findings(drift, trials):
    yield finding(drift.max() > 0.05, "the drift of the odometry makes the paths diverge",
                  f"odometry against truth at the end: mean {drift.mean():.3f} m, {drift.min():.3f} to "
                  f"{drift.max():.3f} m")
    for way in WAYS:
        ends = pd.DataFrame([trial.iloc[-1] for trial in trials if trial.attrs["route"] == way])
        believed, real = (ends[pair].std(ddof=1).pow(2).sum() ** 0.5 for pair in (["x", "y"], ["grasp_x", "grasp_y"]))
        yield f"Ends of {way}: standard deviation {believed:.3f} m as believed, {real:.3f} m in truth."


@styled
def _path_picture(trials):
    fig = figure(5.4, 5.2)
    axes = fig.subplots()
    _draw_lab(axes, trials[0].attrs["boxes"])
    for trial in trials:
        way = trial.attrs["route"]
        axes.plot(trial["x"], trial["y"], color=WAYS[way], linewidth=1.0)
        axes.plot(trial["grasp_x"], trial["grasp_y"], color="#555555", linewidth=0.6, linestyle=":")
    axes.set_title("robot's grasp: as believed, and in truth (dotted)", fontsize=9)
    return fig


def _outputs(trial):
    return [np.asarray(path) for path in trial.attrs["primitive_outputs"] or []]


def _nodes(_):
    trials = study.nine_trials()
    nodes = _outputs(trials[-1])
    data = pd.concat([pd.DataFrame(path, columns=["x", "y", "yaw"]).assign(node=i) for i, path in enumerate(nodes)])
    places = np.concatenate([trial[["x", "y"]].to_numpy()[::10] for trial in trials])
    known = np.concatenate([path[:, :2] for path in nodes])
    learned = np.min(np.linalg.norm(places[:, None] - known[None], axis=2), axis=1) < NEAR
    car = next(box for box in trials[0].attrs["boxes"] if box["name"] == "car")
    beyond = np.maximum(np.abs(places - car["center"]) - np.array(car["size"]) / 2, 0.0)
    close = np.linalg.norm(beyond, axis=1) < CAR
    starts = np.array([path[0, :2] for path in nodes])
    first = np.linalg.norm(starts - places[0], axis=1) < NEAR
    findings = [
        finding(bool(first.sum() == 1), "one node before the trolley is common to all ways",
                f"{first.sum()} of {len(nodes)} nodes begin within {NEAR} m of the start"),
        finding(learned[close].mean() < learned[~close].mean() - 0.05, "close to the car less was learned",
                f"within {NEAR} m of a node: {learned[close].mean():.0%} of the places within {CAR} m of the car, "
                f"{learned[~close].mean():.0%} of the others"),
    ]  # fmt: skip
    return data, _node_picture(trials[-1], nodes), findings, 1


@styled
def _node_picture(trial, nodes):
    fig = figure(5.4, 5.2)
    axes = fig.subplots()
    _draw_lab(axes, trial.attrs["boxes"])
    for i, path in enumerate(nodes):
        line, = axes.plot(path[:, 0], path[:, 1], linewidth=1.6, color=f"C{i % 10}")
        axes.plot(*path[0, :2], "o", markersize=3, color=line.get_color())
    axes.set_title(f"generalised output of {len(nodes)} nodes (dots: where they begin)", fontsize=9)
    return fig


def _parted(options):
    return study.furcations(study.PEOPLE, options.jobs)


def _force(options):
    table, windows = _parted(options)
    mine = table[(table["taken"] == FIRST[0]) & (table["other"] == FIRST[1])]
    names = ["way", "grasp_x", "human_y", "assistance_y"]
    data = pd.concat([window[names].assign(condition=condition, participant=person)
                      for (taken, other, condition, person), window in windows.items() if (taken, other) == FIRST])
    wanted = {claim: rest for claim, *rest in study.successes(mine)
              if not any(word in claim for word in ("along x", "torque"))}  # fmt: skip
    findings = [finding(seen, claim, f"mean {change:+.1%}, {shown} of {cases} participants")
                for claim, (change, shown, cases, seen) in wanted.items()]  # fmt: skip
    return data, _force_picture(data), findings, study.PEOPLE


@styled
def _force_picture(data):
    fig = figure(6.4, 3.6)
    axes = fig.subplots()
    reach = study.AROUND - 0.01  # where everybody's window has samples
    grid = np.linspace(-reach, reach, 75)
    for condition in study.CONDITIONS:
        people = [part for _, part in data[data["condition"] == condition].groupby("participant")]
        curves = np.array([np.interp(grid, one["way"], one["human_y"].rolling(25, 1, True).mean(), np.nan, np.nan)
                           for one in people])  # fmt: skip
        for curve in curves:
            axes.plot(grid, curve, color=study.COLOURS[condition], linewidth=0.5, alpha=0.4)
        axes.plot(grid, np.nanmean(curves, axis=0), color=study.COLOURS[condition], linewidth=2.0, label=condition)
    axes.axvline(0.0, color="#777777", linewidth=0.8)
    axes.set(xlabel="way of the robot's grasp past the furcation [m]", ylabel="human force along y [N]")
    axes.legend()
    axes.grid(axis="y")
    return fig


def _bars(options):
    table, _ = _parted(options)
    findings = [finding(seen, claim, f"mean {change:+.1%}, {shown} of {cases} cases")
                for claim, change, shown, cases, seen in study.successes(table)]  # fmt: skip
    return table, _bar_picture(table), findings, study.PEOPLE


@styled
def _bar_picture(table):
    fig = figure(6.4, 3.2)
    force, torque = fig.subplots(1, 2, gridspec_kw={"width_ratios": [2, 1]})
    for axes, names in ((force, ("x", "y")), (torque, ("phi",))):
        for i, condition in enumerate(study.CONDITIONS):
            part = table[table["condition"] == condition]
            values = [part[f"human_{name}"] for name in names]
            axes.bar(np.arange(len(names)) + 0.26 * (i - 1), [v.mean() for v in values], 0.24,
                     yerr=[v.std(ddof=1) for v in values], color=study.COLOURS[condition], label=condition, capsize=2,
                     error_kw={"ecolor": "#888888"})
        axes.set_xticks(range(len(names)), [name.replace("phi", "φ") for name in names])
    force.set_ylabel("mean |human force| [N]")
    torque.set_ylabel("mean |human torque| [Nm]")
    force.legend(fontsize=8)
    return fig
