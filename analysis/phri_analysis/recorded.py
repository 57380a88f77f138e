"""Many bags into one study, several at once: reading a bag is the slow part of a report."""

import multiprocessing
import os
from concurrent import futures
from pathlib import Path

import yaml
from tqdm import tqdm

from . import bags
from .errors import AnalysisError, DataError
from .study import Study


def read_study(files: list, jobs: int = 0, skip_bad: bool = False, progress: bool = False) -> Study:
    """The study of the trials in `files`, in their order whatever `jobs` (0: all cores). A bag that cannot be read ends
    it, or with `skip_bad` is noted in `skipped`. Raises DataError."""
    jobs = min(jobs or os.cpu_count() or 1, len(files))
    kept = Study()
    with tqdm(total=len(files), unit="bag", desc="reading", disable=not progress) as bar:
        for part in _parts(files, jobs):
            if part.skipped and not skip_bad:
                raise DataError(part.skipped[0][1])
            kept.merge(part)
            bar.update()
    if not kept.rows:
        raise DataError(f"none of the {len(files)} bags could be read")
    return kept


def _parts(files, jobs):
    if jobs <= 1:
        yield from map(read_one, files)
        return
    # spawn: a forked child of a process that holds C++ threads may deadlock
    context = multiprocessing.get_context("spawn")
    with futures.ProcessPoolExecutor(jobs, mp_context=context) as pool:
        try:
            yield from pool.map(read_one, files)
        except futures.BrokenExecutor:
            raise AnalysisError("a reading process died; was it short of memory? try --jobs 1") from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def ratings(files: list) -> list:
    """(controller, ratings 1 to 6 in order) of the sessions that the bags lie in, by their session.yaml; people's
    own, of trials that need not have been recorded. Trials that were changed while they ran rate no controller: their
    ratings stand apart, under "changed"."""
    given = {}
    for folder in sorted({Path(path).parent for path in files}):
        try:
            session = yaml.safe_load((folder / "session.yaml").read_text())
        except (OSError, yaml.YAMLError):
            continue
        entries = session.get("ratings") if isinstance(session, dict) else None
        for entry in entries or ():
            controller = "changed" if entry.get("changed") else str(entry.get("controller"))
            given.setdefault(controller, []).append(entry.get("rating"))
    return sorted(given.items())


def read_one(path: Path) -> Study:
    """The study of one bag; an unreadable one is in `skipped`. Runs in a worker."""
    kept = Study()
    try:
        kept.add(bags.read_trial(path))
        kept.sources.append((path.name, bags.checksum(path)))
    except DataError as error:
        kept.skipped.append((path.name, str(error)))
    return kept
