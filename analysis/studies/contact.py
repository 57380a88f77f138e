"""Contact tasks of 5.4 with simulated demonstrations: table 5.3.

A robot arm repeats two demonstrated tasks where the environment is not as it was taught: press a button, then point at
a place on a whiteboard (the button is lower by 0, 5, 10 cm), and wipe a text off a whiteboard (the board is farther
from where the tool starts by -5, 0, 5 cm; the thesis varies the initial position of the end-effector, which for a
motion that is repeated from where the tool stands is the same). Every repetition has twelve demonstrations of its own,
guided by a simulated hand, and one model for all controllers and conditions. No person took part.

What counts is what the physics of the world says. Pressing: clicked is a success, contact without click a partial one.
Pointing: tip within 5 mm of the taught place at the end. Wiping: at least 95 % of the text area at sufficient pressure
while moving, partial above 5 %. One setting for all controllers, conditions and repetitions: the defaults of
docs/contact.md, whose theta is chosen there from how far a tool without adaptation is to give way; no result was used
to choose it. Pressing force, friction and strokes are such that the undisplaced tasks stay within the energy tank.

table.csv: one row per task, condition, controller and repetition. Where the assistance was limited by the safety layer
for more than 5 % of the time, the table says so. (e) is ours: adaptation with the forgetting that the thesis asks for.
"""

import multiprocessing
from concurrent import futures

import pandas as pd
from tqdm import tqdm

from phri_analysis.errors import AnalysisError
from phri_analysis.plots import figure, styled

from . import _page

TITLE = "Contact tasks of 5.4 with simulated demonstrations"
TASKS = ("button", "whiteboard")
PARTS = {"button": ("pressing", "pointing"), "whiteboard": ("wiping",)}
LETTERS = {"neutral_learned": "a", "seeking_learned": "b", "neutral_adapted": "c", "seeking_adapted": "d",
           "seeking_forgetting": "e"}  # fmt: skip
VERDICTS = ("success", "partial", "failure")
LIMITED = 0.05  # of the time; beyond, the controller is marked
COLOURS = {"success": "#0072b2", "partial": "#e69f00", "failure": "#c9ccd1"}


def load(name: str, settings: tuple = ()):
    import phri_sim

    return phri_sim.ContactTask(name, dict(settings))


def teach_and_run(name: str, settings: tuple, seed: int) -> list:
    """All controllers in all conditions after one set of demonstrations; a row each."""
    import phri_sim

    task = load(name, settings)
    taught = phri_sim.teach_contact(task, seed)
    rows = []
    for displacement in task.displacements:
        for controller in task.controllers:
            _, outcome = phri_sim.run_contact(task, controller, taught, seed, displacement)
            rows.append({"task": name, "displacement": displacement, "controller": controller, "seed": seed,
                         "repeated_demonstrations": taught.repeated, **outcome})  # fmt: skip
    return rows


def measure(seeds, jobs: int, progress: bool, settings: tuple = (), tasks=TASKS) -> pd.DataFrame:
    """One row per task, condition, controller and seed; `seeds`: their number, None for the experiments' own."""
    work = []
    for name in tasks:
        task = load(name, settings)
        count = task.seeds if seeds is None else seeds
        work += [(name, settings, 1000 * task.seed + index) for index in range(count)]
    with tqdm(total=len(work), unit="teaching", disable=not progress) as bar:
        parts = []
        for part in _results(work, jobs):
            parts.append(part)
            bar.update()
    return pd.DataFrame([row for part in parts for row in part])


def _results(work, jobs):
    if jobs == 1:
        yield from (teach_and_run(*item) for item in work)
        return
    context = multiprocessing.get_context("spawn")
    with futures.ProcessPoolExecutor(min(jobs, len(work)), mp_context=context) as pool:
        try:
            yield from pool.map(teach_and_run, *zip(*work))
        except futures.process.BrokenProcessPool:
            raise AnalysisError("a worker process died; was it short of memory? try fewer --jobs") from None


def counts(table: pd.DataFrame) -> pd.DataFrame:
    """Per task, part, condition and controller: number of successes, partial successes and failures; mean share of
    the time in which the assistance was limited."""
    rows = []
    for (task, displacement, controller), cell in table.groupby(["task", "displacement", "controller"], sort=False):
        for part in PARTS[task]:
            found = cell[part].value_counts()
            rows.append({"task": task, "part": part, "displacement": displacement, "controller": controller,
                         **{verdict: int(found.get(verdict, 0)) for verdict in VERDICTS}, "of": len(cell),
                         "limited": cell["limited"].mean()})  # fmt: skip
    order = [part for parts in PARTS.values() for part in parts]
    return pd.DataFrame(rows).sort_values("part", key=lambda names: names.map(order.index), kind="stable",
                                          ignore_index=True)  # fmt: skip


def scores(counted: pd.DataFrame) -> pd.Series:
    """Mean over the conditions, a success counts 1 and a partial one 1/2, by part and controller."""
    points = (counted["success"] + 0.5 * counted["partial"]) / counted["of"]
    return points.groupby([counted["part"], counted["controller"]]).mean()


def claims(counted: pd.DataFrame) -> list:
    """(statement of the thesis, whether it shows here, the numbers)."""
    score = scores(counted)
    adapted = ("neutral_adapted", "seeking_adapted")
    learned = ("neutral_learned", "seeking_learned")

    def cells(part, names, moved=None):
        chosen = counted[(counted["part"] == part) & counted["controller"].isin(names)]
        return chosen if moved is None else chosen[(chosen["displacement"] != 0.0) == moved]

    def said(part, names):
        return ", ".join(f"({LETTERS[name]}) {score[part, name]:.2f}" for name in names)

    off, on = cells("pointing", adapted, True), cells("pointing", learned)
    wiped = cells("wiping", ("seeking_learned",))
    worst = max(score["wiping", name] for name in adapted)
    rows = [
        ("(b) presses the button better than (a)",
         score["pressing", "seeking_learned"] > score["pressing", "neutral_learned"], said("pressing", learned)),
        ("(c) and (d) press it better than (a)",
         min(score["pressing", name] for name in adapted) > score["pressing", "neutral_learned"],
         said("pressing", (learned[0], *adapted))),
        ("(c) and (d) point beside the place when the button was displaced", bool((off["success"] == 0).all()),
         f"{off['success'].sum()} of {off['of'].sum()} point within 5 mm"),
        ("(a) and (b) do not", bool((on["success"] == on["of"]).all()),
         f"{on['success'].sum()} of {on['of'].sum()} point within 5 mm"),
        ("(b) erases the text in all conditions", bool((wiped["success"] == wiped["of"]).all()),
         "; ".join(f"{100 * row.displacement:+.0f} cm {row.success} of {row.of}" for row in wiped.itertuples())),
        ("(b) erases it better than (a)",
         score["wiping", "seeking_learned"] > score["wiping", "neutral_learned"], said("wiping", learned)),
        ("(c) and (d) erase it worse than (b)", worst < score["wiping", "seeking_learned"],
         said("wiping", ("seeking_learned", *adapted))),
    ]  # fmt: skip
    return [(statement, bool(shown), evidence) for statement, shown, evidence in rows]


def count_rows(counted: pd.DataFrame) -> tuple:
    """Table 5.3: successes / partial successes / failures."""
    names = [name for name in LETTERS if name in set(counted["controller"])]
    header = ["Part", "Displacement", *[f"({LETTERS[name]}) {name}" for name in names]]
    rows = []
    for (part, displacement), cell in counted.groupby(["part", "displacement"], sort=False):
        by = cell.set_index("controller")
        cells = []
        for name in names:
            row = by.loc[name]
            mark = " limited" if row["limited"] > LIMITED else ""
            cells.append(f"{row['success']} / {row['partial']} / {row['failure']}{mark}")
        rows.append([part, f"{100 * displacement:+.0f} cm", *cells])
    return header, rows


def measure_rows(table: pd.DataFrame) -> tuple:
    """Medians over the repetitions of what the verdicts rest on."""
    header = ["Task", "Displacement", "Controller", "Travel [mm]", "Pointing error [mm]", "Wiped [%]",
              "Peak contact force [N]", "Limited [%]"]  # fmt: skip
    rows = []
    for (task, displacement, controller), cell in table.groupby(["task", "displacement", "controller"], sort=False):
        middle = cell[["deepest", "pointing_error", "wiped", "peak_force", "limited"]].median()
        button = task == "button"
        rows.append([task, f"{100 * displacement:+.0f} cm", f"({LETTERS[controller]}) {controller}",
                     f"{1e3 * middle['deepest']:.1f}" if button else "–",
                     f"{1e3 * middle['pointing_error']:.1f}" if button else "–",
                     "–" if button else f"{100 * middle['wiped']:.0f}",
                     f"{middle['peak_force']:.0f}", f"{100 * middle['limited']:.1f}"])  # fmt: skip
    return header, rows


def claim_rows(found: list) -> tuple:
    return ["Statement of the thesis", "Here", ""], [
        [statement, evidence, "holds" if shown else "MISS"] for statement, shown, evidence in found
    ]


def legend_below(fig, handles, labels) -> None:
    """One legend for all panels, in a strip of its own below them."""
    height = 0.35 / fig.get_figheight()
    fig.get_layout_engine().set(rect=(0, height, 1, 1 - height))
    fig.legend(handles, labels, loc="lower center", ncols=len(labels)).set_in_layout(False)


@styled
def picture(counted: pd.DataFrame):
    """Table 5.3 as bars: one panel per part and condition, one bar per controller."""
    groups = list(counted.groupby(["part", "displacement"], sort=False))
    lines = -(-len(groups) // 3)
    fig = figure(7.4, 1.5 * lines + 0.6)
    panels = fig.subplots(lines, 3, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat[len(groups):]:
        axes.set_axis_off()
    for axes, ((part, displacement), cell) in zip(panels.flat, groups):
        letters = [f"({LETTERS[name]})" for name in cell["controller"]]
        bottom = pd.Series(0.0, index=cell.index)
        for verdict in VERDICTS:
            share = cell[verdict] / cell["of"]
            axes.bar(letters, share, bottom=bottom, color=COLOURS[verdict], label=verdict, width=0.7)
            bottom = bottom + share
        axes.set_title(f"{part}, {100 * displacement:+.0f} cm")
    for row in panels:
        row[0].set_ylabel("share")
    legend_below(fig, *panels[0, 0].get_legend_handles_labels())
    return fig


def setting(tasks=TASKS) -> dict:
    """What the record of a study or a page says about the tasks."""
    return {
        name: {"displacements": list(task.displacements), "controllers": list(task.controllers),
               "demonstrations": task.demonstrations, "states": task.states, "seed": task.seed, "seeking": task.seeking}
        for name, task in ((name, load(name)) for name in tasks)
    }  # fmt: skip


def run(options) -> list:
    table = measure(options.people, options.jobs, options.progress)
    counted = counts(table)
    found = claims(counted)
    _page.write_csv(table, options.out / "table.csv")
    _page.write_csv(counted, options.out / "counts.csv")
    seeds = int(table["seed"].nunique())
    _page.write_record(options.out, "contact", {"simulated_demonstrations": True, "repetitions": seeds, **setting()})
    repeated = table.drop_duplicates(["task", "seed"])["repeated_demonstrations"].sum()
    sections = [
        _page.Section("Table 5.3", *count_rows(counted),
                      note=f"Successes / partial successes / failures in {seeds} repetitions. limited: the safety "
                           "layer took from the assistance in more than 5 % of the time.",
                      figure=picture(counted), name="contact"),
        _page.Section("What the thesis says", *claim_rows(found),
                      note="The symbols of its table are lost in the text that we have; these are its words. A success "
                           "counts 1, a partial one 1/2."),
        _page.Section("Medians", *measure_rows(table)),
    ]  # fmt: skip
    path = _page.write_page(options.out, TITLE, __doc__.partition("\n\n")[2], sections, simulated=True)
    return [
        _page.aligned(*count_rows(counted)), "", _page.aligned(*measure_rows(table)), "",
        _page.aligned(*claim_rows(found)), f"{repeated} demonstrations failed and were done again.", "",
        f"table:  {options.out / 'table.csv'}", f"report: {path}",
    ]  # fmt: skip
