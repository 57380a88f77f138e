"""Are these the messages that were recorded? The recorder leaves digests in the bag (phri_sim/ros/bag_digest.hpp says
what is in them): every 0.5 s, per topic, how many messages came since the last digest and a CRC-32 over their bytes,
times and definition. `Verifier` compares, `Digest` makes them for bags written here.
"""

import json
import struct
import zlib
from dataclasses import dataclass, field

from .bag_files import Connection, Message

TOPIC = "/phri/digest"
CONNECTION = Connection(TOPIC, "std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1", "string data\n")
_VERSION = 1
# of a topic in a stretch: as recorded; some messages are gone, others may be as recorded; not what was recorded
INTACT, MISSING, CHANGED = "intact", "missing", "changed"


def _tail(text):
    return b',"crc32":"%08x"}' % zlib.crc32(text)


_TAIL = len(_tail(b""))


class Digest:
    """Sums over messages, per topic, since the last `take`."""

    def __init__(self):
        self._identities = {}
        self._since = {}  # topic -> [count, crc]
        self.messages = self.number = 0

    def add(self, message: Message) -> None:
        connection, time, data = message
        entry = self._since.get(connection.topic)
        if entry is None:
            entry = self._since[connection.topic] = [0, self._identity(connection)]
        entry[0] += 1
        entry[1] = zlib.crc32(data, zlib.crc32(struct.pack("<III", *divmod(time, 10**9), len(data)), entry[1]))
        self.messages += 1

    def _identity(self, connection):
        if connection not in self._identities:
            text = "".join(f"{part}\0" for part in connection[:4])
            self._identities[connection] = zlib.crc32(text.encode())
        return self._identities[connection]

    def topics(self) -> dict:
        """topic -> [count, CRC in hex] since the last `take`."""
        return {topic: [count, f"{crc:08x}"] for topic, (count, crc) in self._since.items()}

    def restart(self) -> None:
        """Forgets the sums since the last `take`."""
        self._since = {}

    def take(self, time: int, final: bool, **notes) -> Message:
        """The digest as a message; `notes` go into it."""
        body = {"final": final, "messages": self.messages, "number": self.number, "time_ns": time,
                "topics": self.topics(), "version": _VERSION, **notes}
        text = json.dumps(body, separators=(",", ":"), sort_keys=True)[:-1].encode()
        text += _tail(text)
        self.number += 1
        self.restart()
        return Message(CONNECTION, time, struct.pack("<I", len(text)) + text)


@dataclass
class Verifier:
    """Takes the messages of a bag in file order. `problems`: what the digests say is wrong; `vouched_until`: the time
    up to which everything is as it was written, None when the first digest is already off or there is none; `vouched`:
    messages in stretches that are as they were written; `verdicts`: for every stretch that could be compared (its first
    message, behind its last message, {topic: one of INTACT, MISSING, CHANGED})."""

    problems: list = field(default_factory=list)
    digests: int = 0
    vouched: int = 0
    verdicts: list = field(default_factory=list)
    vouched_until: int | None = None
    final: dict | None = None  # the last digest, if it is the one that ends the bag
    seen: Digest = field(default_factory=Digest)
    _sound: bool = True  # nothing wrong so far
    _next: int = 0
    _since: int = 0  # messages since the last digest
    _from: int | None = None  # time of the first of them

    def add(self, message: Message) -> None:
        if message.connection.topic == TOPIC:
            self._digest(message)
            return
        if self._from is None:
            self._from = message.time
        self._since += 1
        self.seen.add(message)

    def finish(self) -> None:
        """Call after the last message."""
        if self.digests and not self.final:
            self.problems.append(f"no final digest: {self._since} messages after the last one, unverified")
        elif self._since and self.final:
            self.problems.append(f"{self._since} messages after the final digest")

    def _digest(self, message):
        body, self.final = parse(message.data), None
        self.digests += 1
        if body is None:
            self._wrong(f"the digest at {seconds(message.time)} s is damaged")
            self._next += 1
        else:
            if body["number"] != self._next:
                self._wrong(f"digest {body['number']} follows digest {self._next - 1} at {seconds(message.time)} s")
            elif body["time_ns"] != message.time:
                self._wrong(f"the digest of {seconds(body['time_ns'])} s stands at {seconds(message.time)} s")
            elif self._compare(body):
                self.vouched += self._since
                if self._sound:
                    self.vouched_until = message.time
            self._next = body["number"] + 1
            self.final = body if body["final"] else None
        self._since, self._from = 0, None
        self.seen.restart()

    def _compare(self, body):
        found, said = self.seen.topics(), body["topics"]
        start = body["time_ns"] if self._from is None else self._from
        stretch = f"between {seconds(start)} s and {seconds(body['time_ns'])} s"
        verdict = {}
        for topic in sorted(found.keys() | said.keys()):
            (count, crc), (wanted, right) = found.get(topic, (0, "")), said.get(topic, (0, ""))
            verdict[topic] = INTACT if crc == right else MISSING if count < wanted else CHANGED
            if count != wanted:
                self._wrong(f"topic {topic}: {count} messages {stretch}, {wanted} were recorded")
            elif crc != right:
                self._wrong(f"topic {topic}: the messages {stretch} are not those that were recorded (CRC-32 {crc}, "
                            f"digest {right})")
        self.verdicts.append((self.seen.messages - self._since, self.seen.messages, verdict))
        return found == said

    def _wrong(self, text):
        self._sound = False
        self.problems.append(text)


def parse(data: bytes) -> dict | None:
    """The content of a digest message; None when it is damaged."""
    text, tail = data[4:-_TAIL], data[-_TAIL:]
    if struct.pack("<I", len(data) - 4) != data[:4] or tail != _tail(text):
        return None
    try:
        body = json.loads(text + b"}")
        known = body["version"] == _VERSION and body["number"] >= 0 and body["time_ns"] >= 0
        known = known and isinstance(body["final"], bool) and all(len(entry) == 2 for entry in body["topics"].values())
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return body if known else None


def seconds(time: int) -> str:
    return f"{time * 1e-9:.3f}"
