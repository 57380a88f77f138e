"""The recorder killed, and without disk: what `recover` then has. recorder_test_driver of phri_sim records a trial the
way the experiment node does; skipped where the workspace is not built. The measured shares are properties in the JUnit
file."""

import json
import os
import resource
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from phri_analysis import bag_check, bags
from phri_analysis.errors import BagError

ROOT = Path(__file__).resolve().parents[2]
DRIVER = Path(os.environ.get("PHRI_DEVEL", ROOT / "catkin_ws" / "devel")) / "lib" / "phri_sim" / "recorder_test_driver"
pytestmark = pytest.mark.skipif(not DRIVER.is_file(), reason="the workspace is not built")
SECONDS = 6  # of trial
START = 10**9  # [ns] of session time, as in the driver
LOSS = 500_000_000  # [ns] that a fault may cost, rows 13, 28 and 29 of the fault matrix
SHARE = 0.99  # of the messages before that
DISK = 98 * 4096  # [byte]


def drive(folder, pace, **options):
    """The recorder running into `folder`; its bag; a function that reads the time it has recorded so far."""
    process = subprocess.Popen([str(DRIVER), str(folder), str(SECONDS), str(pace)], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, **options)
    path = Path(process.stdout.readline().strip())
    return process, path, process.stdout


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """(the bag, its messages) of a run that nothing disturbed."""
    process, path, _ = drive(tmp_path_factory.mktemp("whole"), 0)
    _, error = process.communicate()
    assert process.returncode == 0, error
    found = bag_check.inspect(path)
    assert found.problems == []
    return path, found.messages


def share_saved(kept, whole, written_until):
    """(share of the messages written 0.5 s before and earlier, what the fault cost [s]); all that was saved must be
    what an undisturbed run records."""
    assert kept == whole[: len(kept)]
    old = sum(message.time <= written_until - LOSS for message in whole)
    saved = sum(message.time <= written_until - LOSS for message in kept)
    return saved / old, max(0, written_until - kept[-1].time) * 1e-9


def test_what_is_recorded_is_verified_and_is_the_trial(whole):
    path, messages = whole
    found = bag_check.inspect(path)
    assert found.verifier.vouched == len(messages)
    assert found.verifier.digests == 2 * SECONDS  # every 0.5 s and at the end, where one is due anyway
    table = bags.read_trial(path)
    assert len(table) == 1000 * SECONDS and table.attrs["clock"] == "realtime"
    # the driver's own pattern
    np.testing.assert_array_equal(table["lateness"], 1e-6 * (np.arange(len(table)) % 1000))
    assert set("".join(table.attrs["map"]["grid"])) == {"#", "."}


def test_kill_9_costs_a_few_milliseconds(whole, tmp_path, record_testsuite_property):
    """Row 29. At the speed of lockstep and in real time; killed at times that a seed chose."""
    random = np.random.default_rng(29)
    shares, losses = [], []
    for i, pace in enumerate([0, 0, 0, 20, 20, 20, 4, 4]):
        process, path, said = drive(tmp_path / str(i), pace)
        kill_at = START + random.uniform(1.0, 0.9 * SECONDS) * 1e9
        newest = 0
        for line in said:
            newest = int(line)
            if newest >= kill_at:
                break
        process.send_signal(signal.SIGKILL)
        rest = said.read().split("\n")  # a last line may be cut off
        newest = max([newest, *map(int, rest[:-1])])
        assert process.wait() == -signal.SIGKILL
        process.stderr.close()
        active = path.with_name(path.name + ".active")
        assert [entry.name for entry in path.parent.iterdir()] == [active.name]
        with pytest.raises(BagError, match="no index: the recording was cut off"):
            bags.read_trial(active)
        target, found = bag_check.recover(active)
        share, loss = share_saved(found.messages, whole[1], newest)
        assert share >= SHARE and loss * 1e9 <= LOSS
        assert bag_check.inspect(target).problems == []
        assert bags.read_trial(target).attrs["recovered"]
        shares.append(share)
        losses.append(loss)
    record_testsuite_property(
        "kill_9", f"{len(shares)} kills: {100 * min(shares):.2f} % or more of the messages older than 0.5 s; lost "
        f"{1e3 * np.median(losses):.0f} ms of trial in the median, {1e3 * max(losses):.0f} ms at most"
    )


def limited():
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (DISK, DISK))


def test_a_full_disk_is_reported_and_costs_a_few_milliseconds(whole, tmp_path, record_testsuite_property):
    """Row 28, by a limit on the size of files: the write fails as on a full disk."""
    process, path, _ = drive(tmp_path, 0, preexec_fn=limited)
    out, error = process.communicate()
    assert process.returncode == 74 and path.name in error, error
    check_leftover(path, int(out.split()[-1]), whole, record_testsuite_property, "file_size_limit")


def test_a_full_file_system(whole, tmp_path, record_testsuite_property):
    """Row 28 with a file system of its own that is really full."""
    name, mount = tmp_path / "kept", tmp_path / "disk"
    name.mkdir()
    mount.mkdir()
    script = (f'mount -t tmpfs -o size={DISK} none "{mount}" || exit 99; "{DRIVER}" "{mount}" {SECONDS} 0; code=$?; '
              f'cp "{mount}"/* "{name}"; exit $code')
    done = subprocess.run(["unshare", "--mount", "sh", "-c", script], capture_output=True, text=True)
    if done.returncode == 99 or "unshare" in done.stderr:
        pytest.skip("no mount namespace here: " + done.stderr.strip())
    assert done.returncode == 74 and "No space left on device" in done.stderr, done.stderr
    path = name / Path(done.stdout.splitlines()[0]).name
    check_leftover(path, int(done.stdout.split()[-1]), whole, record_testsuite_property, "full_file_system")


def check_leftover(path, newest, whole, record, name):
    active = path.with_name(path.name + ".active")
    assert not path.exists() and active.stat().st_size <= DISK
    target, found = bag_check.recover(active)
    share, loss = share_saved(found.messages, whole[1], newest)
    assert share >= SHARE and loss * 1e9 <= LOSS
    assert len(bags.read_trial(target)) > 100
    record(name, json.dumps({"share_older_than_0.5_s": share, "lost_ms": round(1e3 * loss), "bytes": DISK}))
