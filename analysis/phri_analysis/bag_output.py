"""Writes a ROS 1 bag (see `bag_files`) without ROS, for what `recover` has saved."""

import struct

import lz4.frame

from .bag_files import BAG_HEADER, CHUNK, CHUNK_INFO, CONNECTION, INDEX, MAGIC, MESSAGE, Message

HEADER_LENGTH = 4096  # of the bag header's record: it is rewritten in place when the bag is complete
CHUNK_SIZE = 16 * 1024  # uncompressed


class BagWriter:
    """Writes a bag: lz4, chunks of 16 KB. `file` is open for binary writing and can seek."""

    def __init__(self, file):
        self._file = file
        self._numbers, self._infos = {}, []
        self._new_chunk()
        file.write(MAGIC)
        self._bag_header(0)

    def write(self, message: Message) -> None:
        number = self._numbers.get(message.connection)
        if number is None:
            number = self._numbers[message.connection] = len(self._numbers)
            self._chunk += self._connection_record(number, message.connection)
        stamp = struct.pack("<II", *divmod(message.time, 10**9))
        self._entries.setdefault(number, []).append(stamp + struct.pack("<I", len(self._chunk)))
        self._times.append(message.time)
        head = {b"conn": struct.pack("<I", number), b"op": bytes([MESSAGE]), b"time": stamp}
        self._chunk += _pack(head, message.data)
        if len(self._chunk) >= CHUNK_SIZE:
            self._flush()

    def close(self) -> None:
        """Completes the bag; the file stays open."""
        self._flush()
        index = self._file.tell()
        for connection, number in self._numbers.items():
            self._file.write(self._connection_record(number, connection))
        for info in self._infos:
            self._file.write(info)
        self._file.seek(len(MAGIC))
        self._bag_header(index)

    def _new_chunk(self):
        self._chunk, self._entries, self._times = bytearray(), {}, []

    def _bag_header(self, index):
        head = {
            b"chunk_count": struct.pack("<I", len(self._infos)),
            b"conn_count": struct.pack("<I", len(self._numbers)),
            b"index_pos": struct.pack("<Q", index),
            b"op": bytes([BAG_HEADER]),
        }
        record = _pack(head, b"")
        padding = b" " * (HEADER_LENGTH - len(record))
        self._file.write(_pack(head, padding))

    @staticmethod
    def _connection_record(number, connection):
        head = {b"conn": struct.pack("<I", number), b"op": bytes([CONNECTION]), b"topic": connection.topic.encode()}
        about = {
            b"message_definition": connection.definition.encode(),
            b"md5sum": connection.md5sum.encode(),
            b"topic": connection.topic.encode(),
            b"type": connection.type.encode(),
        }
        if connection.latching:
            about[b"latching"] = b"1"
        return _pack(head, _pack_fields(about))

    def _flush(self):
        if not self._chunk:
            return
        position = self._file.tell()
        head = {b"compression": b"lz4", b"op": bytes([CHUNK]), b"size": struct.pack("<I", len(self._chunk))}
        # as ROS's own lz4 wants it: independent blocks, no stated size
        packed = lz4.frame.compress(bytes(self._chunk), block_linked=False, content_checksum=True, store_size=False)
        self._file.write(_pack(head, packed))
        counts = b""
        for number, entries in self._entries.items():
            head = {
                b"conn": struct.pack("<I", number),
                b"count": struct.pack("<I", len(entries)),
                b"op": bytes([INDEX]),
                b"ver": struct.pack("<I", 1),
            }
            self._file.write(_pack(head, b"".join(entries)))
            counts += struct.pack("<II", number, len(entries))
        info = {
            b"chunk_pos": struct.pack("<Q", position),
            b"count": struct.pack("<I", len(self._entries)),
            b"end_time": struct.pack("<II", *divmod(max(self._times), 10**9)),
            b"op": bytes([CHUNK_INFO]),
            b"start_time": struct.pack("<II", *divmod(min(self._times), 10**9)),
            b"ver": struct.pack("<I", 1),
        }
        self._infos.append(_pack(info, counts))
        self._new_chunk()


def _pack_fields(fields):
    return b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value for name, value in fields.items()
    )


def _pack(fields, data):
    head = _pack_fields(fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data
