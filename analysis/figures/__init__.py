"""Figures of the thesis, computed anew: one module per group of figures, started by `phri-analysis figures [ID...]`.

A public module of this package (its name does not begin with an underscore) has `IDS`, a tuple of the figures that it
makes ("4.5"), and `page(id, options) -> Page`. Numbers come from the C++ library. A page says what the thesis shows,
what our setting is, what differs and why, and which statements of the thesis our numbers confirm and which they miss.
"""

import importlib
import pkgutil
from dataclasses import dataclass, field

import pandas as pd
from matplotlib.figure import Figure

from phri_analysis.errors import MissingInputError, UsageError


@dataclass(frozen=True)
class Options:
    """`rollouts`: simulated runs of every policy, fewer are a quick look; `jobs`: processes on this machine."""

    rollouts: int = 10000
    jobs: int = 1


@dataclass(frozen=True)
class Page:
    """One figure. Its files are data.csv, figure.png, setting.yaml and a CSV file per table."""

    id: str  # "4.5"
    title: str
    thesis: str  # what the thesis reports, in our words
    setting: dict  # of plain numbers, texts and lists
    deviations: tuple  # what differs from the thesis and why, a sentence each
    data: pd.DataFrame  # the quantity of every panel
    figure: Figure
    findings: tuple = ()  # one line each, printed and shown: agreement and misses
    tables: dict = field(default_factory=dict)  # name -> DataFrame


def finding(holds: bool, statement: str, evidence: str) -> str:
    """The line of a page for a statement of the thesis: `holds` is computed from the data, `evidence` its numbers."""
    return f"{'holds' if holds else 'MISS'}: {statement} ({evidence})"


def modules() -> dict:
    """Figure id -> module, in the order of the thesis. Raises MissingInputError where the library is not built."""
    found = {}
    for entry in pkgutil.iter_modules(__path__):
        if entry.name.startswith("_"):
            continue
        try:
            module = importlib.import_module(f"{__name__}.{entry.name}")
        except ModuleNotFoundError as error:
            raise MissingInputError(f"module {error.name} is missing: make build, then source scripts/env.sh") from None
        found |= {name: module for name in module.IDS}
    return dict(sorted(found.items(), key=lambda item: order(item[0])))


def order(name: str) -> tuple:
    """Sort key: figure 4.10 comes after 4.9."""
    return tuple(int(part) for part in name.split("."))


def selected(wanted) -> dict:
    """The modules of the figures `wanted`, all for none, each once; UsageError for those that are not there."""
    known = modules()
    unknown = [name for name in wanted if name not in known]
    if unknown:
        raise UsageError(f"figure {', '.join(map(repr, unknown))} is unknown; known: {', '.join(known)}")
    return {name: module for name, module in known.items() if not wanted or name in wanted}


def run(wanted, options: Options, out, say=print) -> None:
    """Makes the figures `wanted`, all for none, in the folder `out`, one after the other, and says for each what was
    found; then the index over all that stand there."""
    from . import _page

    if options.jobs < 1:
        raise UsageError(f"jobs is {options.jobs}, expected 1 or more")
    if options.rollouts < 2:
        raise UsageError(f"rollouts is {options.rollouts}, expected 2 or more: spreads need them")
    wanted = selected(wanted)
    _page.prepare(out)  # rather now than after minutes of work
    for name, module in wanted.items():
        page = module.page(name, options)
        folder = _page.write(page, out)
        say(f"figure {name}: {page.title}")
        for line in page.findings:
            say(f"  {line}")
        say(f"  {folder}")
    say(f"index: {_page.write_index(out)}")
