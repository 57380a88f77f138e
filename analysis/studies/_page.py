"""What studies write: CSV tables, session.yaml, and report.html with everything inside."""

import base64
import io
import os
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
import pandas as pd
import yaml

from phri_analysis import report, simulate, study
from phri_analysis.errors import OutputError

PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title><style>{{ css }}</style></head><body><main>
<h1>{{ title }}</h1>
{% if simulated %}<p class="banner"><strong>The participants are simulated.</strong> No person took part: the numbers
come from a model of a human partner.</p>{% endif %}

{% for paragraph in text.split("\n\n") %}<p>{{ paragraph }}</p>
{% endfor %}
{% for part in sections %}<h2>{{ part.title }}</h2>
{% if part.note %}<p class="note">{{ part.note }}</p>{% endif %}
{% if part.png %}<figure><img alt="{{ part.title }}" src="data:image/png;base64,{{ part.png }}"></figure>{% endif %}
<div class="wide"><table><thead><tr>{% for cell in part.header %}<th>{{ cell }}</th>{% endfor %}</tr></thead><tbody>
{% for row in part.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
{% endfor %}</main></body></html>
"""


@dataclass
class Section:
    title: str
    header: list
    rows: list
    note: str = ""
    figure: object = None
    name: str = ""  # of the figure's file
    png: str = field(default="", init=False)


def write_csv(table: pd.DataFrame, path) -> None:
    study.write_table(table, path)


def write_session(out, name: str, setting: dict) -> None:
    """What made the numbers: study, revision, setting and the population's file as it was."""
    from . import _people

    traits = {
        trait.key: {"median": trait.median, "spread": trait.spread, "limits": [trait.low, trait.high]}
        for trait in _people.experiment().traits
    }
    write_record(out, name, {"simulated_participants": True, **setting, "population": traits})


def write_record(out, name: str, setting: dict) -> None:
    """session.yaml of a study without simulated participants."""
    record = {"study": name, "git_revision": simulate.git_revision() or "unknown", **setting}
    write_file(Path(out) / "session.yaml", yaml.safe_dump(record, sort_keys=False).encode())


def png(figure, dpi: int = 150) -> bytes:
    """Without version and date of matplotlib: equal pictures are equal files."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def write_page(out, title: str, text: str, sections: list, simulated: bool = True) -> Path:
    """report.html; `simulated`: with the banner that no person took part."""
    out = Path(out)
    for section in sections:
        if section.figure is not None:
            picture = png(section.figure)
            write_file(out / "figures" / f"{section.name}.png", picture)
            section.png = base64.b64encode(picture).decode("ascii")
        section.rows = [[_plain(cell) for cell in row] for row in section.rows]
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    css = jinja2.utils.markupsafe.Markup((report.TEMPLATES / "report.css").read_text())
    page = environment.from_string(PAGE).render(title=title, text=text, sections=sections, css=css, simulated=simulated)
    write_file(out / "report.html", page.encode())
    return out / "report.html"


def _plain(cell: str) -> str:
    """Text of a Markdown cell."""
    return cell.replace("**", "").replace("`", "")


def aligned(header: list, rows: list) -> str:
    """The table for a terminal."""
    lines = [[_plain(cell) for cell in line] for line in [header, *rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    lines.insert(1, ["-" * width for width in widths])
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def markdown(header: list, rows: list) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def write_file(path, data: bytes) -> None:
    """With its folder; OutputError where that cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {os.strerror(error.errno)}") from None
