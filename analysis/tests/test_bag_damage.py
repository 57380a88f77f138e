"""Damaged bags: nothing that is read from one is silently wrong, no error is of a type that callers do not know, and
what is intact can be saved. The shares that were measured are properties of the cases in the JUnit file."""

import numpy as np
import pytest
import rosbag

import bag_writer
import synthetic
from phri_analysis import bag_check, bag_digest, bags
from phri_analysis.bag_files import BagFile
from phri_analysis.errors import BagError, DataError, UsageError

TICKS, DIGEST_EVERY = 200, 50
FLIPS, CUTS = 600, 100


@pytest.fixture(scope="module")
def table():
    whole = synthetic.plausible_trial(grid=synthetic.maze_grid(30))
    trial = whole.iloc[:TICKS].reset_index(drop=True)
    trial["prediction_horizon"] = 20 * 2.0**-7
    trial.attrs = whole.attrs
    return trial


@pytest.fixture(scope="module", params=["lz4", "none"])
def bag(request, table, tmp_path_factory):
    """bz2 and lz4 have checksums of their own; where there is no compression, only the digests tell."""
    path = tmp_path_factory.mktemp(request.param) / "a.bag"
    return bag_writer.write_bag(table, path, compression=request.param, chunk=4096, digest_every=DIGEST_EVERY)


def messages_of(path):
    return bag_check.inspect(path).messages


def compression_of(path):
    return path.parent.name[:-1]  # pytest numbers its folders


def flipped(content, random):
    """The content with one to three bits turned."""
    changed = bytearray(content)
    for _ in range(random.integers(1, 4)):
        changed[random.integers(len(changed))] ^= 1 << random.integers(8)
    return bytes(changed)


def is_subsequence(part, whole):
    rest = iter(whole)
    return all(any(one == other for other in rest) for one in part)


def test_no_flipped_bit_gives_wrong_numbers(bag, table, tmp_path, record_testsuite_property):
    """Row 27 of the fault matrix: a flip changes nothing that is read, or it is reported. What `recover` then saves was
    recorded just so, in this order."""
    random = np.random.default_rng(27)
    content, recorded = bag.read_bytes(), messages_of(bag)
    original = bags.read_trial(bag)
    assert original.equals(table) and original.attrs == table.attrs
    damaged, outcome, saved = tmp_path / "d.bag", {"unchanged": 0, "reported": 0}, []
    for _ in range(FLIPS):
        damaged.write_bytes(flipped(content, random))
        try:
            read = bags.read_trial(damaged)
            outcome["unchanged"] += 1
            assert read.equals(table) and read.attrs == table.attrs
            continue
        except BagError as error:
            outcome["reported"] += 1
            assert "\n" not in str(error) and str(damaged) in str(error)
        target, _ = bag_check.recover(damaged)
        kept = messages_of(target)
        target.unlink()
        assert is_subsequence(kept, recorded)
        saved.append(len(kept) / len(recorded))
    assert min(outcome.values()) > 0 and sum(outcome.values()) == FLIPS
    silent = FLIPS - sum(outcome.values())
    text = f"{outcome['reported']} reported, {outcome['unchanged']} change nothing, {silent} silently wrong"
    saved = f"share saved: median {np.median(saved):.4f}, 5th percentile {np.percentile(saved, 5):.3f}"
    record_testsuite_property(f"flips_{compression_of(bag)}", f"of {FLIPS}: {text}; {saved}")


def test_a_cut_bag_keeps_every_chunk_before_the_cut(bag, tmp_path, record_testsuite_property):
    content, recorded = bag.read_bytes(), messages_of(bag)
    chunks = BagFile(content)
    ends = [(stop, len(list(chunks._chunk(*chunk)))) for chunk in chunks.chunks for stop in [chunk[3]]]
    cut, saved = tmp_path / "c.bag", []
    for position in np.linspace(0, len(content) - 1, CUTS).astype(int):
        cut.write_bytes(content[:position])
        with pytest.raises(BagError):
            bags.read_trial(cut)
        whole = sum(count for stop, count in ends if stop <= position)
        if whole == 0:
            with pytest.raises(BagError, match="nothing can be saved|not a readable"):
                bag_check.recover(cut)
            continue
        target, found = bag_check.recover(cut)
        kept = messages_of(target)
        target.unlink()
        digests = sum(message.connection.topic == bag_digest.TOPIC for message in chunks_until(content, position))
        checksums = compression_of(bag) != "none"
        vouched = sum(1 for _ in up_to_last_digest(content, position))
        assert kept == recorded[: whole - digests if checksums or not digests else vouched]
        saved.append(len(kept))
        # digests vouch for what was saved up to the last one that is left
        until = found.verifier.vouched_until
        assert found.verifier.vouched == vouched
        assert (until is None) == (digests == 0)
    record_testsuite_property(
        f"cuts_{compression_of(bag)}", f"of {CUTS}: {CUTS} reported; {len(saved)} saved every chunk before the cut"
    )


def chunks_until(content, position):
    return [message for message in BagFile(content[:position]).messages()]


def up_to_last_digest(content, position):
    messages = chunks_until(content, position)
    last = max((i for i, m in enumerate(messages) if m.connection.topic == bag_digest.TOPIC), default=0)
    return (m for m in messages[:last] if m.connection.topic != bag_digest.TOPIC)


@pytest.mark.parametrize("name", ["a.bag.active", "a.bag.aborted", "a.bag"])
def test_recovery_never_overwrites_and_says_when_there_is_nothing_to_do(bag, tmp_path, name):
    path = tmp_path / name
    path.write_bytes(bag.read_bytes())
    with pytest.raises(UsageError, match="intact"):
        bag_check.recover(path)
    path.write_bytes(bag.read_bytes()[:-2000])
    target, _ = bag_check.recover(path)
    assert target.name == "a.recovered.bag"
    before = target.read_bytes()
    with pytest.raises(UsageError, match="exists, and is not overwritten"):
        bag_check.recover(path)
    assert target.read_bytes() == before


def test_a_recovered_bag_is_a_bag(table, tmp_path):
    """ROS reads it, its digests hold, its table is the trial up to the cut, and a folder does not count it twice."""
    path = bag_writer.write_bag(table, tmp_path / "a.bag", chunk=4096, digest_every=DIGEST_EVERY)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    target, found = bag_check.recover(path)
    with rosbag.Bag(str(target)) as opened:
        raw = [(topic, message[1], time.to_nsec()) for topic, message, time in opened.read_messages(raw=True)]
        latched = opened.get_type_and_topic_info().topics["/phri/experiment_node/tick"].message_count
    kept = [(m.connection.topic, m.data, m.time) for m in found.messages]
    assert sorted(entry for entry in raw if entry[0] != bag_digest.TOPIC) == sorted(kept)
    read = bags.read_trial(target)
    columns = [name for name in table if not name.startswith("prediction")]
    assert 50 < len(read) <= latched < TICKS
    assert read[columns].equals(table[columns].iloc[: len(read)])
    assert read.attrs == {**table.attrs, "recovered": True, "dropped_ticks": 1} or read.attrs == {
        **table.attrs, "recovered": True}
    assert bags.find_bags([tmp_path]) == [path] and bags.find_bags([target]) == [target]


def forge(path, change):
    """The bag rewritten message by message, all checksums of the file right: only the digests can tell."""
    from phri_analysis.bag_output import BagWriter

    messages = list(BagFile(path.read_bytes()).messages())
    with open(path, "wb") as file:
        writer = BagWriter(file)
        for message in change(messages):
            writer.write(message)
        writer.close()
    return path


def nudge(messages, i, **changes):
    return [*messages[:i], messages[i]._replace(**changes), *messages[i + 1 :]]


def swap(text):
    return text.replace("float64 x\nfloat64 y", "float64 y\nfloat64 x")


def turned(data):
    """One bit of the last byte."""
    return data[:-1] + bytes([data[-1] ^ 1])


def exchanged(messages):
    """Two messages of a topic in each other's place."""
    first, second = [i for i, m in enumerate(messages) if m.connection.topic == "/phri/human_wrench"][7:9]
    changed = list(messages)
    changed[first], changed[second] = messages[second], messages[first]
    return changed


def redefined(messages):
    return [
        m._replace(connection=m.connection._replace(definition=swap(m.connection.definition)))
        if m.connection.topic == "/phri/human_wrench" else m
        for m in messages
    ]


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda m: m[:300] + m[301:], ["49 messages between 1.000 s and 1.049 s, 50 were recorded"]),
        (lambda m: m[:300] + [m[300]] + m[300:], ["51 messages", "50 were recorded"]),
        (lambda m: nudge(m, 300, data=turned(m[300].data)), ["are not those that were recorded", "CRC-32"]),
        (lambda m: nudge(m, 300, time=m[300].time + 1), ["are not those that were recorded"]),
        (exchanged, ["/phri/human_wrench", "are not those that were recorded"]),
        (redefined, ["/phri/human_wrench", "are not those that were recorded"]),
        (lambda m: [x for x in m if x.connection.topic != "/phri/map"], ["/phri/map: 0 messages", "1 were recorded"]),
        (lambda m: [x for i, x in enumerate(m) if i != first_digest(m)], ["digest 1 follows digest -1"]),
        (lambda m: m[:-1], ["no final digest"]),
        (lambda m: m + [m[300]], ["1 messages after the final digest"]),
        (lambda m: nudge(m, first_digest(m), data=turned(m[first_digest(m)].data)), ["digest at 1.049 s is damaged"]),
    ],
)
def test_the_digest_sees_every_kind_of_change(table, tmp_path, change, words):
    path = bag_writer.write_bag(table, tmp_path / "a.bag", digest_every=DIGEST_EVERY)
    assert not bag_check.inspect(forge(path, lambda m: m)).problems
    forge(path, change)
    with pytest.raises(BagError) as error:
        bags.read_trial(path)
    assert all(word in str(error.value) for word in words), error.value


def first_digest(messages):
    return next(i for i, m in enumerate(messages) if m.connection.topic == bag_digest.TOPIC)


def test_what_the_digest_refuses_is_not_saved(table, tmp_path):
    """The topic's messages of that stretch go, everything else stays."""
    path = bag_writer.write_bag(table, tmp_path / "a.bag", digest_every=DIGEST_EVERY)
    wrenches = [i for i, m in enumerate(messages_of(path)) if m.connection.topic == "/phri/human_wrench"]
    victim = wrenches[DIGEST_EVERY + 7]
    # in the file a digest stands before it
    forge(path, lambda m: nudge(m, victim + 1, data=turned(m[victim + 1].data)))
    before = bag_check.inspect(path)
    begin, end, verdict = before.verifier.verdicts[1]
    topic, = (name for name, judged in verdict.items() if judged != bag_digest.INTACT)
    assert verdict[topic] == bag_digest.CHANGED
    target, _ = bag_check.recover(path)
    expected = [m for i, m in enumerate(before.messages) if not (begin <= i < end and m.connection.topic == topic)]
    assert len(expected) == len(before.messages) - DIGEST_EVERY and messages_of(target) == expected
    with pytest.raises(DataError, match="50 of 200 ticks lack a topic"):
        bags.read_trial(target)


def test_a_bag_of_before_there_were_digests_is_read(table, tmp_path):
    path = bag_writer.write_bag(table, tmp_path / "a.bag", digest_every=0)
    assert bags.read_trial(path).equals(table)
    assert "payloads cannot be verified" in bag_check.inspect(path).summary()
