"""What is still good in a bag, and how to get it out: `phri-analysis check` and `phri-analysis recover`."""

import bisect
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .bag_digest import INTACT, MISSING, TOPIC, Digest, Verifier, seconds
from .bag_files import MAGIC, BagFile
from .bag_output import BagWriter
from .errors import BagError, MissingInputError, OutputError, UsageError

_DIGEST_PERIOD = 500_000_000  # [ns] in recovered bags, as in recorded ones


@dataclass
class Finding:
    """A bag read from end to end. `damages`: what is wrong with the file, and where, as texts; with what the digests
    say these are the `problems`. None: as it was recorded, as far as can be told."""

    path: Path
    messages: list
    verifier: Verifier
    damages: list
    unchecked: list  # (first, behind the last) message that no checksum of the file covers
    hearsay: set  # topics whose definition is left in the index only, which has no checksum

    @property
    def problems(self) -> list:
        return self.damages + self.verifier.problems

    def headline(self) -> str:
        """Cause, topic and time in one line: the first of what is wrong with the file, and of what the digests say."""
        return "; ".join(self.damages[:1] + self.verifier.problems[:1])

    @property
    def verified(self) -> bool:
        return bool(self.verifier.digests)

    @property
    def span(self) -> tuple:
        """First and last time [ns]."""
        times = [message.time for message in self.messages]
        return (min(times), max(times)) if times else (0, 0)

    def counts(self) -> dict:
        """topic -> number of messages."""
        result = {}
        for message in self.messages:
            result[message.connection.topic] = result.get(message.connection.topic, 0) + 1
        return dict(sorted(result.items()))

    def summary(self) -> str:
        first, last = self.span
        text = f"{len(self.messages)} messages on {len(self.counts())} topics, {(last - first) * 1e-9:.3f} s"
        if not self.verified:
            return text + ", no digest: payloads cannot be verified"
        until = self.verifier.vouched_until
        whole = f", intact up to {seconds(until)} s" if until is not None else ", nothing vouched for from the start"
        return f"{text}, {self.verifier.vouched} verified by {self.verifier.digests} digests{whole}"


def inspect(path) -> Finding:
    """Reads all that can be read. Raises MissingInputError, and BagError for what never was a bag; what is wrong with a
    bag is in the finding."""
    path = Path(path)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise MissingInputError(f"{path}: no such bag") from None
    except OSError as error:
        raise MissingInputError(f"{path}: {os.strerror(error.errno)}") from None
    bag = BagFile(content)
    if not bag.chunks and not content.startswith(MAGIC):
        raise BagError(f"{path}: not a readable ROS bag: starts with {content[:13]!r}, expected {MAGIC!r}")
    verifier, messages, numbers = Verifier(), [], []
    for number, message in enumerate(bag.messages()):
        verifier.add(message)
        if message.connection.topic != TOPIC:
            messages.append(message)
            numbers.append(number)
    unchecked = [tuple(bisect.bisect_left(numbers, end) for end in ends) for ends in bag.unchecked]
    verifier.finish()
    places = [
        f"byte {place}{'' if after is None else f', after {seconds(after)} s'}: {cause}"
        for place, cause, after in bag.damages
    ]
    lacks = bag.lacks()
    if TOPIC in [connection.topic for connection in bag.connections.values()] and not verifier.digests:
        lacks.append("no digest is left")
    # that a recording was cut off says more than where
    damages = lacks + places if not bag.indexed else places + lacks
    hearsay = {connection.topic for number, connection in bag.listed.items() if number not in bag.described}
    return Finding(path, messages, verifier, damages, unchecked, hearsay)


def read_verified(path) -> list:
    """The messages of an undamaged bag, digests left out, and the notes of its final digest. Raises MissingInputError,
    and BagError for the first thing that is wrong. A bag without digests passes if its structure does."""
    found = inspect(path)
    if found.problems:
        raise BagError(f"{path}: damaged: {found.headline()} (phri-analysis recover saves what is intact)")
    return found.messages, found.verifier.final or {}


def recovered_path(path) -> Path:
    """`x.bag`, `x.bag.active`, `x.bag.aborted` -> `x.recovered.bag`."""
    name = Path(path).name
    for ending in (".active", ".aborted", ".bag"):
        name = name.removesuffix(ending)
    return Path(path).with_name(name + ".recovered.bag")


def recover(path) -> tuple:
    """Writes what is intact of a bag beside it. Returns (the path written, the Finding of what was saved). Left out are
    chunks that do not decompress to what they should, a topic's messages of half a second that are not what was
    recorded, and, where there are digests, what neither they nor a chunk's checksum vouch for. Raises UsageError when
    there is nothing to do or the target exists, BagError when nothing can be saved, OutputError."""
    target = recovered_path(path)
    found = inspect(path)
    if not found.problems:
        raise UsageError(f"{path}: nothing to recover, the bag is intact")
    if not found.messages or not (saved := _unchanged(found)):
        raise BagError(f"{path}: nothing can be saved: {found.headline()}")
    try:
        file = open(target, "xb")
    except FileExistsError:
        raise UsageError(f"{target} exists, and is not overwritten") from None
    except OSError as error:
        raise OutputError(f"{target}: {os.strerror(error.errno)}") from None
    found.messages = saved
    try:
        with file:
            _write(file, found)
    except OSError as error:
        target.unlink(missing_ok=True)
        raise OutputError(f"{target}: {os.strerror(error.errno)}") from None
    return target, found


def _unchanged(found):
    if not found.verified:
        return found.messages
    covered = np.ones(len(found.messages), dtype=bool)
    for begin, end in found.unchecked:
        covered[begin:end] = False
    verdicts = found.verifier.verdicts
    confirmed = {topic for _, _, verdict in verdicts for topic, judged in verdict.items() if judged == INTACT}
    for i, message in enumerate(found.messages):
        covered[i] &= message.connection.topic not in found.hearsay - confirmed
    keep = covered.copy()
    for begin, end, verdict in verdicts:
        for i in range(begin, end):
            judged = verdict[found.messages[i].connection.topic]
            keep[i] = judged == INTACT or (judged == MISSING and covered[i])
    return [message for message, kept in zip(found.messages, keep) if kept]


def _write(file, found):
    writer, digest = BagWriter(file), Digest()
    start = newest = None
    for message in found.messages:
        # a damage outside the digests' reach may have left a time that no clock shows
        start = message.time if start is None else start
        newest = message.time if newest is None else max(newest, message.time)
        writer.write(message)
        digest.add(message)
        if newest - start >= _DIGEST_PERIOD:
            writer.write(digest.take(newest, False))
            start = newest
    until = found.verifier.vouched_until
    notes = {"recovered_from": found.path.name, "vouched_messages": found.verifier.vouched, "vouched_until_ns": until}
    writer.write(digest.take(newest, True, **notes))
    writer.close()
