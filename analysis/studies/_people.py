"""Simulated participants alone at the maze, condition (a): their parameters and what they do, over many populations.

Everything random belongs to (seed, person, trial), so two populations that differ in one parameter are met by the same
draws, obstacles and noise: differences are paired.
"""

import functools
import importlib
import multiprocessing
from concurrent import futures

import pandas as pd
from tqdm import tqdm

from phri_analysis import metrics, trial_table
from phri_analysis.errors import AnalysisError, DataError, MissingInputError

EXPERIMENT = "maze_assistance"
TRIAL = 3  # the evaluated one of the thesis; under (a) nobody learns, but the person has practised twice


def simulation():
    """The C++ library."""
    try:
        return importlib.import_module("phri_sim")
    except ImportError as error:
        raise MissingInputError(
            f"module phri_sim is missing ({error}); build the workspace and source scripts/env.sh"
        ) from None


@functools.lru_cache(maxsize=2)
def experiment(settings: tuple = ()):
    """The experiment with condition (a) only, so that practice does not depend on which others there are. `settings`:
    pairs (key, value); `<parameter>/median`, `<parameter>/spread` of the population."""
    overrides = {f"override/participants/{key}": value for key, value in settings}
    try:
        return simulation().Experiment(EXPERIMENT, {"controllers": ["none"], **overrides})
    except (ValueError, RuntimeError) as error:
        raise DataError(" ".join(str(error).split())) from None


def parameters(seeds, people: int, settings: tuple = ()) -> pd.DataFrame:
    """Who they are: one row per person, index (seed, participant), one column per parameter."""
    loaded = experiment(settings)
    keys = [trait.key for trait in loaded.traits]
    rows = {
        (seed, index): [getattr(loaded.person(seed, index), key) for key in keys]
        for seed in seeds
        for index in range(people)
    }
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=keys)
    frame.index = pd.MultiIndex.from_tuples(rows, names=["seed", "participant"])
    return frame


def measures(seeds, people: int, settings: tuple = (), trial: int = TRIAL) -> pd.DataFrame:
    """What they do in trial number `trial`: one row per person and subtask, index (subtask, seed, participant)."""
    sim, loaded = simulation(), experiment(settings)
    rows = []
    for seed in seeds:
        for index in range(people):
            spec = sim.TrialSpec(index, "none", trial, max(trial, TRIAL), trial - 1, seed)
            table = trial_table.conform(sim.run_alone(loaded, spec))
            for row in metrics.evaluate(table):
                rows.append(
                    {"seed": seed, "participant": index, "completed": bool(table.attrs["completed"]), **row}
                )
    return pd.DataFrame(rows).set_index(["subtask", "seed", "participant"]).sort_index()


def _call(task):
    function, arguments = task
    return function(*arguments)


def spread(function, calls, jobs: int = 1, progress: bool = False, text: str = "") -> list:
    """[function(*arguments) for arguments in calls], in `jobs` processes; in order, whatever finishes first."""
    tasks = [(function, arguments) for arguments in calls]
    if jobs == 1:
        return [_call(task) for task in tqdm(tasks, desc=text, disable=not progress)]
    # spawn: a forked child of a process that holds C++ threads may deadlock
    context = multiprocessing.get_context("spawn")
    with futures.ProcessPoolExecutor(jobs, mp_context=context) as pool:
        try:
            return list(tqdm(pool.map(_call, tasks), total=len(tasks), desc=text, disable=not progress))
        except futures.BrokenExecutor:
            raise AnalysisError("a worker process died; was it short of memory? try fewer --jobs") from None
