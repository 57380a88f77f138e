"""Joint transport of 5.1.2 with simulated people: force, torque and prediction over nine trials, and at furcations.

Nine trials on three ways, learned while carrying, once with assistance and once without (paired: the same people, noise
and odometry). table.csv: one row per condition, participant and trial. Then furcations: the robot has carried twice the
way that the person takes the third time (agreement), or twice the other way (disagreement, provoked so), or does not
assist. furcations.csv: one row per way taken, condition and participant, means over the 1.5 m of way around the
place where the two ways part. Forces are those of the wrist sensor at the robot's grasp, as the loop uses them. Each
statement of the thesis is looked for; where the mean or most cases do not show it, the line says MISS.
"""

import functools
import multiprocessing
from concurrent import futures

import numpy as np
import pandas as pd
from tqdm import tqdm

from phri_analysis import metrics, simulate
from phri_analysis.errors import AnalysisError, DataError
from phri_analysis.plots import figure, styled

from . import _page

TITLE = "Joint transport of 5.1.2 with simulated people"
EXPERIMENT = "transport"
PEOPLE = 6
TRIALS = 9
ASSISTED = {"assistance": "pd", "no assistance": "none"}
CONDITIONS = ("no assistance", "disagreement", "agreement")
COLOURS = {"no assistance": "#009e73", "disagreement": "#000000", "agreement": "#d55e00", "assistance": "#d55e00"}
# way taken, other way that is common up to the furcation
FURCATIONS = (("right_of_trolley", "left_of_car"), ("left_of_car", "right_of_trolley"), ("between", "left_of_car"),
              ("left_of_car", "between"))  # fmt: skip
APART = 0.1  # [m] two ways that are farther apart have parted
AROUND = 0.75  # [m] of way before and after, as in figure 5.8
AFTER = 0.5  # [m] of way after which the thesis sees the prediction corrected
SIGNIFICANT = 0.1  # share by which a force must fall to be called significantly lower
COMPARABLE = 0.2  # share by which comparable forces may differ
EVERY = 20  # [ticks] between the rows that are kept of a trial
KEPT = ["t", "x", "y", "yaw", "vx", "vy", "human_x", "human_y", "human_yaw", "assistance_x", "assistance_y",
        "assistance_yaw", "grasp_x", "grasp_y", "grasp_yaw", "prediction_x", "prediction_y"]  # fmt: skip
SHOWN = {  # column: (heading, factor to the shown unit, decimals)
    "human_force": ("Human force [N]", 1.0, 2),
    "human_torque": ("Human torque [Nm]", 1.0, 3),
    "completion_time": ("Completion time [s]", 1.0, 1),
    "prediction_error": ("Prediction error 0.3 s ahead [mm]", 1e3, 1),
}
CASES = ("taken", "other", "participant")
COMPONENTS = {"x": "human_x", "y": "human_y", "phi": "human_yaw"}


def request(routes=(), controllers=("pd",), trials=None):
    settings = (("controllers", tuple(controllers)),) + ((("routes", tuple(routes)),) if routes else ())
    return simulate.Request(EXPERIMENT, participants=1, trials=trials, settings=settings)


def _trials(routes, controller: str, participant: int, last_only: bool) -> list:
    """Tables of a block of one person; without learning only the last trial is run where no other is asked for."""
    trials = len(routes) if routes else None
    asked = simulate.Request(EXPERIMENT, participant + 1, trials, settings=request(routes, (controller,)).settings)
    phri_sim, experiment, blocks = simulate.plan(asked)
    block = next(block for block in blocks if block.participant == participant)
    try:
        if last_only and controller == "none":
            return [phri_sim.run_alone(experiment, block.trials[-1])]
        return phri_sim.run_block(experiment, block)
    except (ValueError, RuntimeError) as error:
        raise AnalysisError(f"participant {participant}, routes {routes}: {error}") from None


def reduced(trial: pd.DataFrame) -> tuple:
    """(measures of one trial, its thinned table)."""
    whole = metrics.windows(trial)["whole"]
    attrs = trial.attrs
    row = {
        "participant": attrs["participant"], "trial": attrs["trial"], "route": attrs["route"],
        "completed": attrs["completed"], "primitives": attrs.get("primitives", 0),
        "predicted": attrs.get("predicted", 0.0), "odometry_drift": attrs["odometry_drift"],
        **{name: metrics.MEASURES[name].evaluate(whole) for name in
           ("human_force", "completion_time", "prediction_error", "assistance_force", "human_power")},
        "human_torque": whole.mean(trial["human_yaw"].abs().to_numpy()[whole.first:whole.last]),
    }  # fmt: skip
    thin = trial[KEPT].iloc[::EVERY].reset_index(drop=True)
    names = ("route", "boxes", "primitive_outputs", "odometry_drift", "participant")
    thin.attrs = {key: attrs.get(key) for key in names}
    return row, thin


def _work(task) -> list:
    routes, controller, participant, last_only = task
    kept = [reduced(trial) for trial in _trials(routes, controller, participant, last_only)]
    return kept[-1:] if last_only else kept


def run_all(tasks: list, jobs: int, progress: bool) -> list:
    """The results of `_work` in the order of the tasks."""
    if jobs == 1:
        return [_work(task) for task in tqdm(tasks, disable=not progress, unit="block")]
    context = multiprocessing.get_context("spawn")
    with futures.ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context) as pool:
        return list(tqdm(pool.map(_work, tasks), total=len(tasks), disable=not progress, unit="block"))


@functools.lru_cache(maxsize=2)
def blocks(people: int, jobs: int, progress: bool = False) -> pd.DataFrame:
    """The table of the nine trials."""
    tasks = [((), controller, person, False) for controller in ASSISTED.values() for person in range(people)]
    rows = []
    for (_, controller, _, _), kept in zip(tasks, run_all(tasks, jobs, progress)):
        condition = next(name for name, known in ASSISTED.items() if known == controller)
        rows += [{"condition": condition, **row} for row, _ in kept]
    return pd.DataFrame(rows)


@functools.lru_cache(maxsize=1)
def nine_trials() -> list:
    """The thinned trials of participant 0 with assistance."""
    return [thin for _, thin in _work(((), ASSISTED["assistance"], 0, False))]


@functools.lru_cache(maxsize=2)
def furcations(people: int, jobs: int, progress: bool = False) -> tuple:
    """(table, {(taken, other, condition, participant): thinned window with its `way` from the furcation [m]})."""
    tasks = {}
    for taken, other in FURCATIONS:
        for person in range(people):
            tasks[taken, other, "no assistance", person] = ((taken,) * 3, "none", person, True)
            tasks[taken, other, "agreement", person] = ((taken,) * 3, "pd", person, True)
            tasks[taken, other, "disagreement", person] = ((other, other, taken), "pd", person, True)
    distinct = list(dict.fromkeys(tasks.values()))
    results = dict(zip(distinct, run_all(distinct, jobs, progress)))
    rows, windows = [], {}
    for (taken, other, condition, person), task in tasks.items():
        alone = [results[(way,) * 3, "none", person, True][0][1] for way in (taken, other)]
        window = around(results[task][0][1], *parting(*alone))
        windows[taken, other, condition, person] = window
        rows.append({"taken": taken, "other": other, "condition": condition, "participant": person, **means(window)})
    return pd.DataFrame(rows), windows


def _places(trial) -> np.ndarray:
    return trial[["grasp_x", "grasp_y"]].to_numpy()


def parting(taken: pd.DataFrame, other: pd.DataFrame) -> np.ndarray:
    """Where the true way `taken` of the robot's grasp is first farther than APART from the other: (1, 2). DataError if
    it never is."""
    here, there = _places(taken), _places(other)
    distance = np.min(np.linalg.norm(here[:, None] - there[None, ::5], axis=2), axis=1)
    apart = np.flatnonzero(distance > APART)
    if len(apart) == 0:
        raise DataError("the two ways never part: expected a furcation")
    return here[apart[:1]]


def around(trial: pd.DataFrame, place: np.ndarray) -> pd.DataFrame:
    """The rows within AROUND of the way past `place`, with `way` [m] from there."""
    here = _places(trial)
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(here, axis=0), axis=1))]
    way -= way[np.argmin(np.linalg.norm(here - place, axis=1))]
    return trial.assign(way=way)[np.abs(way) <= AROUND].reset_index(drop=True)


def means(window: pd.DataFrame) -> dict:
    """Means over the time of the window; `late_y`: |u_h,y| from AFTER past the furcation on."""
    late = window[window["way"] > AFTER]
    return {
        **{f"human_{name}": window[column].abs().mean() for name, column in COMPONENTS.items()},
        "human_force": np.hypot(window["human_x"], window["human_y"]).mean(),
        "assistance_force": np.hypot(window["assistance_x"], window["assistance_y"]).mean(),
        "late_y": late["human_y"].abs().mean(),
        "predicted": window["prediction_x"].notna().mean(),
    }


def compared(table: pd.DataFrame, name: str, condition: str, than: str, keys) -> tuple:
    """(change of the mean, cases in which it is lower, cases), paired by `keys`."""
    pivot = table.pivot_table(index=list(keys), columns="condition", values=name)
    change = pivot[condition].mean() / pivot[than].mean() - 1.0
    return float(change), int((pivot[condition] < pivot[than]).sum()), len(pivot)


def statement(table, claim: str, name: str, condition: str, than: str, sign: int, keys=CASES):
    """(claim, change, cases that show it, cases, seen): seen if the mean and more than half of the cases show it."""
    change, lower, cases = compared(table, name, condition, than, keys)
    shown = lower if sign < 0 else cases - lower
    return claim, change, shown, cases, bool(change * sign > 0 and shown > cases / 2)


def learning(table: pd.DataFrame) -> list:
    """What the thesis states of the nine trials, of the last three (each way has been carried twice before)."""
    last = table[table["trial"] > TRIALS - 3]
    keys = ("participant", "trial")
    return [
        statement(last, "force falls with assistance", "human_force", "assistance", "no assistance", -1, keys),
        statement(last, "torque falls with assistance", "human_torque", "assistance", "no assistance", -1, keys),
    ]


def successes(table: pd.DataFrame) -> list:
    """What the thesis states of figures 5.8 and 5.9."""
    lines = [
        statement(table, f"{text} falls with a successful prediction", f"human_{name}", "agreement", "no assistance",
                  -1)
        for name, text in (("x", "force along x"), ("y", "force along y"), ("phi", "torque"))
    ]
    lines += [
        statement(table, f"{text} rises with a false prediction", f"human_{name}", "disagreement", "no assistance", 1)
        for name, text in (("force", "force"), ("phi", "torque"))
    ]
    _, change, shown, cases, seen = statement(table, "", "human_force", "agreement", "no assistance", -1)
    lines.append(("force falls significantly with a successful prediction (10 % or more)", change, shown, cases,
                  seen and change <= -SIGNIFICANT))
    change = compared(table, "late_y", "disagreement", "agreement", CASES)[0]
    pivot = table.pivot_table(index=list(CASES), columns="condition", values="late_y")
    near = (pivot["disagreement"] / pivot["agreement"] - 1.0).abs() <= COMPARABLE
    lines.append((f"{AFTER} m after the furcation the force is as with a successful prediction (within 20 %)", change,
                  int(near.sum()), len(near), bool(abs(change) <= COMPARABLE and near.mean() > 0.5)))
    return lines


@styled
def picture(table: pd.DataFrame):
    """Mean and standard deviation over participants of every trial, with and without assistance."""
    fig = figure(7.0, 6.4)
    panels = fig.subplots(len(SHOWN), 1, sharex=True)
    for axes, (name, (heading, factor, _)) in zip(panels, SHOWN.items()):
        for condition, part in table.groupby("condition", sort=False):
            over = part.groupby("trial")[name]
            mean, spread = over.mean() * factor, over.std(ddof=1) * factor
            axes.errorbar(mean.index, mean, spread, fmt="o-", markersize=3.5, capsize=2, label=condition,
                          color=COLOURS[condition])
        axes.set_ylabel(heading.replace(" 0.3 s ahead", "\n0.3 s ahead"))
        axes.set_ylim(bottom=0)
        axes.grid(axis="y")
    panels[0].legend(ncols=2)
    panels[-1].set_xlabel("trial (three ways in turn)")
    return fig


def rows_of(table: pd.DataFrame) -> tuple:
    headings = [entry[0] for entry in SHOWN.values()]
    header = ["Condition", "Trial", "Way", *headings, "Predicting", "Primitives", "Drift [m]"]
    rows = []
    for (condition, trial, route), part in table.groupby(["condition", "trial", "route"], sort=False):
        cells = ["–" if part[name].isna().all() else
                 f"{factor * part[name].mean():.{digits}f} ± {factor * part[name].std(ddof=1):.{digits}f}"
                 for name, (_, factor, digits) in SHOWN.items()]  # fmt: skip
        rows.append([condition, str(trial), route, *cells, f"{100 * part['predicted'].mean():.0f} %",
                     f"{part['primitives'].mean():.1f}", f"{part['odometry_drift'].mean():.2f}"])
    return header, rows


def furcation_rows(table: pd.DataFrame) -> tuple:
    header = ["Way taken", "Other way", "Condition", "|u_h,x| [N]", "|u_h,y| [N]", "|u_h,phi| [Nm]", "|u_r| [N]"]
    rows = []
    for (taken, other, condition), part in table.groupby(["taken", "other", "condition"], sort=False):
        cells = [f"{part[name].mean():.2f} ± {part[name].std(ddof=1):.2f}"
                 for name in ("human_x", "human_y", "human_phi", "assistance_force")]  # fmt: skip
        rows.append([taken, other, condition, *cells])
    return header, rows


def statement_rows(found: list) -> tuple:
    return ["Statement of the thesis", "Change of the mean", "Cases", ""], [
        [claim, f"{100 * change:+.1f} %", f"{shown} of {cases}", "seen" if seen else "MISS"]
        for claim, change, shown, cases, seen in found
    ]


def run(options) -> list:
    people = options.people or PEOPLE
    table = blocks(people, options.jobs, options.progress)
    parted, _ = furcations(people, options.jobs, options.progress)
    found = statement_rows(learning(table) + successes(parted))
    experiment = simulate.plan(request())[1]
    _page.write_csv(table, options.out / "table.csv")
    _page.write_csv(parted, options.out / "furcations.csv")
    traits = {trait.key: {"median": trait.median, "spread": trait.spread, "limits": [trait.low, trait.high]}
              for trait in experiment.traits}  # fmt: skip
    _page.write_record(options.out, EXPERIMENT, {
        "simulated_participants": True, "experiment": EXPERIMENT, "seed": experiment.seed, "participants": people,
        "trials": TRIALS, "furcations": [list(ways) for ways in FURCATIONS], "population": traits,
    })  # fmt: skip
    late = int((~table["completed"]).sum())
    notes = [f"{late} of {len(table)} trials were not finished in time."] if late else []
    sections = [
        _page.Section("Nine trials", *rows_of(table), figure=picture(table), name="transport",
                      note="Mean ± standard deviation over participants; drift: of the odometry at the end."),
        _page.Section("At furcations", *furcation_rows(parted)),
        _page.Section("Statements of the thesis", *found),
    ]  # fmt: skip
    path = _page.write_page(options.out, TITLE, __doc__.partition("\n\n")[2], sections)
    return [
        _page.aligned(*rows_of(table)), "", _page.aligned(*furcation_rows(parted)), "", _page.aligned(*found), *notes,
        "",
        f"table:  {options.out / 'table.csv'}", f"report: {path}",
    ]  # fmt: skip
