"""Runs an experiment in lockstep without ROS, spread over processes or machines; every number comes from C++.

`phri_sim` plans the runs: `Experiment(name_or_path)`, `schedule(experiment, participants, trials, seed)` -> blocks,
each the trials of one participant under one controller in order (the model learns between them) with fields
participant, controller, seed; 0 participants or trials mean the experiment's own number; `run_block(experiment, block)`
-> their trial tables. A block is the unit of work: it depends on nothing but its own fields, so the table of a study is
the same to the byte for any number of processes or machines.

A worker gets the request and the index of a block and plans again: a plan is cheap, and C++ objects do not travel.
"""

import contextlib
import functools
import importlib
import multiprocessing
import subprocess
import time
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path

import yaml
from tqdm import tqdm

from .errors import AnalysisError, ConfigurationError, DataError, MissingInputError, UsageError
from .study import Study


@dataclass(frozen=True)
class Request:
    """What to run; None leaves a number to the experiment's own file. `controllers` empty: all of the experiment.
    `settings`: pairs of a parameter's key and its value, instead of what the experiment's files say."""

    experiment: str
    participants: int | None = None
    trials: int | None = None
    controllers: tuple = ()
    seed: int | None = None
    settings: tuple = ()


def simulate(request: Request, jobs: int = 1, scheduler: str = "", progress: bool = True) -> Study:
    """Runs all blocks of a request: in this process (jobs = 1), in `jobs` processes, or on the workers of a Dask
    scheduler (which need this package and phri_sim installed). Raises UsageError, MissingInputError, DataError."""
    if jobs < 1:
        raise UsageError(f"jobs is {jobs}, expected 1 or more")
    indices = _chosen(request)
    kept = Study()
    with contextlib.closing(_results(request, indices, jobs, scheduler)) as results, tqdm(
        total=len(indices), unit="block", desc=request.experiment, disable=not progress
    ) as bar:
        for part in results:
            kept.merge(part)
            bar.update()
    return kept


def setting(text: str) -> tuple:
    """'key=value' as (key, value): a number, true, false, a [list] or a text, as in YAML."""
    key, separator, value = text.partition("=")
    if not separator or not key:
        raise UsageError(f"setting {text!r}, expected KEY=VALUE")
    try:
        parsed = yaml.safe_load(value)
    except yaml.YAMLError:
        raise UsageError(f"setting {text!r}: expected a number, true, false, a [list] or a text as value") from None
    try:
        if isinstance(parsed, list):
            return key, tuple(parsed)  # hashable: plans are kept by their request
        return key, parsed if isinstance(parsed, bool) else float(parsed)
    except (TypeError, ValueError):
        return key, value


@functools.lru_cache(maxsize=1)
def plan(request: Request):
    """(phri_sim, experiment, blocks) of a request; kept, for a worker runs many blocks of one request."""
    for name in ("participants", "trials"):
        value = getattr(request, name)
        if value is not None and value < 1:
            raise UsageError(f"{name} is {value}, expected 1 or more")
    if request.seed is not None and not 0 <= request.seed < 2**63:
        raise UsageError(f"seed is {request.seed}, expected 0 to 2^63 - 1")
    try:
        phri_sim = importlib.import_module("phri_sim")
    except ImportError as error:
        raise MissingInputError(
            f"module phri_sim is missing ({error}); build the workspace (make demo does) and source its "
            "devel/setup.bash"
        ) from None
    try:
        experiment = phri_sim.Experiment(request.experiment, dict(request.settings))
        seed = experiment.seed if request.seed is None else request.seed
        blocks = phri_sim.schedule(experiment, request.participants or 0, request.trials or 0, seed)
    except (ValueError, RuntimeError) as error:
        text = _one_line(error)
        wrong_keys = type(error).__name__ == "ParameterError"  # of phri_core, which may be on another machine only
        kind = MissingInputError if "no such file" in text else ConfigurationError if wrong_keys else DataError
        raise kind(text if request.experiment in text else f"experiment {request.experiment}: {text}") from None
    return phri_sim, experiment, blocks


def run(request: Request, index: int) -> Study:
    """The study of one block; runs in a worker."""
    phri_sim, experiment, blocks = plan(request)
    block = blocks[index]
    kept = Study()
    try:
        start = time.perf_counter()
        trials = phri_sim.run_block(experiment, block)
        wall = time.perf_counter() - start
        for trial in trials:
            kept.add(trial)
        kept.speed.append((sum(trial["t"].iloc[-1] for trial in trials), wall))
    except (ValueError, RuntimeError) as error:
        raise AnalysisError(
            f"participant {block.participant}, controller {block.controller}, seed {block.seed}: {_one_line(error)}"
        ) from None
    if block.participant != min(other.participant for other in blocks):
        kept.examples.clear()  # megabytes each, and only the first participant is shown
    return kept


def git_revision() -> str:
    """Revision of the sources that this package stands in, "-dirty" when changed; empty outside a git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def _one_line(error) -> str:
    return "; ".join(line.strip() for line in str(error).splitlines() if line.strip())


def _chosen(request):
    blocks = plan(request)[2]
    there = list(dict.fromkeys(block.controller for block in blocks))
    unknown = [name for name in request.controllers if name not in there]
    if unknown:
        raise UsageError(
            f"controller {', '.join(unknown)} is not in experiment {request.experiment}; it has {', '.join(there)}"
        )
    return [i for i, block in enumerate(blocks) if not request.controllers or block.controller in request.controllers]


def _results(request, indices, jobs, scheduler):
    """Yields the Study of each block as it finishes, in no certain order."""
    if scheduler:
        yield from _on_cluster(request, indices, scheduler)
    elif jobs == 1:
        for index in indices:
            yield run(request, index)
    else:
        # spawn: a forked child of a process that holds C++ threads may deadlock.
        context = multiprocessing.get_context("spawn")
        with futures.ProcessPoolExecutor(min(jobs, len(indices)), mp_context=context) as pool:
            tasks = [pool.submit(run, request, index) for index in indices]
            try:
                for task in futures.as_completed(tasks):
                    yield task.result()
            except futures.BrokenExecutor:
                raise AnalysisError("a worker process died; was it short of memory? try fewer --jobs") from None
            finally:
                pool.shutdown(wait=False, cancel_futures=True)


def _on_cluster(request, indices, scheduler):
    try:
        from dask import distributed
    except ImportError:
        raise MissingInputError("--scheduler needs the package distributed (Debian: python3-distributed)") from None
    try:
        client = distributed.Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise MissingInputError(f"scheduler {scheduler}: no answer ({_one_line(error)})") from None
    with client:
        tasks = [client.submit(run, request, index, pure=False) for index in indices]
        for task in distributed.as_completed(tasks):
            yield task.result()
