"""Simulated participants against the thesis' table 5.1 (a), the spread between them, and what it depends on.

Condition (a), no assistance, third trial, alone (the two trials before it are practice). The people of seed 7 are those
on whom the median speed was chosen; nothing was chosen on those of seeds 11 and 2015. Leaves

  table.csv         seed, participant, subtask, completed, every measure
  people.csv        seed, participant, every parameter of the person
  summary.csv       per seed: measure, thesis, mean, SD, band, verdict
  sensitivity.csv   per parameter of the population and outcome: elasticity and its standard error
  correlations.csv  between people: rank correlation of parameters with outcomes
"""

from pathlib import Path

import numpy as np
import pandas as pd

from phri_analysis import metrics, style

from . import _page, _people, _pictures, _sensitivity

PEOPLE = 19
SEEDS = {7: "calibrated on", 11: "not calibrated on", 2015: "not calibrated on"}
BAND = 0.25  # of the thesis' mean
SPREAD_BAND = (0.10, 0.25)  # SD / mean of the force between people
THESIS = {"human_force": 12.92, "human_power": 0.61, "collision_force": 1.32}  # table 5.1 (a); [N], [W], [N]
# the thesis' text on figure 5.18: means over all seven controllers, not (a) alone; [W], [N]
THESIS_SUBTASKS = {"human_power": {"MO": 0.46, "NC": 0.58}, "collision_force": {"MO": 2.67, "NC": 0.65}}
BANDED = ("human_force", "human_power")  # the acceptance bands; the rest is shown
SHOWN_FROM = 0.01  # elasticity: a change of the parameter by 20 % does 0.2 %
SHOWN = ("completion_time", "human_force", "human_power", "collision_force", "collision_count")


def summary(measures: pd.DataFrame) -> pd.DataFrame:
    """Per seed and measure of the whole task: mean, SD between people, band and verdict: "met", "missed", or "" where
    there is no band."""
    rows = []
    for seed, group in measures.loc["whole"].groupby(level="seed"):
        for name in SHOWN:
            mean, sd = group[name].mean(), group[name].std(ddof=1)
            thesis = THESIS.get(name, np.nan)
            low, high = ((1 - BAND) * thesis, (1 + BAND) * thesis) if name in BANDED else (np.nan, np.nan)
            rows.append((seed, name, thesis, mean, sd, low, high, _verdict(mean, low, high)))
        ratio = group["human_force"].std(ddof=1) / group["human_force"].mean()
        rows.append((seed, _sensitivity.SPREAD, np.nan, ratio, np.nan, *SPREAD_BAND, _verdict(ratio, *SPREAD_BAND)))
    return pd.DataFrame(rows, columns=["seed", "measure", "thesis", "mean", "sd", "low", "high", "verdict"])


def _verdict(value, low, high):
    if np.isnan(low):
        return ""
    return "met" if low <= value <= high else "missed"


def heading(name: str) -> str:
    if name == _sensitivity.SPREAD:
        return "SD / mean of the force between people [%]"
    return metrics.MEASURES[name].heading


def _unit(name):
    return "share" if name == _sensitivity.SPREAD else metrics.MEASURES[name].unit


def summary_rows(table: pd.DataFrame) -> tuple:
    """(header, rows) of text: measures by seeds, with the thesis and the band."""
    seeds = list(dict.fromkeys(table["seed"]))
    header = ["Measure", "Thesis, 19 people", "Band", *[f"Seed {seed}, {SEEDS[seed]}" for seed in seeds]]
    rows = []
    for name in dict.fromkeys(table["measure"]):
        part = table[table["measure"] == name].set_index("seed")
        first, unit = part.iloc[0], _unit(name)

        def cell(seed):
            entry = part.loc[seed]
            text = style.row_of_means([entry["mean"]], [entry["sd"]], unit)[0]
            return text + {"": "", "met": ", met", "missed": ", **missed**"}[entry["verdict"]]

        band = "none" if np.isnan(first["low"]) else _range(first["low"], first["high"], unit)
        thesis = "not given" if np.isnan(first["thesis"]) else f"{first['thesis']:g}"
        rows.append([heading(name), thesis, band, *map(cell, seeds)])
    return header, rows


def _range(low, high, unit):
    return f"{style.number(low, unit)} to {style.number(high, unit)}"


def subtask_rows(measures: pd.DataFrame) -> tuple:
    """(header, rows) of text: measures of both subtasks, beside the thesis' means over its seven controllers."""
    seeds = sorted(set(measures.index.get_level_values("seed")))
    rows = []
    for name, thesis in THESIS_SUBTASKS.items():
        for part, value in thesis.items():
            groups = [measures.loc[(part, seed), name] for seed in seeds]
            cells = [style.row_of_means([g.mean()], [g.std(ddof=1)], metrics.MEASURES[name].unit)[0] for g in groups]
            rows.append([f"{heading(name)}, {part}", f"{value:g}", *cells])
    return ["Measure", "Thesis, (a) to (g) together", *[f"Seed {seed}, (a)" for seed in seeds]], rows


def sensitivity_rows(table: pd.DataFrame, only_significant: bool = False) -> tuple:
    """(header, rows) of text: parameters by outcomes, strongest on the force first; a dash where the value may be 0 or
    is below SHOWN_FROM."""
    wide = table.pivot(index="parameter", columns="outcome", values="value")
    errors = table.pivot(index="parameter", columns="outcome", values="error")
    shown = table.assign(shown=table["significant"].astype(bool) & (table["value"].abs() >= SHOWN_FROM))
    sure = shown.pivot(index="parameter", columns="outcome", values="shown")
    step = table.drop_duplicates("parameter").set_index("parameter")["step"]
    names = [*_sensitivity.OUTCOMES, _sensitivity.SPREAD]
    order = wide["human_force"].abs().sort_values(ascending=False, kind="stable").index
    rows = []
    for parameter in order:
        if only_significant and not sure.loc[parameter, names].any():
            continue
        mark = "" if step[parameter] != "spread" else ", per spread"
        cells = [
            f"{wide.loc[parameter, n]:+.2f} ± {errors.loc[parameter, n]:.2f}" if sure.loc[parameter, n] else "–"
            for n in names
        ]
        rows.append([f"`{parameter}`{mark}", *cells])
    return ["Parameter", "Force", "Power", "Time", "Collision force", "SD / mean of force"], rows


def correlation_rows(table: pd.DataFrame, bound: float) -> tuple:
    """(header, rows) of text: only correlations beyond `bound`, and only parameters that have one."""
    rows = [
        [f"`{parameter}`", *[f"{value:+.2f}" if abs(value) > bound else "–" for value in row]]
        for parameter, row in table.iterrows()
        if (row.abs() > bound).any()
    ]
    return ["Parameter", *[metrics.MEASURES[name].label for name in table.columns]], rows


def run(options) -> list:
    people, seeds = options.people or PEOPLE, tuple(SEEDS)
    calls = [((seed,), people) for seed in seeds]
    parts = _people.spread(_people.measures, calls, min(options.jobs, len(calls)), options.progress, "people")
    measures = pd.concat(parts).sort_index()
    whole = measures.loc["whole"]
    who = _people.parameters(seeds, people)
    result = summary(measures)
    sensitivity = _sensitivity.table(whole, seeds, people, (), options.jobs, options.progress)
    correlated = _sensitivity.correlations(who, whole)
    bound = _sensitivity.threshold(len(who), correlated.size)

    order = [name for name in metrics.SUBTASKS if name in measures.index.get_level_values("subtask")]
    flat = measures.reset_index()
    flat["subtask"] = pd.Categorical(flat["subtask"], order, ordered=True)
    flat = flat.sort_values(["seed", "participant", "subtask"])
    columns = ["seed", "participant", "subtask", "completed", *[n for n in metrics.MEASURES if flat[n].notna().any()]]
    _page.write_csv(flat[columns], options.out / "table.csv")
    _page.write_csv(who.reset_index(), options.out / "people.csv")
    _page.write_csv(result, options.out / "summary.csv")
    _page.write_csv(sensitivity, options.out / "sensitivity.csv")
    _page.write_csv(correlated.rename_axis("parameter").reset_index(), options.out / "correlations.csv")
    _page.write_session(options.out, "calibration", {"experiment": _people.EXPERIMENT, "condition": "none", "trial": 3,
                                                     "seeds": list(seeds), "participants": people})
    picture = _pictures.calibration_figure(whole, sensitivity, THESIS, BAND)
    head, rows = summary_rows(result)
    _page.write_page(
        options.out,
        "Calibration of the simulated participants",
        f"Condition (a), no assistance, third trial, {people} simulated participants per seed; mean ± SD between them. "
        "The median of the comfortable speed was chosen on seed 7, nothing on the others.",
        [
            _page.Section("Against the thesis", head, rows, figure=picture, name="calibration"),
            _page.Section(
                "Subtasks", *subtask_rows(measures), note="MO moving obstacle, NC narrow channel; no band."
            ),
            _page.Section(
                "Sensitivity",
                *sensitivity_rows(sensitivity),
                note=f"Elasticity: relative change of the outcome per relative change of the parameter, from ±"
                f"{_sensitivity.CHANGE:.0%} with the same {len(who)} people and noise, ± jackknife standard error; "
                "per spread where the median is 0. A dash: within three standard errors of 0, or below 0.01.",
            ),
            _page.Section(
                "Parameters of the person and outcomes",
                *correlation_rows(correlated, bound),
                note=f"Rank correlation over {len(who)} people. Shown beyond {bound:.2f}, which one of the "
                f"{correlated.size} correlations of independent numbers would pass with probability 5 %.",
            ),
            _page.Section("Simulated participants", *_participant_rows(whole)),
        ],
    )
    return [_page.aligned(head, rows), "", f"table:  {Path(options.out) / 'table.csv'}",
            f"report: {Path(options.out) / 'report.html'}"]


def _participant_rows(whole):
    header = ["Seed", "Participant", *[metrics.MEASURES[name].heading for name in SHOWN]]
    rows = [
        [str(seed), str(index), *[style.number(row[name], metrics.MEASURES[name].unit) for name in SHOWN]]
        for (seed, index), row in whole.iterrows()
    ]
    return header, rows
