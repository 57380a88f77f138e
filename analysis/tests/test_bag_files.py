"""The container format against ROS's own library: what one writes the other reads, message for message."""

import bz2

import genpy
import pytest
import rosbag
from std_msgs.msg import Float64, String

from phri_analysis.bag_files import BagFile, Broken, Connection, Message, decompress
from phri_analysis.bag_output import BagWriter


def ros_messages(path):
    with rosbag.Bag(str(path)) as bag:
        return [(topic, message[0], message[1], time.to_nsec()) for topic, message, time in bag.read_messages(raw=True)]


def ours(messages):
    return [(m.connection.topic, m.connection.type, m.data, m.time) for m in messages]


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
@pytest.mark.parametrize("chunk", [500, 786432])
def test_what_ros_writes_is_read(tmp_path, compression, chunk):
    path = tmp_path / "a.bag"
    with rosbag.Bag(str(path), "w", compression=compression, chunk_threshold=chunk) as bag:
        for i in range(300):
            bag.write("/text", String("x" * (i % 40)), genpy.Time(5 + i // 10, 7 * i))
            bag.write("/number", Float64(i), genpy.Time(5 + i // 10, 7 * i))
    read = BagFile(path.read_bytes())
    assert ours(read.messages()) == ros_messages(path)
    assert read.damages == read.lacks() == []


def test_ros_reads_what_is_written(tmp_path):
    text = Connection("/text", "std_msgs/String", String._md5sum, String._full_text, latching=True)
    number = Connection("/number", "std_msgs/Float64", Float64._md5sum, Float64._full_text)
    # an empty payload, one larger than a chunk, and times that run back
    messages = [Message(text, 10**9 + 3, b"\0\0\0\0"), Message(text, 2 * 10**9, b"\x50\xc3\0\0" + b"a" * 50000)]
    messages += [Message(number, 3 * 10**9 - i, bytes([i % 256] * 8)) for i in range(3000)]
    path = tmp_path / "b.bag"
    with open(path, "wb") as file:
        writer = BagWriter(file)
        for message in messages:
            writer.write(message)
        writer.close()
    assert list(BagFile(path.read_bytes()).messages()) == messages
    assert sorted(ros_messages(path)) == sorted(ours(messages))
    with rosbag.Bag(str(path)) as bag:
        headers = {connection.topic: connection.header for connection in bag._get_connections()}
        info = bag.get_compression_info()
    assert info.compression == "lz4" and info.compressed < info.uncompressed
    assert headers["/text"]["latching"] == b"1" and "latching" not in headers["/number"]


def test_an_empty_bag(tmp_path):
    path = tmp_path / "c.bag"
    with open(path, "wb") as file:
        BagWriter(file).close()
    read = BagFile(path.read_bytes())
    assert list(read.messages()) == ros_messages(path) == []
    assert read.damages == read.lacks() == []


@pytest.mark.parametrize(
    "compression, data, size, cause",
    [
        (b"lz4", b"abc", 10, "lz4"),
        (b"lz4", b"abc", 10**6, "in 3 of lz4"),
        (b"bz2", b"abc", 10, "bz2"),
        (b"none", b"abc", 4, "3 bytes, states 4"),
        (b"none", b"abc", 2**32 - 1, "at most"),
        (b"zip", b"abc", 3, "expected lz4, bz2 or none"),
    ],
)
def test_a_chunk_that_is_none_is_refused(compression, data, size, cause):
    with pytest.raises(Broken, match=cause):
        decompress(compression, data, size)


def test_a_chunk_never_grows_beyond_what_it_states():
    bomb = bz2.compress(b"\0" * 50_000_000)
    with pytest.raises(Broken, match="101 bytes, states 100"):
        decompress(b"bz2", bomb, 100)
