"""What a page leaves behind: results/figures/<id>/{data.csv, figure.png, setting.yaml, <table>.csv} and the index.

setting.yaml also holds what the page says in words, so that the index is made anew from the folders alone, whichever
figures were made last. A folder is written beside its place and then moved there: it is the old one or the new one.
"""

import base64
import math
import os
import shutil
from pathlib import Path

import jinja2
import numpy as np
import yaml

from phri_analysis import report, simulate, study
from phri_analysis.errors import DataError, OutputError
from studies._page import png

from . import order

SHOWN_ROWS = 40  # of a table in the index; the file has all
INDEX = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title><style>{{ css }}
nav ul, section ul { padding-left: 1.2rem; max-width: 44rem; } nav li, section li { margin: .2rem 0; }
.miss { color: #a3480a; } .verdict { font-weight: 600; }
dl { display: grid; grid-template-columns: max-content auto; gap: .15rem 1rem; font-size: .875rem; margin: .4rem 0; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }</style></head><body><main>
<h1>{{ title }}</h1>
<p>{{ text }}</p>
<nav><ul>{% for page in pages %}<li><a href="#figure-{{ page.id }}">Figure {{ page.id }}</a>: {{ page.title }}\
{% if page.misses %} <span class="miss">({{ page.misses }} of {{ page.findings|length }} statements missed)</span>\
{% endif %}</li>
{% endfor %}</ul></nav>
{% for page in pages %}<section id="figure-{{ page.id }}"><h2>Figure {{ page.id }}: {{ page.title }}</h2>
<h3>In the thesis</h3><p>{{ page.thesis }}</p>
<figure><img alt="Figure {{ page.id }}" src="data:image/png;base64,{{ page.png }}"></figure>
{% if page.findings %}<h3>Findings</h3><ul>
{% for line in page.findings %}<li>{% if line.verdict %}\
<span class="verdict{{ ' miss' if line.verdict == 'MISS' }}">{{ line.verdict }}:</span> {% endif %}{{ line.text }}</li>
{% endfor %}</ul>{% endif %}
{% if page.deviations %}<h3>What differs from the thesis</h3><ul>
{% for line in page.deviations %}<li>{{ line }}</li>{% endfor %}</ul>{% endif %}
{% for table in page.tables %}<h3>{{ table.title }}</h3><div class="wide"><table class="narrow"><thead><tr>\
{% for cell in table.header %}<th>{{ cell }}</th>{% endfor %}</tr></thead><tbody>
{% for row in table.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
{% if table.more %}<p class="note">and {{ table.more }} more rows in the file</p>{% endif %}{% endfor %}
<details><summary>Setting</summary><dl>{% for key, value in page.setting %}<dt>{{ key }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl></details>
<p class="note">Files:{% for file in page.files %} <a href="{{ page.id }}/{{ file }}">{{ file }}</a>{% endfor %}; \
revision {{ page.revision }}</p></section>
{% endfor %}</main></body></html>
"""


def prepare(out) -> None:
    """Makes the folder. Raises OutputError."""
    try:
        Path(out).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{out}: cannot make the folder: {os.strerror(error.errno)}") from None


def write(page, out) -> Path:
    """Writes a page; returns its folder. Raises OutputError, DataError for a page that is not one."""
    folder = Path(out) / page.id
    part = folder.with_name(f".{page.id}.part")
    if page.data.empty:
        raise DataError(f"figure {page.id}: no data")
    reserved = [name for name in page.tables if name == "data" or Path(name).name != name]
    if reserved:
        raise DataError(f"figure {page.id}: a table is called {reserved[0]!r}, expected a file's name other than data")
    record = {
        "figure": page.id,
        "title": page.title,
        "git_revision": simulate.git_revision() or "unknown",
        "thesis": page.thesis,
        "setting": page.setting,
        "deviations": page.deviations,
        "findings": page.findings,
        "tables": list(page.tables),
    }
    text = yaml.safe_dump(_plain(record, f"figure {page.id}"), sort_keys=False, allow_unicode=True, width=120)
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        study.write_table(page.data, part / "data.csv")
        for name, table in page.tables.items():
            study.write_table(table, part / f"{name}.csv")
        (part / "figure.png").write_bytes(png(page.figure))
        (part / "setting.yaml").write_text(text, encoding="utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(part, folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot write: {os.strerror(error.errno)}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return folder


def write_index(out) -> Path:
    """index.html over the figures that stand in `out`. Raises OutputError, DataError for a damaged page."""
    out = Path(out)
    folders = [path.parent for path in out.glob("*/setting.yaml") if not path.parent.name.startswith(".")]
    pages = [_read(folder) for folder in sorted(folders, key=lambda folder: order(folder.name))]
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    text = environment.from_string(INDEX).render(
        title="The thesis, figure by figure",
        text="Figures of chapters 3 to 5, computed anew by the library. A statement of the thesis is "
        "judged by the numbers of the page: it holds, or it is missed.",
        pages=pages,
        css=jinja2.utils.markupsafe.Markup((report.TEMPLATES / "report.css").read_text()),
    )
    part = out / ".index.html.part"
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, out / "index.html")
    except OSError as error:
        raise OutputError(f"{out / 'index.html'}: cannot write: {os.strerror(error.errno)}") from None
    return out / "index.html"


def _read(folder) -> dict:
    """A page as the index shows it, from its files."""
    try:
        page = yaml.safe_load((folder / "setting.yaml").read_text(encoding="utf-8"))
        return {
            "id": page["figure"],
            "title": page["title"],
            "thesis": page["thesis"],
            "deviations": page["deviations"],
            "findings": [_verdict(line) for line in page["findings"]],
            "misses": sum(line.startswith("MISS:") for line in page["findings"]),
            "setting": list(_flat(page["setting"])),
            "revision": page["git_revision"],
            "tables": [_table(name, study.read_table(folder / f"{name}.csv")) for name in page["tables"]],
            "files": ["data.csv", "figure.png", "setting.yaml", *(f"{name}.csv" for name in page["tables"])],
            "png": base64.b64encode((folder / "figure.png").read_bytes()).decode("ascii"),
        }
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OSError) as error:
        words = " ".join(str(error).split())
        raise DataError(f"{folder}: not a page of a figure ({words}); delete the folder or make it again") from None


def _verdict(line):
    verdict, mark, text = line.partition(": ")
    known = mark and verdict in ("holds", "MISS")
    return {"verdict": verdict, "text": text} if known else {"verdict": "", "text": line}


def _flat(value, key=""):
    """(key, text) of every entry, with dots for what lies inside."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list) and any(isinstance(inner, (dict, list)) for inner in value):
        for i, inner in enumerate(value):
            yield from _flat(inner, f"{key}[{i}]")
    else:
        yield key, ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _table(name, table):
    rows = [[_cell(value) for value in row] for row in table.head(SHOWN_ROWS).itertuples(index=False, name=None)]
    header = [str(column).replace("_", " ") for column in table.columns]
    words = name.replace("_", " ")
    return {"title": words[:1].upper() + words[1:], "header": header, "rows": rows,
            "more": max(0, len(table) - SHOWN_ROWS)}


def _cell(value):
    if isinstance(value, (float, np.floating)):
        return "–" if math.isnan(value) else f"{value:.6g}"
    return {True: "yes", False: "no"}[bool(value)] if isinstance(value, (bool, np.bool_)) else str(value)


def _plain(value, where):
    """The same of Python's own numbers, texts, lists and dicts. Raises DataError for anything else."""
    if isinstance(value, dict):
        return {str(key): _plain(inner, f"{where}: {key}") for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(inner, where) for inner in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise DataError(f"{where}: {type(value).__name__} cannot be written, expected numbers, texts, lists and dicts")
