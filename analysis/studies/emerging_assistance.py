"""Emerging assistance of 5.1.1 with simulated participants: prediction error and force over the repetitions.

The experiment `emerging_assistance` twice, as figures 5.2 and 5.3: at one's own pace, and following an exemplary run of
32 s. The robot begins with nothing learned and learns during the repetitions; in some of them (the experiment's own
list, 16 to 18) it predicts but does not assist. table.csv: one row per condition, participant and repetition, with the
share of the time for which there was a prediction and the primitives known at the end. ratios.csv: per participant the
mean of the repetitions without assistance over that of their neighbours (three before, two after). Each trend that the
thesis reports is looked for in every participant; where less than all of the mean and most participants show it, the
line says MISS. Simulated people learn too (their internal model of the load), which is why assistance is switched off.
"""

import numpy as np
import pandas as pd

from phri_analysis import simulate
from phri_analysis.errors import DataError
from phri_analysis.plots import figure, styled

from . import _page

TITLE = "Emerging assistance of 5.1.1 with simulated participants"
EXPERIMENT = "emerging_assistance"
CONDITIONS = {"self-paced": 0.0, "paced": 32.0}  # pace of the exemplary run [s]; 0: none
BEFORE, AFTER = 3, 2  # repetitions with assistance that those without are compared with
SELDOM = 0.5  # of the time with a prediction, or less: the repetition's error says little about what is known
FIRST = 3  # repetitions in which no primitive can be known: m = 3 members make one
SHOWN = {  # column: (heading, factor to the shown unit, decimals)
    "prediction_error": ("Prediction error 0.3 s ahead [mm]", 1e3, 2),
    "human_force": ("Human force [N]", 1.0, 2),
    "completion_time": ("Execution time [s]", 1.0, 2),
}
ALSO = ("assistance_force", "human_power", "disagreement", "prediction_coverage_95")
COLOURS = {"self-paced": "#0072b2", "paced": "#d55e00"}


def measure(people, jobs: int, progress: bool, conditions=CONDITIONS, trials=None) -> tuple:
    """(table: one row per condition, participant and repetition; the experiment)."""
    parts = []
    for name, pace in conditions.items():
        request = simulate.Request(EXPERIMENT, participants=people, trials=trials, settings=(("pace", pace),))
        kept = simulate.simulate(request, jobs, progress=progress)
        rows = kept.table()
        known = pd.DataFrame(kept.settings)[["participant", "trial", "primitives", "predicted"]]
        rows = rows[rows["subtask"] == "whole"].merge(known, on=["participant", "trial"], validate="one_to_one")
        rows.insert(0, "condition", name)
        parts.append(rows)
    experiment = simulate.plan(request)[1]
    table = pd.concat(parts, ignore_index=True)
    table["assisted"] = ~table["trial"].isin([int(trial) for trial in experiment.assistance_off])
    columns = ["condition", "participant", "trial", "seed", "completed", "assisted", "primitives", "predicted", *SHOWN]
    return table[[*columns, *ALSO]], experiment


def neighbours(off: list, trials: int) -> tuple:
    """(before, after): repetitions with assistance next to those without; DataError where there are none."""
    if not off or off != list(range(off[0], off[-1] + 1)):
        raise DataError(f"assistance_off is {off}, expected repetitions in a row")
    before = [trial for trial in range(off[0] - BEFORE, off[0]) if trial >= 1]
    after = [trial for trial in range(off[-1] + 1, off[-1] + 1 + AFTER) if trial <= trials]
    if not before or not after:
        raise DataError(f"assistance_off is {off} of {trials} repetitions, expected some before and after them")
    return before, after


def ratios(table: pd.DataFrame, off: list, trials: int) -> pd.DataFrame:
    """Per condition and participant: mean with assistance off over mean of the neighbouring repetitions."""
    before, after = neighbours(off, trials)
    rows = []
    for (condition, person), part in table.groupby(["condition", "participant"], sort=False):
        means = part.set_index("trial")[list(SHOWN)]
        first = means.loc[[trial for trial in range(1, FIRST + 1) if trial not in off]].mean()
        on, without = means.loc[before + after].mean(), means.loc[off].mean()
        rows.append({
            "condition": condition, "participant": person,
            **{f"{name}_{key}": values[name] for name in SHOWN
               for key, values in (("first", first), ("on", on), ("off", without))},
            **{f"{name}_off_over_on": without[name] / on[name] for name in ("human_force", "completion_time")},
        })  # fmt: skip
    return pd.DataFrame(rows)


def trends(compared: pd.DataFrame) -> list:
    """(condition, claim of the thesis, participants that show it, participants, change of the mean, seen). A trend is
    seen if the mean over participants and more than half of them show it."""
    claims = [  # condition or both, claim, column, than column, sign
        ("", "force falls with learning", "human_force_on", "human_force_first", -1),
        ("", "force rises when assistance is off", "human_force_off", "human_force_on", 1),
        ("self-paced", "executions become slower when assistance is off", "completion_time_off",
         "completion_time_on", 1),
        ("self-paced", "executions become faster with learning", "completion_time_on", "completion_time_first", -1),
        ("paced", "without assistance the initial force is recovered (within 10 %)", "human_force_off",
         "human_force_first", 0),
    ]  # fmt: skip
    rows = []
    for condition, part in compared.groupby("condition", sort=False):
        for where, claim, name, than, sign in claims:
            if where not in ("", condition):
                continue
            change = part[name] / part[than] - 1.0
            shown = change * sign > 0 if sign else change.abs() <= 0.1
            overall = part[name].mean() / part[than].mean() - 1.0
            mean_shows = overall * sign > 0 if sign else abs(overall) <= 0.1
            rows.append((condition, claim, int(shown.sum()), len(part), overall,
                         bool(mean_shows and shown.sum() > len(part) / 2)))
    return rows


def learning_trend(table: pd.DataFrame) -> list:
    """Whether the prediction error falls, in the form of `trends`: the first three repetitions with assistance in which
    there were predictions for more than half of the time against the last three such."""
    rows = []
    for condition, part in table.groupby("condition", sort=False):
        change, early_all, late_all = [], [], []  # of each participant
        for _, one in part[part["assisted"] & (part["predicted"] > SELDOM)].groupby("participant"):
            errors = one.sort_values("trial")["prediction_error"].to_numpy()
            early, late = errors[:3].mean(), errors[-3:].mean()
            change.append(late / early - 1.0)
            early_all.append(early)
            late_all.append(late)
        overall = np.mean(late_all) / np.mean(early_all) - 1.0 if change else np.nan
        shown = int(np.sum(np.array(change) < 0))
        people = part["participant"].nunique()
        rows.append((condition, "prediction error falls with learning", shown, people, overall,
                     bool(overall < 0 and shown > people / 2)))
    return rows


@styled
def picture(table: pd.DataFrame, off: list):
    """As figures 5.2 and 5.3: the three curves over the repetitions, mean and standard deviation over participants."""
    fig = figure(7.4, 6.0)
    conditions = list(dict.fromkeys(table["condition"]))
    panels = fig.subplots(len(SHOWN), len(conditions), sharex=True, sharey="row", squeeze=False)
    for column, condition in enumerate(conditions):
        part = table[table["condition"] == condition]
        for axes, (name, (heading, factor, _)) in zip(panels[:, column], SHOWN.items()):
            drawn = part[part["predicted"] > SELDOM] if name == "prediction_error" else part
            over = drawn.groupby("trial")[name]
            mean, spread = over.mean() * factor, over.std(ddof=1) * factor
            axes.axvspan(off[0] - 0.5, off[-1] + 0.5, color="#dfe2e7", zorder=0)
            axes.fill_between(mean.index, mean - spread, mean + spread, color=COLOURS.get(condition), alpha=0.2,
                              linewidth=0)
            axes.plot(mean.index, mean, "o-", color=COLOURS.get(condition), markersize=3.5)
            axes.grid(axis="y")
            if column == 0:
                axes.set_ylabel(heading.replace(" 0.3 s ahead", "\n0.3 s ahead"))
        panels[0, column].set_title(f"{condition}, {part['participant'].nunique()} simulated participants")
        panels[-1, column].set_xlabel("repetition (grey: without assistance)")
        panels[-1, column].set_xticks(range(1, int(table["trial"].max()) + 1, 1 if table["trial"].max() < 10 else 2))
    for row in panels:
        row[0].set_ylim(bottom=0)
    return fig


def rows_of(table: pd.DataFrame) -> tuple:
    """(header, rows) of text: per condition and repetition, mean and standard deviation over participants."""
    header = ["Condition", "Repetition", *[entry[0] for entry in SHOWN.values()], "Predicting", "Primitives"]
    rows = []
    for (condition, trial), part in table.groupby(["condition", "trial"], sort=False):
        cells = [
            "–" if part[name].isna().all() else
            f"{factor * part[name].mean():.{digits}f} ± {factor * part[name].std(ddof=1):.{digits}f}"
            for name, (_, factor, digits) in SHOWN.items()
        ]  # fmt: skip
        number = str(trial) if part["assisted"].all() else f"{trial} (off)"
        rows.append([condition, number, *cells, f"{100 * part['predicted'].mean():.0f} %",
                     f"{part['primitives'].mean():.1f}"])
    return header, rows


def ratio_rows(compared: pd.DataFrame) -> tuple:
    header = ["Condition", "Off over on", "Mean", "SD", "Lowest", "Highest", "Above 1"]
    rows = []
    for condition, part in compared.groupby("condition", sort=False):
        for name, text in (("human_force", "human force"), ("completion_time", "execution time")):
            values = part[f"{name}_off_over_on"]
            rows.append([condition, text, f"{values.mean():.3f}", f"{values.std(ddof=1):.3f}", f"{values.min():.3f}",
                         f"{values.max():.3f}", f"{int((values > 1).sum())} of {len(values)}"])
    return header, rows


def trend_rows(found: list) -> tuple:
    header = ["Condition", "Trend of the thesis", "Participants", "Change of the mean", ""]
    return header, [
        [condition, claim, f"{shown} of {people}", f"{100 * change:+.1f} %", "seen" if seen else "MISS"]
        for condition, claim, shown, people, change, seen in found
    ]


def run(options) -> list:
    table, experiment = measure(options.people, options.jobs, options.progress)
    off = sorted(int(trial) for trial in experiment.assistance_off)
    compared = ratios(table, off, experiment.trials)
    found = sorted(trends(compared) + learning_trend(table), key=lambda row: list(CONDITIONS).index(row[0]))
    people = table["participant"].nunique()
    _page.write_csv(table, options.out / "table.csv")
    _page.write_csv(compared, options.out / "ratios.csv")
    _page.write_session(options.out, EXPERIMENT, {
        "experiment": EXPERIMENT, "seed": experiment.seed, "participants": people, "trials": experiment.trials,
        "assistance_off": off, "pace": dict(CONDITIONS),
    })  # fmt: skip
    unfinished = int((~table["completed"]).sum())
    notes = [f"{unfinished} of {len(table)} repetitions were not finished in time."] if unfinished else []
    sections = [
        _page.Section("Over the repetitions", *rows_of(table),
                      note="Mean ± standard deviation over participants. The picture leaves out the errors of "
                           "repetitions with predictions for half of the time or less.",
                      figure=picture(table, off), name="emerging_assistance"),
        _page.Section("Without assistance over with assistance", *ratio_rows(compared),
                      note=f"Repetitions {off} over {neighbours(off, experiment.trials)}, per participant."),
        _page.Section("Trends of the thesis", *trend_rows(found)),
    ]
    path = _page.write_page(options.out, TITLE, __doc__.partition("\n\n")[2], sections)
    return [
        _page.aligned(*rows_of(table)), "", _page.aligned(*ratio_rows(compared)), "",
        _page.aligned(*trend_rows(found)), *notes, "",
        f"table:  {options.out / 'table.csv'}", f"report: {path}",
    ]  # fmt: skip
