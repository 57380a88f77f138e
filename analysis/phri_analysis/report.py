"""The report of a study: one HTML file with everything inside, the same table for the terminal, and the pictures as
files.
"""

import base64
import io
import os
from pathlib import Path

import jinja2

from . import lateness, metrics, plots, style, study, study_plots
from .errors import OutputError

TEMPLATES = Path(__file__).parent / "templates"
SETTING = (("experiment", "Experiment"), ("scene", "Scene"), ("seed", "Seeds"), ("git_revision", "Software revision"))
SUBTASK_TITLES = {"whole": "Whole task", "MO": "Subtask MO, moving obstacle", "NC": "Subtask NC, narrow channel"}
LISTED = 6  # more values of one setting are summed up


def write_report(kept: study.Study, out, title: str = "", notes=()) -> Path:
    """Writes table.csv, report.html and figures/*.png into the folder `out`; returns the path of report.html. `notes`
    are (name, value) pairs for the setting table, such as a command line. Raises OutputError."""
    out = Path(out)
    table = kept.table()
    pictures = figures(kept, table)
    study.write_table(table, out / "table.csv")
    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
        encoded = []
        for name, caption, figure in pictures:
            png = _png(figure)
            (out / "figures" / f"{name}.png").write_bytes(png)
            encoded.append({"name": name, "caption": caption, "data": base64.b64encode(png).decode("ascii")})
        path = out / "report.html"
        path.write_text(_html(kept, table, encoded, title, notes), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{error.filename or out}: cannot write the report: {os.strerror(error.errno)}") from None
    return path


def figures(kept: study.Study, table) -> list:
    """(file name, caption, Figure) of every picture of the report."""
    result = [
        ("maze", "Trajectories of the evaluated trials in the scene.", plots.maze_figure(kept.shown_tracks())),
        (
            "measures",
            "Measures over the whole task: mean over participants ± standard error; thin lines and points are "
            "the participants.",
            study_plots.measures_figure(table),
        ),
    ]
    if (table["subtask"] == "MO").any():
        result.append(
            (
                "subtasks",
                "Measures by subtask (MO moving obstacle, NC narrow channel): mean over participants ± "
                "standard error.",
                study_plots.subtasks_figure(table),
            )
        )
    if any(name.startswith("limited_") for name in table.columns):
        result.append(
            ("limits", "Share of time at each limit, mean over participants.", study_plots.limits_figure(table))
        )
    for trial in kept.shown_examples():
        name = trial.attrs["controller"]
        result.append(
            (
                f"prediction_{name}",
                f"Predictions under {style.label(name)}: every position foreseen, some of the 95 % "
                "ellipses, and the error along time.",
                plots.prediction_figure(trial),
            )
        )
    for trial in kept.shown_examples():
        name = trial.attrs["controller"]
        result.append((f"trial_{name}", f"One trial under {style.label(name)} along time.", plots.trial_figure(trial)))
    if kept.lateness:
        caption = f"Lateness of the ticks of {len(kept.lateness)} real-time trials; a slipped tick is not made up for."
        result.append(("lateness", caption, lateness.lateness_figure(lateness.summary(kept.lateness))))
    return result


def terminal_table(table, subtask: str = "whole") -> str:
    """Measures (rows) by controllers (columns), mean ± SD over participants, aligned for a terminal."""
    header, rows = _controller_rows(table, subtask)
    lines = [[SUBTASK_TITLES[subtask], *[head["text"] for head in header]]]
    lines += [[row["heading"], *row["values"]] for row in rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]

    def show(line):
        return "  ".join([line[0].ljust(widths[0]), *[cell.rjust(width) for cell, width in zip(line[1:], widths[1:])]])

    return "\n".join([show(lines[0]), "  ".join("-" * width for width in widths), *map(show, lines[1:])])


def _controller_rows(table, subtask):
    known = metrics.all_measures(table.columns)
    summary = study.per_controller(table, subtask)
    marked = {name: frame.loc["limited_assistance", "mean"] > metrics.LIMITED_SHARE for name, frame in summary.items()}
    header = [
        {
            "text": style.label(name) + (" limited" if marked[name] else ""),
            "colour": style.colour(name),
            "label": style.label(name),
            "limited": bool(marked[name]),
        }
        for name in summary
    ]
    trials = study.judged(table)
    trials = trials[trials["subtask"] == subtask].groupby("controller")["completed"].agg(["sum", "count"])
    rows = []
    if subtask == "whole":
        counts = [f"{trials.loc[name, 'sum']} of {trials.loc[name, 'count']}" for name in summary]
        rows.append({"heading": "Completed trials", "values": counts})
    for name, entry in known.items():
        shown = name in table.columns and table[name].notna().any()
        if shown and (subtask == "whole" or name in metrics.MEASURES):
            means, deviations = ([frame.loc[name, key] for frame in summary.values()] for key in ("mean", "sd"))
            rows.append({"heading": entry.heading, "values": style.row_of_means(means, deviations, entry.unit)})
    return header, rows


def _participant_tables(table):
    """Per controller and participant: the measures, and the share of time at each limit."""
    known = metrics.all_measures(table.columns)
    means = study.per_participant(table, "whole")
    limits = [name for name in means.columns if name.startswith("limited_")]
    tables = []
    for title, names, heading in (
        ("Measures", [name for name in metrics.HEADLINE if name in means.columns], lambda name: known[name].heading),
        ("Share of time at each limit [%]", limits, lambda name: name.removeprefix("limited_").replace("_", " ")),
    ):
        rows = [
            {
                "controller": style.label(controller),
                "participant": participant,
                "limited": bool(row["limited"]),
                "values": [style.number(row[name], known[name].unit) for name in names],
            }
            for (controller, participant), row in means.iterrows()
        ]
        if names:
            tables.append({"title": title, "header": [heading(name) for name in names], "rows": rows})
    return tables


def _setting(kept, table, notes):
    rows = []
    for key, text in SETTING:
        values = sorted({setting[key] for setting in kept.settings if setting.get(key) not in (None, "")}, key=str)
        if values:
            rows.append(
                (
                    text,
                    (
                        ", ".join(map(str, values))
                        if len(values) <= LISTED
                        else f"{len(values)} values, {values[0]} to {values[-1]}"
                    ),
                )
            )
    whole = table[table["subtask"] == "whole"]
    judged = study.judged(whole)
    rows += [
        ("Participants", f"{whole['participant'].nunique()}"),
        ("Controllers", ", ".join(map(style.label, whole["controller"].unique()))),
        ("Trials", f"{len(whole)}, of which {len(judged)} are evaluated and shown below"),
        (
            "Not completed",
            f"{int((~whole['completed']).sum())} trials (no completion time; other measures up to their end)",
        ),
    ]
    dropped = sum(setting.get("dropped_ticks", 0) for setting in kept.settings)
    if dropped:
        rows.append(("Ticks lost in recording", str(dropped)))
    for setting in kept.settings:
        changes = [f"{change['what']} at {change['t']:.2f} s" for change in setting.get("changes") or ()]
        if changes:
            trial = f"participant {setting['participant']}, {setting['controller']}, trial {setting['trial']}"
            rows.append((f"Changed during {trial}", "; ".join(changes) + " (speaks for no controller)"))
    recovered = sum(setting.get("recovered", False) for setting in kept.settings)
    if recovered:
        rows.append(("Recovered recordings", f"{recovered} trials are cut off or have gaps"))
    if kept.lateness:
        rows.append(("Lateness of the ticks, real time", lateness.summary(kept.lateness).line()))
    return rows + [(name, str(value)) for name, value in notes]


def _simulated(settings):
    """True, False, or None where the trials do not say or do not agree."""
    answers = {bool(setting.get("simulated_participants")) for setting in settings}
    return answers.pop() if len(answers) == 1 else None


def _html(kept, table, pictures, title, notes):
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    subtasks = []
    for name in metrics.SUBTASKS:
        if (table["subtask"] == name).any():
            header, rows = _controller_rows(table, name)
            subtasks.append({"title": SUBTASK_TITLES[name], "header": header, "rows": rows})
    definitions = [entry for name, entry in metrics.all_measures(table.columns).items() if name in table.columns]
    experiment = next((setting["experiment"] for setting in kept.settings if setting.get("experiment")), "trials")
    return environment.get_template("report.html.j2").render(
        title=title or f"Report of {experiment}",
        simulated=_simulated(kept.settings),
        setting=_setting(kept, table, notes),
        subtasks=subtasks,
        participants=_participant_tables(table),
        pictures=pictures,
        definitions=definitions,
        unit=style.shown_unit,
        sources=kept.sources,
        skipped=kept.skipped,
        any_limited=bool(study.judged(table)["limited"].any()),
        limited_share=f"{100 * metrics.LIMITED_SHARE:.0f} %",
    )


def _png(figure) -> bytes:
    """PNG without the version and date that matplotlib would put in, so that equal pictures are equal files."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return buffer.getvalue()
