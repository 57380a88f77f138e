"""Figures 5.21 and 5.22, and table 5.3: contact tasks repeated where the environment has moved (5.4.3).

Both figures show one reproduction each, along the direction of pressing; the table is the study `contact`.
"""

import functools

import numpy as np
import pandas as pd

from phri_analysis.plots import figure, styled
from studies import contact as study

from . import Page, finding

IDS = ("5.21", "5.22")
STIFF, SOFT, ADAPTED = "neutral_learned", "seeking_learned", "neutral_adapted"
SHOWN = {  # figure: [(task, controller, displacement [m])]
    "5.21": [("button", STIFF, 0.10), ("button", SOFT, 0.10)],
    "5.22": [("button", ADAPTED, 0.05), ("whiteboard", ADAPTED, 0.05)],
}
AXES = "xyz"
GAIN, INPUT, LEARNED, REFERENCE, TIP = "#0072b2", "#222222", "#009e73", "#d55e00", "#888888"
ACTIVE = 1.0  # [N] of u_f, from which on the force control is at work
TEXTS = {
    "5.21": ("Gains with and without regard to the force error",
             "Button, 10 cm lower. The stiffness of the risk-neutral controller follows from the optimisation alone; "
             "that of the risk-seeking one falls where the force control is active, so that it presses better. Table "
             "5.3 counts successes, partial successes and failures."),
    "5.22": ("Adaptation of the reference",
             "Both tasks, 5 cm displaced, controller (c). The adapted reference leaves the learned one and makes room "
             "for the force control: the button is pressed better, but at the end a drift is left and the pointing "
             "is off. On the whiteboard the adaptation overcompensates."),
}  # fmt: skip


@functools.cache
def _taught(name: str):
    import phri_sim

    task = study.load(name)
    seed = 1000 * task.seed
    return task, phri_sim.teach_contact(task, seed), seed


@functools.cache
def _measured(jobs: int) -> pd.DataFrame:
    return study.measure(None, jobs, False)


def reproduction(name: str, controller: str, displacement: float) -> pd.DataFrame:
    """Along the direction of pressing, as coordinate in the world: position, learned, reference [m], stiffness [N/m],
    input, force, taught [N], over t [s]."""
    import phri_sim

    task, taught, seed = _taught(name)
    columns, _ = phri_sim.run_contact(task, controller, taught, seed, displacement)
    axis = AXES[int(np.argmax(np.abs(task.press_direction)))]
    rows = pd.DataFrame({"task": name, "controller": controller, "displacement": displacement, "t": columns["t"],
                         "position": columns[axis], "contact": columns["contact"], "travel": columns["travel"],
                         "wiped": columns["wiped"]})  # fmt: skip
    for column in ("learned", "reference", "stiffness", "input", "force", "taught"):
        rows[column] = columns[f"{column}_{axis}"]
    return rows


@styled
def _gains(parts):
    fig = figure(7.4, 4.6)
    panels = fig.subplots(2, len(parts), sharex=True, sharey="row", height_ratios=[3, 2])
    for (upper, lower), rows in zip(panels.T, parts):
        name = rows["controller"].iloc[0]
        upper.plot(rows["t"], rows["stiffness"], color=GAIN, label="stiffness K [N/m]")
        upper.set_title(f"({study.LETTERS[name]}) {name}")
        right = upper.twinx()
        right.spines["right"].set_visible(True)
        right.plot(rows["t"], rows["input"], "--", color=INPUT, label="force control $u_f$ [N]")
        right.set_ylim(-10, 25)
        right.set_ylabel("$u_f$ [N]" if rows is parts[-1] else "")
        lower.plot(rows["t"], rows["learned"], color=LEARNED, label="learned reference")
        lower.plot(rows["t"], rows["position"], color=TIP, label="tip")
        touching = rows[rows["contact"] > 0.0]
        lower.plot(touching["t"], touching["position"], ".", color=INPUT, markersize=2, label="in contact")
        lower.set_xlabel("time [s]")
    panels[0, 0].set_ylabel("K [N/m]")
    panels[1, 0].set_ylabel("height [m]")
    panels[0, 0].set_ylim(bottom=0)
    lines = [*panels[0, 0].get_lines(), *right.get_lines(), *panels[1, 1].get_lines()]
    study.legend_below(fig, lines, [line.get_label() for line in lines])
    return fig


@styled
def _references(parts):
    fig = figure(7.4, 4.6)
    panels = fig.subplots(2, len(parts), sharex="col", height_ratios=[3, 2], squeeze=False)
    for (upper, lower), rows in zip(panels.T, parts):
        upper.plot(rows["t"], rows["learned"], color=LEARNED, label="learned reference")
        upper.plot(rows["t"], rows["reference"], "-.", color=REFERENCE, label="adapted reference")
        upper.plot(rows["t"], rows["position"], color=TIP, linewidth=0.8, label="tip")
        name = rows["task"].iloc[0]
        upper.set_title(f"{name}, {100 * rows['displacement'].iloc[0]:+.0f} cm, ({study.LETTERS[ADAPTED]})")
        upper.set_ylabel("height z [m]" if name == "button" else "toward the board x [m]")
        lower.plot(rows["t"], rows["input"], "--", color=INPUT, label="force control $u_f$")
        lower.set_ylabel("$u_f$ [N]")
        lower.set_xlabel("time [s]")
    lines = [*panels[0, 0].get_lines(), *panels[1, 0].get_lines()]
    study.legend_below(fig, lines, [line.get_label() for line in lines])
    return fig


def page(id, options) -> Page:
    parts = [reproduction(*shown) for shown in SHOWN[id]]
    title, thesis = TEXTS[id]
    tables = {}
    if id == "5.21":
        findings = list(_gain_findings(*parts))
        counted = study.counts(_measured(options.jobs))
        findings += [finding(shown, statement, evidence) for statement, shown, evidence in study.claims(counted)]
        tables["table_5_3"] = pd.DataFrame(study.count_rows(counted)[1], columns=study.count_rows(counted)[0])
    else:
        findings = list(_reference_findings(*parts))
    return Page(
        id=id,
        title=title,
        thesis=thesis,
        setting=study.setting(tuple(dict.fromkeys(name for name, *_ in SHOWN[id]))),
        deviations=(
            "Robot, surroundings and demonstrations are simulated: no person took part. Places, measures and forces of "
            "the tasks are ours; the thesis shows photographs.",
            "The thesis' theta of 1e-5 changes nothing in the units of (5.45); ours follows from how far a tool that "
            "does not adapt its reference may give way (docs/contact.md).",
            "The thesis sets the velocity gain to 0; here it is the optimal one.",
            "The thesis' captions of both figures name (c); which controllers are meant follows from its text.",
        ),
        data=pd.concat(parts, ignore_index=True),
        figure=_gains(parts) if id == "5.21" else _references(parts),
        findings=tuple(findings),
        tables=tables,
    )  # fmt: skip


def pressing(rows: pd.DataFrame) -> pd.Series:
    """Where the learned force is at least half of its largest: the tool is to press."""
    return rows["taught"].abs() >= 0.5 * rows["taught"].abs().quantile(0.98)


def _gain_findings(stiff, soft):
    medians = {}
    for rows in (stiff, soft):
        active = rows["input"].abs() > ACTIVE
        medians[rows["controller"].iloc[0]] = (rows.loc[active & pressing(rows), "stiffness"].median(),
                                               rows.loc[~active, "stiffness"].median())  # fmt: skip
    (a, _), (b, free) = medians[STIFF], medians[SOFT]
    yield finding(b < a, "where the force control presses, (b) is softer than (a)",
                  f"median stiffness {b:.0f} against {a:.0f} N/m")
    yield finding(b < free, "(b) is softer there than where the force control is not active",
                  f"{b:.0f} against {free:.0f} N/m")
    yield finding(soft["contact"].max() > stiff["contact"].max(), "(b) controls the force better than (a)",
                  "mean learned force {:.1f} N while pressing; felt {:.1f} N by (b), {:.1f} N by (a)".format(
                      *(rows.loc[pressing(rows), column].mean()
                        for rows, column in ((soft, "taught"), (soft, "force"), (stiff, "force")))))  # fmt: skip


def _reference_findings(button, board):
    drift = abs((button["reference"] - button["learned"]).iloc[-1])
    yield finding(drift > 0.005, "a drift is left at the end of the button task",
                  f"{1e3 * drift:.0f} mm after a displacement of 50 mm")
    pressed = button.loc[pressing(button), "force"].abs().iloc[-25:].mean()
    taught = button.loc[pressing(button), "taught"].abs().iloc[-25:].mean()
    yield finding(abs(pressed - taught) < 0.2 * taught, "with the adapted reference the button is pressed as taught",
                  f"{pressed:.1f} N, taught {taught:.1f} N, in the last half second of pressing")
    most = (board["reference"] - board["learned"]).max()
    yield finding(most > 1.2 * 0.05, "on the whiteboard the adaptation overcompensates",
                  f"up to {1e3 * most:.0f} mm for a displacement of 50 mm")
