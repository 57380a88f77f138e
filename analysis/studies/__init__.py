"""Evaluations: one module per evaluation, started by `phri-analysis study NAME`.

A study is a module of this package whose name does not begin with an underscore. Its docstring's first line says what
it evaluates; `run(options)` writes its files into `options.out` and returns the lines to print. Every study leaves
table.csv, report.html and session.yaml; numbers come from the C++ library, people are simulated participants or
recorded ones, and the report says which.
"""

import importlib
import pkgutil
from dataclasses import dataclass
from pathlib import Path

from phri_analysis.errors import UsageError


@dataclass(frozen=True)
class Options:
    """`people`: None is the study's own number, fewer are a quick look; `progress`: show a bar; `data`: of the user's,
    for a study with `TAKES_DATA = True`."""

    out: Path
    jobs: int = 1
    people: int | None = None
    progress: bool = False
    data: Path | None = None


def names() -> list:
    return sorted(entry.name for entry in pkgutil.iter_modules(__path__) if not entry.name.startswith("_"))


def load(name: str):
    """The module of a study; UsageError where there is none of that name."""
    if name not in names():
        raise UsageError(f"study {name!r} is unknown; known: {', '.join(names())}")
    return importlib.import_module(f"{__name__}.{name}")


def run(name: str, options: Options) -> list:
    """Runs a study; raises UsageError for options that make no sense."""
    if options.jobs < 1:
        raise UsageError(f"jobs is {options.jobs}, expected 1 or more")
    if options.people is not None and options.people < 2:
        raise UsageError(f"people is {options.people}, expected 2 or more: spreads and errors need them")
    module = load(name)
    if options.data is not None and not getattr(module, "TAKES_DATA", False):
        raise UsageError(f"study {name} takes no data, --data is {options.data}")
    return module.run(options)
