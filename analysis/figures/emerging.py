"""Figures 5.2 and 5.3: assistance that emerges while a task is repeated, at one's own pace and at a given one (5.1.1).

Both are drawn from the table of the study `emerging_assistance`, which is made once for both.
"""

import functools

import numpy as np
import pandas as pd

from studies import emerging_assistance as study

from . import Page, finding

IDS = ("5.2", "5.3")
CONDITIONS = {"5.2": "self-paced", "5.3": "paced"}
RISE = 9  # repetition from which the force rises in figure 5.2
TEXTS = {
    "5.2": ("Emerging assistance at one's own pace",
            "Prediction error, human force and execution time over 20 repetitions. The force falls with the prediction "
            "error and rises from the ninth repetition on, while people get faster. In repetitions 16 to 18, without "
            "assistance, the force clearly rises and people become slower; with it the earlier values come back."),
    "5.3": ("Emerging assistance with a given execution time",
            "An exemplary run of 32 s is followed. The effect becomes clearer: the force falls with the prediction "
            "error, and without assistance its initial values are recovered."),
}


@functools.cache
def _measured(jobs: int):
    return study.measure(None, jobs, False)


def page(id, options) -> Page:
    table, experiment = _measured(options.jobs)
    off = sorted(int(trial) for trial in experiment.assistance_off)
    mine = table[table["condition"] == CONDITIONS[id]]
    compared = study.ratios(table, off, experiment.trials)
    title, thesis = TEXTS[id]
    return Page(
        id=id,
        title=title,
        thesis=thesis,
        setting={"experiment": study.EXPERIMENT, "condition": CONDITIONS[id], "pace": study.CONDITIONS[CONDITIONS[id]],
                 "participants": int(mine["participant"].nunique()), "trials": int(experiment.trials),
                 "assistance_off": off, "seed": int(experiment.seed)},
        deviations=(
            "The participants are simulated: no person took part. They differ as the population file says, and their "
            "internal model of the load learns too.",
            "The flower is drawn after figure 3.3; its size is not printed.",
            "The thesis shows means; the bands here are standard deviations over participants. Where nothing is "
            "predicted there is no prediction error.",
        ),
        data=mine,
        figure=study.picture(mine, off),
        findings=tuple(_findings(id, table, mine, compared, off)),
        tables={"ratios": compared[compared["condition"] == CONDITIONS[id]]},
    )  # fmt: skip


def _findings(id, table, mine, compared, off):
    trends = [*study.trends(compared), *study.learning_trend(table)]
    for condition, claim, shown, people, change, seen in trends:
        if condition == CONDITIONS[id]:
            yield finding(seen, claim, f"mean {change:+.1%}, {shown} of {people} participants")
    ratio = compared.groupby("condition")["human_force_off_over_on"].agg(["mean", "std"])
    if id == "5.2":
        yield _rise(mine, off)
    else:
        own, paced = ratio.loc["self-paced", "mean"], ratio.loc["paced", "mean"]
        yield finding(paced > own, "the effect on the force is clearer than at one's own pace",
                      f"force without over with assistance {paced:.3f}, at one's own pace {own:.3f}")
    value = ratio.loc[CONDITIONS[id]]
    yield f"Human force without over with assistance: {value['mean']:.3f} ± {value['std']:.3f} over participants."
    share = mine[mine["trial"] == mine["trial"].max()]["predicted"].mean()
    late = int((~mine["completed"]).sum())
    yield f"Predictions for {share:.0%} of the last repetition; {late} of {len(mine)} repetitions ended by the clock."


def _rise(mine: pd.DataFrame, off) -> str:
    """Slopes of the means over participants from RISE to the last repetition before assistance is switched off."""
    names = ["human_force", "completion_time"]
    means = mine[(mine["trial"] >= RISE) & (mine["trial"] < off[0])].groupby("trial")[names].mean()
    force, time = (np.polyfit(means.index, means[name], 1)[0] for name in names)
    return finding(force > 0.0 > time, f"from repetition {RISE} on the force rises while executions get faster",
                   f"{force:+.4f} N and {time:+.3f} s per repetition")
