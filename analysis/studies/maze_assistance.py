"""User study of 5.3.4 with simulated participants: the maze under every controller, three trials each.

The table and report of `phri-analysis simulate maze_assistance`, session.yaml, and anova.csv: the thesis'
repeated-measures ANOVA, subtask (MO, NC) x controller, third trials, Greenhouse-Geisser corrected. A p value here says
that the simulation would do the same with other draws of the same population; it says nothing about people.
"""

import dataclasses

import pandas as pd

from phri_analysis import metrics, report, simulate, statistics, study

from . import _page, _people

TITLE = "User study of 5.3.4 with simulated participants"
TESTED = ("human_force", "human_power", "disagreement", "collision_force", "completion_time")
FACTORS = ("subtask", "controller")


def anova(table: pd.DataFrame) -> pd.DataFrame:
    """All tested measures; disagreement without condition (a), where it is 0 by definition."""
    rows = study.judged(table)
    rows = rows[rows["subtask"] != "whole"]
    parts = []
    for name in TESTED:
        used = rows[rows["controller"] != "none"] if name == "disagreement" else rows
        parts.append(statistics.anova(used, name, FACTORS))
    return pd.concat(parts, ignore_index=True)


def anova_rows(table: pd.DataFrame) -> tuple:
    """(header, rows) of text."""
    rows = [
        [metrics.MEASURES[e.measure].label, e.effect, f"F({e.epsilon_gg * e.df1:.3g}, {e.epsilon_gg * e.df2:.3g}) = "
         f"{e.F:.2f}", "p < .001" if e.p_gg < 0.001 else f"p = {e.p_gg:.3f}", f"{e.partial_eta2:.2f}"]
        for e in table.itertuples()
    ]  # fmt: skip
    return ["Measure", "Effect", "Greenhouse-Geisser", "", "Partial eta²"], rows


def run(options) -> list:
    request = simulate.Request(_people.EXPERIMENT, participants=options.people)
    kept = simulate.simulate(request, options.jobs, progress=options.progress)
    _, experiment, _ = simulate.plan(request)
    notes = [("Command", "phri-analysis study maze_assistance"), ("Revision", simulate.git_revision() or "unknown")]
    path = report.write_report(kept, options.out, TITLE, notes)
    table = kept.table()
    tested = anova(table)
    _page.write_csv(tested, options.out / "anova.csv")
    _page.write_session(options.out, "maze_assistance", {
        **{key: value for key, value in dataclasses.asdict(request).items() if value},
        "seed": experiment.seed, "controllers": list(experiment.controllers), "trials": experiment.trials,
        "participants": options.people or experiment.participants,
    })  # fmt: skip
    return [
        report.terminal_table(table), "", _page.aligned(*anova_rows(tested)), "",
        f"table:  {options.out / 'table.csv'}", f"report: {path}",
    ]  # fmt: skip
