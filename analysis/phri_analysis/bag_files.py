"""The container format of ROS 1 bags (version 2.0, http://wiki.ros.org/Bags/Format/2.0), read without ROS.

Why not a library: a verified reading needs every payload as it lies in the file, a recovery must step over what is
damaged, and both must work the same with and without ROS. `rosbag` and `rosbags` read by the index, which a cut-off bag
does not have, and stop at the first damage. Messages come in the order in which they were written.

Nothing is believed: every length is checked against the file, a chunk must decompress to its stated size with a valid
content checksum (lz4 and bz2 have one, uncompressed chunks have none), and a damage is a value, not an exception.
Times are integers [ns].
"""

import bz2
import struct
from dataclasses import dataclass, field
from typing import NamedTuple

import lz4.frame

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
LARGEST_CHUNK = 1 << 28  # uncompressed; rosbag's default is 768 KB
LARGEST_RATIO = 255  # lz4 cannot do better
# a message record as the C++ library writes it: fields sorted by name, all of one length
_USUAL = struct.Struct("<I I5sI I3sB I5sII I")
_USUAL_CONSTANTS = (38, 9, b"conn=", 4, b"op=", MESSAGE, 13, b"time=")
_TIME_AT = slice(34, 42)  # of such a record
_CHUNK_MARK = b"\x04\x00\x00\x00op=\x05"
_LONGEST_CHUNK_HEADER = 80


class Connection(NamedTuple):
    topic: str
    type: str
    md5sum: str
    definition: str
    latching: bool = False


class Message(NamedTuple):
    connection: Connection
    time: int
    data: bytes


class Damage(NamedTuple):
    """Something at byte `offset` of the file that cannot be what was written. `after`: time of the last good message
    before it, None before the first."""

    offset: int
    cause: str
    after: int | None = None


class Broken(Exception):
    """A record that is not one; never leaves this module but from `decompress`."""


@dataclass
class BagFile:
    """The records of a bag. `damages` and `unchecked` grow while `messages` is iterated."""

    content: bytes
    indexed: bool = False
    stated_chunks: int = 0
    stated_connections: int = 0
    chunks: list = field(default_factory=list)  # (offset of the record, its fields, start and end of its data)
    listed: dict = field(default_factory=dict)  # id -> Connection, of the index at the end
    described: dict = field(default_factory=dict)  # the same, of the chunks
    unchecked: list = field(default_factory=list)  # (first, behind the last) message of chunks without a checksum
    _indexes: dict = field(default_factory=dict)  # offset of a chunk -> {id: its entries of the index}
    _infos: dict = field(default_factory=dict)  # offset of a chunk -> (fields, data) of its summary
    _entries: dict = field(default_factory=dict)  # the index that the chunk at hand must have
    damages: list = field(default_factory=list)
    _last: int | None = None
    _count: int = 0

    def __post_init__(self):
        if not self.content.startswith(MAGIC):
            self._damage(0, f"starts with {self.content[:13]!r}, expected {MAGIC!r}")
        self._walk(len(MAGIC), len(self.content))

    def messages(self):
        """All that can be read, chunk by chunk. What cannot is in `damages` afterwards."""
        self._last, self._count = None, 0
        for chunk in list(self.chunks):
            yield from self._chunk(*chunk)

    @property
    def connections(self) -> dict:
        """id -> Connection. A chunk's copy counts more than the index's: most chunks have a checksum."""
        return {**self.listed, **self.described}

    def lacks(self) -> list:
        """After `messages`: what the file's own counts say is missing, as texts."""
        if not self.indexed:
            return ["no index: the recording was cut off"]
        texts = []
        if len(self.chunks) != self.stated_chunks:
            texts.append(f"{len(self.chunks)} chunks, the header says {self.stated_chunks}")
        if self.listed != self.described or len(self.listed) != self.stated_connections:
            differ = [
                (self.described.get(number) or self.listed[number]).topic
                for number in sorted(self.listed.keys() | self.described.keys())
                if self.listed.get(number) != self.described.get(number)
            ]
            texts.append(
                f"{len(self.described)} connections in the chunks, {len(self.listed)} in the index, the header says "
                f"{self.stated_connections}; not the same in both: {', '.join(differ) or 'none'}"
            )
        return texts

    def _damage(self, offset, cause):
        self.damages.append(Damage(offset, cause, self._last))

    def _walk(self, position, end):
        """Records between chunks; steps over what is none to the next chunk."""
        while position < end:
            try:
                fields, start, stop = _record(self.content, position, end)
                operation = fields.get(b"op", b"")
                if operation == bytes([CHUNK]) and start == stop:
                    raise Broken("a chunk that was not finished")
                self._top_level(operation, fields, position, start, stop)
                position = stop
            except Broken as error:
                self._damage(position, str(error))
                position = _find_chunk(self.content, position + 1, end)

    def _top_level(self, operation, fields, position, start, stop):
        if operation == bytes([CHUNK]):
            self.chunks.append((position, fields, start, stop))
            self._indexes[position] = {}
        elif operation == bytes([CONNECTION]):
            _know(self.listed, *_connection(fields, self.content[start:stop]))
        elif operation == bytes([BAG_HEADER]):
            self.indexed = _number(fields, b"index_pos", 8) > 0
            self.stated_chunks = _number(fields, b"chunk_count", 4)
            self.stated_connections = _number(fields, b"conn_count", 4)
            if b"encryptor" in fields and fields[b"encryptor"]:
                raise Broken("encrypted")
        elif operation == bytes([INDEX]) and self.chunks:
            self._indexes[self.chunks[-1][0]][_number(fields, b"conn", 4)] = self.content[start:stop]
        elif operation == bytes([CHUNK_INFO]):
            self._infos[_number(fields, b"chunk_pos", 8)] = fields, self.content[start:stop]
        else:
            raise Broken(f"record of kind {operation!r}")

    def _chunk(self, offset, fields, start, stop):
        compression, first, self._entries = fields.get(b"compression", b""), self._count, {}
        try:
            payload = decompress(compression, self.content[start:stop], _number(fields, b"size", 4))
        except Broken as error:
            self._damage(offset, f"chunk: {error}")
            inside = _find_chunk(self.content, start, stop)  # a wrong length may have swallowed the next ones
            if inside < stop:
                known = len(self.chunks)
                self._walk(inside, stop)
                for chunk in self.chunks[known:]:
                    yield from self._chunk(*chunk)
            return
        try:
            yield from self._records(payload)
            if self.indexed:
                self._check_index(offset)
        except Broken as error:
            self._damage(offset, f"inside a chunk: {error}")
        if compression == b"none":
            self.unchecked.append((first, self._count))

    def _check_index(self, offset):
        """Nothing is read by the index here, but other tools find messages by it."""
        stated = self._indexes[offset]
        for number in sorted(stated.keys() | self._entries.keys()):
            entries = b"".join(self._entries.get(number, ()))
            if stated.get(number) != entries and _by_time(stated.get(number, b"")) != _by_time(entries):
                known = self.connections.get(number)
                raise Broken(f"the index is wrong about {known.topic if known else f'connection {number}'}")
        fields, data = self._infos.get(offset, ({}, b""))
        times = [entry[:8] for entries in self._entries.values() for entry in entries]
        ends = sorted(set(times), key=_time)
        counts = {struct.pack("<II", number, len(entries)) for number, entries in self._entries.items()}
        if (
            {data[i : i + 8] for i in range(0, len(data), 8)} != counts
            or _number(fields, b"count", 4) != len(counts)
            or [fields.get(b"start_time"), fields.get(b"end_time")] != ([ends[0], ends[-1]] if ends else [None, None])
        ):
            raise Broken("the summary in the index is not that of the chunk")

    def _records(self, payload):
        position, end = 0, len(payload)
        while position < end:
            if end - position >= _USUAL.size:
                head = _USUAL.unpack_from(payload, position)
                number, seconds, nanoseconds, size = head[3], head[9], head[10], head[11]
                if (*head[:3], *head[4:9]) == _USUAL_CONSTANTS:
                    entry = payload[position : position + _USUAL.size][_TIME_AT] + position.to_bytes(4, "little")
                    self._entries.setdefault(number, []).append(entry)
                    position += _USUAL.size
                    if size > end - position:
                        raise Broken(f"a message of {size} bytes, {end - position} are left")
                    yield self._message(number, seconds, nanoseconds, payload[position : position + size])
                    position += size
                    continue
            begin = position
            fields, start, position = _record(payload, begin, end)
            operation = fields.get(b"op", b"")
            if operation == bytes([MESSAGE]):
                if len(fields.get(b"time", b"")) != 8:
                    raise Broken("a message without a time")
                number, time = _number(fields, b"conn", 4), struct.unpack("<II", fields[b"time"])
                self._entries.setdefault(number, []).append(fields[b"time"] + begin.to_bytes(4, "little"))
                yield self._message(number, *time, payload[start:position])
            elif operation == bytes([CONNECTION]):
                _know(self.described, *_connection(fields, payload[start:position]))
            else:
                raise Broken(f"record of kind {operation!r}")

    def _message(self, number, seconds, nanoseconds, data):
        connection = self.described.get(number) or self.listed.get(number)
        if connection is None:
            raise Broken(f"a message of connection {number}, which nothing describes")
        self._last = seconds * 10**9 + nanoseconds
        self._count += 1
        return Message(connection, self._last, data)


def _know(connections, number, connection):
    if connections.setdefault(number, connection) != connection:
        raise Broken(f"two definitions of connection {number} ({connection.topic})")


def _time(stamp):
    return struct.unpack("<II", stamp)


def _by_time(entries):
    """Of one time as a set: their order is the writer's."""
    return sorted(entries[i : i + 12] for i in range(0, len(entries), 12))


def decompress(compression: bytes, data: bytes, size: int) -> bytes:
    """The content of a chunk. Raises Broken."""
    if size > LARGEST_CHUNK:
        raise Broken(f"states {size} bytes, expected at most {LARGEST_CHUNK}")
    if compression == b"none":
        if len(data) != size:
            raise Broken(f"{len(data)} bytes, states {size}")
        return data
    if compression == b"lz4":
        if size > LARGEST_RATIO * len(data) + 64:
            raise Broken(f"states {size} bytes in {len(data)} of lz4")
        stream = lz4.frame.LZ4FrameDecompressor()
    elif compression == b"bz2":
        stream = bz2.BZ2Decompressor()
    else:
        raise Broken(f"compression {compression!r}, expected lz4, bz2 or none")
    try:
        content = stream.decompress(data, max_length=size + 1)
    except (RuntimeError, OSError, EOFError, ValueError, MemoryError) as error:
        raise Broken(f"{compression.decode()}: {error}") from None
    if not stream.eof or stream.unused_data or len(content) != size:
        raise Broken(f"{compression.decode()}: {len(content)} bytes, states {size}")
    return content


def _record(content, position, end):
    """(header fields, start and end of the data). Raises Broken."""
    fields, start = _header(content, position, end)
    if end - start < 4:
        raise Broken("cut off")
    size = int.from_bytes(content[start : start + 4], "little")
    if size > end - start - 4:
        raise Broken(f"a record of {size} bytes, {end - start - 4} are left")
    return fields, start + 4, start + 4 + size


def _header(content, position, end):
    if end - position < 4:
        raise Broken("cut off")
    length = int.from_bytes(content[position : position + 4], "little")
    if length > end - position - 4:
        raise Broken(f"a header of {length} bytes, {end - position - 4} are left")
    return _fields(content[position + 4 : position + 4 + length]), position + 4 + length


def _fields(block):
    fields, position = {}, 0
    while position < len(block):
        size = int.from_bytes(block[position : position + 4], "little")
        name, equals, value = block[position + 4 : position + 4 + size].partition(b"=")
        if size > len(block) - position - 4 or not equals or name in fields:
            raise Broken("a header field that is none")
        fields[name] = value
        position += 4 + size
    return fields


def _number(fields, name, size):
    value = fields.get(name, b"")
    if len(value) != size:
        raise Broken(f"header field {name.decode()} of {len(value)} bytes, expected {size}")
    return int.from_bytes(value, "little")


def _connection(fields, data):
    number, about = _number(fields, b"conn", 4), _fields(data)
    try:
        topic = fields[b"topic"].decode()
        kind, md5sum, definition = (about[key].decode() for key in (b"type", b"md5sum", b"message_definition"))
    except (KeyError, UnicodeDecodeError):
        raise Broken(f"connection {number} without a readable topic, type, md5sum and definition") from None
    if about.get(b"topic", fields[b"topic"]) != fields[b"topic"]:
        raise Broken(f"connection {number} has two topics")
    return number, Connection(topic, kind, md5sum, definition, about.get(b"latching") == b"1")


def _find_chunk(content, position, end):
    """Where the next chunk record begins; `end` if there is none."""
    mark = content.find(_CHUNK_MARK, position, end)
    while mark >= 0:
        for start in range(max(position, mark - _LONGEST_CHUNK_HEADER), mark - 3):
            try:
                fields, stop = _header(content, start, min(end, start + _LONGEST_CHUNK_HEADER))
            except Broken:
                continue
            if stop > mark and {b"op", b"compression", b"size"} == set(fields):
                return start
        mark = content.find(_CHUNK_MARK, mark + 1, end)
    return end
