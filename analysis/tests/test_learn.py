"""Learning from one's own files: the same movements in three formats give the same library; what is wrong is said."""

import json
import os
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from bag_writer import message_class

from phri_analysis import bag_demonstrations
from phri_analysis.errors import BagError, DataError, MissingInputError, UsageError

pytest.importorskip("phri_learning", reason="the workspace is not built")
import genpy  # noqa: E402
import phri_learning  # noqa: E402
import rosbag  # noqa: E402
from geometry_msgs.msg import PoseStamped, Twist, WrenchStamped  # noqa: E402

import studies  # noqa: E402
from phri_analysis import learn  # noqa: E402
from phri_analysis.demonstrations import Demonstration, Movement  # noqa: E402
from studies import prediction  # noqa: E402

COMMAND = Path(__file__).resolve().parents[1] / "bin" / "phri-analysis"
STEP = 0.01  # [s] of the recordings
SAME = 1e-9  # m, N: stamps are whole nanoseconds
SAME_ERROR = 1e-5  # of the prediction: the times of a bag are those of the file to 1e-6 s at most
RIGHT, UP, BACK = (0.3, 0.0), (0.0, 0.2), (-0.2, -0.2)


def stroke(way, seed, seconds=2.0):
    """(t, x (T, 3), force (T, 3)): from rest to rest with an own length and place; the height keeps within 0.1 mm. The
    force is that of 2 kg."""
    rng = np.random.default_rng(seed)
    seconds *= np.exp(0.05 * rng.normal())
    t = STEP * np.arange(int(seconds / STEP))
    u = t / t[-1]
    s, a = u**3 * (10 - 15 * u + 6 * u**2), (60 * u - 180 * u**2 + 120 * u**3) / t[-1] ** 2
    reach = np.array([*way, 0.0]) * (1.0 + 0.03 * rng.normal())
    x = np.outer(s, reach) + 0.002 * np.array([*rng.normal(size=2), 0.0]) + np.outer(1e-4 * u, (0.0, 0.0, 1.0))
    return t, x, 2.0 * np.outer(a, reach)


def strokes(count=5):
    return [(f"{name}_{i}", stroke(way, 10 * j + i)) for j, (name, way) in
            enumerate((("right", RIGHT), ("up", UP), ("back", BACK))) for i in range(count)]  # fmt: skip


def put_bag(path, t, x, force, pose="/pose", wrench="/wrench", frames=("base", "base"), more=(), at=100.0):
    with rosbag.Bag(str(path), "w") as bag:
        for i, time in enumerate(t):
            stamp = genpy.Time(1_700_000_000, 0) + genpy.Duration.from_sec(round(at + time, 6))
            message = PoseStamped()
            message.header.stamp, message.header.frame_id = stamp, frames[0]
            message.pose.position.x, message.pose.position.y, message.pose.position.z = x[i]
            bag.write(pose, message, stamp)
            message = WrenchStamped()
            message.header.stamp, message.header.frame_id = stamp, frames[1]
            message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force[i]
            bag.write(wrench, message, stamp)
            for topic, other in more:
                bag.write(topic, other, stamp)
    return path


def put_csv(path, t, x, force):
    table = np.column_stack([t, x, force])
    rows = "\n".join(",".join(repr(float(v)) for v in row) for row in table)
    path.write_text("t,x,y,z,fx,fy,fz\n" + rows + "\n")


WRITERS = {
    "csv": lambda folder, name, t, x, force: put_csv(folder / f"{name}.csv", t, x, force),
    "npz": lambda folder, name, t, x, force: np.savez(folder / f"{name}.npz", t=t, pos=x, F=force),
    "bag": lambda folder, name, t, x, force: put_bag(folder / f"{name}.bag", t, x, force),
}


@pytest.fixture(scope="module", params=WRITERS)
def learned(request, tmp_path_factory):
    """(library, out, lines): three kinds of strokes, five of each, in one of the formats."""
    folder = tmp_path_factory.mktemp(request.param)
    for name, data in strokes():
        WRITERS[request.param](folder, name, *data)
    lines = learn.run([folder], folder / "out")
    return phri_learning.PrimitiveLibrary.from_json(str(folder / "out" / "library.json")), folder / "out", lines


def test_strokes_become_three_primitives_in_every_format(learned):
    library, out, lines = learned
    assert [library.node(node).count for node in library.upper_nodes] == [5, 5, 5]
    assert library.dimension == 6  # x, y with velocity and force: z does not move
    listed = pd.read_csv(out / "segments.csv")
    names = listed["demonstration"].map(lambda text: Path(text).stem.split("_")[0])
    assert (listed.groupby(names)["primitive"].nunique() == 1).all() and listed["primitive"].nunique() == 3
    assert library.successions()[1].sum() == 0  # files of their own follow nothing
    assert "in x, y (1 axis left out" in "\n".join(lines)


def test_a_partner_goes_on_with_the_library(learned):
    _, out, _ = learned
    learner = phri_learning.PrimitiveLearner.from_json(phri_learning.EmergingOptions(), str(out / "library.json"))
    assert len(learner.snapshot.nodes) == 3
    partner = phri_learning.EmergingPartner()
    partner.adopt(learner.snapshot)


def test_the_table_is_the_study_of_prediction_within_each_primitive(learned):
    library, out, _ = learned
    table, listed = pd.read_csv(out / "table.csv"), pd.read_csv(out / "segments.csv")
    table = table[table["kind"] == learn.PRIMITIVE]
    assert set(table["method"]) == set(learn.METHODS)
    data = dict(strokes())
    for node in library.upper_nodes:
        names = [Path(text).stem for text in listed[listed["primitive"] == node]["demonstration"]]
        demos = tuple(Demonstration(name, data[name][0], data[name][1][:, :2]) for name in names)
        expected = prediction.evaluate([Movement("m", demos)], methods=learn.METHODS)
        found = table[table["movement"] == f"primitive {node}"]
        assert found["error_mm"].to_numpy() == pytest.approx(expected["error_mm"].to_numpy(), rel=SAME_ERROR)
        assert found["coverage"].to_numpy() == pytest.approx(expected["coverage"].to_numpy(), nan_ok=True)


def test_what_was_written_is_there(learned):
    _, out, lines = learned
    names = {"library.json", "table.csv", "segments.csv", "library.png", "demonstrations.png", "session.yaml"}
    assert {path.name for path in out.iterdir()} == names
    assert all((out / name).stat().st_size > 0 for name in names)
    assert any("mean of primitives" in line for line in lines)


def test_a_bag_says_what_was_recorded(tmp_path):
    t, x, force = stroke(RIGHT, 1)
    (demo,), notes = bag_demonstrations.read(put_bag(tmp_path / "a.bag", t, x, force))
    assert demo.t == pytest.approx(t, abs=1e-6)
    assert demo.x == pytest.approx(x, abs=SAME) and demo.force == pytest.approx(force, abs=SAME)
    assert "both in frame 'base'" in notes[0]
    _, notes = bag_demonstrations.read(put_bag(tmp_path / "b.bag", t, x, force, frames=("base", "tool")))
    assert "as given in their frame 'tool', not rotated into the positions' 'base'" in notes[0]
    (demo,), _ = bag_demonstrations.read(tmp_path / "b.bag", wrench=bag_demonstrations.NONE)
    assert demo.force is None


def test_topics_are_found_by_type_or_named(tmp_path):
    t, x, force = stroke(RIGHT, 1)
    other = PoseStamped()
    path = put_bag(tmp_path / "two.bag", t, x, force, more=[("/goal", other), ("/cmd", Twist())])
    with pytest.raises(BagError, match=r"2 pose topics \(/goal, /pose\), name one by --pose") as error:
        bag_demonstrations.read(path)
    assert "/cmd (geometry_msgs/Twist)" in str(error.value)
    (demo,), _ = bag_demonstrations.read(path, pose="/pose")
    assert demo.x == pytest.approx(x, abs=SAME)
    with pytest.raises(BagError, match="no topic /posse; the bag holds /cmd"):
        bag_demonstrations.read(path, pose="/posse")
    with pytest.raises(BagError, match="/cmd is of type geometry_msgs/Twist, expected geometry_msgs/PoseStamped"):
        bag_demonstrations.read(path, pose="/cmd")
    with rosbag.Bag(str(tmp_path / "none.bag"), "w") as bag:
        bag.write("/cmd", Twist(), genpy.Time(1))
    with pytest.raises(BagError, match=r"no pose topic.*the bag holds /cmd \(geometry_msgs/Twist\)"):
        bag_demonstrations.read(tmp_path / "none.bag")


def test_numbers_that_are_none_and_topics_that_never_meet_are_refused(tmp_path):
    t, x, force = stroke(RIGHT, 1)
    x[40, 1] = np.nan
    with pytest.raises(BagError, match="topic /pose: a number at .* is not finite"):
        bag_demonstrations.read(put_bag(tmp_path / "nan.bag", t, x, force))
    put_csv(_folder(tmp_path / "nan") / "a.csv", t, x, force)
    with pytest.raises(DataError, match="sample 40 is not finite"):
        learn.gather([tmp_path / "nan"])
    t, x, force = stroke(RIGHT, 1)
    with rosbag.Bag(str(tmp_path / "apart.bag"), "w") as bag:
        for i, time in enumerate(t):
            pose, wrench = PoseStamped(), WrenchStamped()
            pose.header.stamp, wrench.header.stamp = genpy.Time.from_sec(1 + time), genpy.Time.from_sec(50 + time)
            bag.write("/pose", pose, genpy.Time(1))
            bag.write("/wrench", wrench, genpy.Time(1))
    with pytest.raises(BagError, match="0 poses of /pose while /wrench was recorded"):
        bag_demonstrations.read(tmp_path / "apart.bag")


def test_our_own_observations_are_cut_into_trials(tmp_path):
    observation = message_class("Observation")
    with rosbag.Bag(str(tmp_path / "own.bag"), "w") as bag:
        now = 0
        for samples in (100, 4, 80):
            for i in range(samples):
                now += 1
                message = observation(t=0.02 * i, state=[0.1 * i, 0.0, 5.0, 0.0], human_wrench=[1.0 * samples, 2.0],
                                      environment_wrench=[0.0, 0.0])  # fmt: skip
                bag.write("/phri/observation", message, genpy.Time(now))
    found, notes = bag_demonstrations.read(tmp_path / "own.bag")
    assert [len(demo.t) for demo in found] == [100, 80]
    assert found[0].x[10] == pytest.approx([1.0, 0.0]) and (found[0].force == [100.0, 2.0]).all()
    assert any("trial 2 has 4 observations" in note for note in notes)


def test_a_long_recording_is_cut_where_the_motion_changes(tmp_path):
    """Right and back, in turn: two kinds of primitives that follow each other."""
    x, forces = [np.zeros((1, 3))], [np.zeros((1, 3))]
    for i in range(12):
        _, moved, force = stroke(RIGHT if i % 2 == 0 else (-0.3, 0.0), 0, 3.0)
        x.append(x[-1][-1] + moved - moved[0])
        forces.append(force)
    x, forces = np.vstack(x), np.vstack(forces)
    np.savez(_folder(tmp_path / "long") / "a.npz", t=STEP * np.arange(len(x)), pos=x, F=forces)
    learn.run([tmp_path / "long"], tmp_path / "out", cut=True)
    listed = pd.read_csv(tmp_path / "out" / "segments.csv")
    length = STEP * len(x) / 12
    assert len(listed) >= 8
    # cuts lie at the turns: within the 24 samples of a window
    distance = (listed["start"] / length - (listed["start"] / length).round()).abs() * length
    assert distance.max() < 1.2
    library = phri_learning.PrimitiveLibrary.from_json(str(tmp_path / "out" / "library.json"))
    nodes, counts, _ = library.successions()
    assert len(nodes) == 2 and counts[0][1] > 0 and counts[1][0] > 0 and counts[0][0] == counts[1][1] == 0


def test_short_pieces_between_cuts_are_left_out_and_break_the_succession(monkeypatch):
    monkeypatch.setattr(learn.segmentation, "online", lambda v: [SimpleNamespace(index=i) for i in (15, 20, 30)])
    t, x, force = stroke(RIGHT, 0)
    found, short = learn.segments([Movement("m", (Demonstration("d", t, x, force),))], [0, 1], True)
    assert short == 1
    assert [part.follows for part in found] == [False, False, True]
    assert [part.start for part in found] == pytest.approx([0.0, 1.0, 1.5])
    assert [part.end for part in found] == pytest.approx([0.75, 1.5, t[-1]])
    assert [len(part.positions([0, 1]).t) for part in found] == [76, 51, len(t) - 150]


def _folder(path):
    path.mkdir()
    return path


def test_forces_are_means_and_velocities_exact_for_parabolas():
    t = 0.01 * np.arange(201)
    demo = Demonstration("d", t, np.stack([0.5 * t**2, 0.1 * t], axis=1), np.stack([t, 0 * t], axis=1))
    out = learn.samples(demo, [0, 1])
    at = learn.DT * np.arange(len(out))
    assert out[:, 2:4] == pytest.approx(np.stack([at, 0.1 + 0 * at], axis=1), abs=1e-9)
    assert out[1:, 4] == pytest.approx(at[1:] - learn.DT / 2, abs=1e-9)  # the mean of a ramp is half a step behind


@pytest.mark.parametrize("count, said", [(2, "2 segment"), (1, "1 segment")])
def test_too_few_demonstrations(tmp_path, count, said):
    for i in range(count):
        put_csv(tmp_path / f"{i}.csv", *stroke(RIGHT, i))
    with pytest.raises(DataError, match=f"{said}.* at least 3"):
        learn.run([tmp_path], tmp_path / "out")


def test_too_short_still_and_mixed_demonstrations(tmp_path):
    for i in range(3):
        t, x, force = stroke(RIGHT, i)
        put_csv(_folder(tmp_path / f"d{i}") / "a.csv", *(part[:30] for part in (t, x, force)))
    with pytest.raises(DataError, match="0.30 s long, expected at least 0.50 s"):
        learn.run([tmp_path / "d0"], tmp_path / "out")
    np.savez(tmp_path / "flat.npz", pos_0=x[:, :2], pos_1=x[:, :2], pos_2=x[:, :2], Ts=0.01)
    with pytest.raises(DataError, match="2 dimensions, expected 3"):
        learn.gather([tmp_path / "d0", tmp_path / "flat.npz"])
    np.savez(tmp_path / "bare.npz", pos_0=x, Ts=0.01)
    with pytest.raises(DataError, match="expected all demonstrations or none"):
        learn.gather([tmp_path / "d0", tmp_path / "bare.npz"])
    np.savez(tmp_path / "still.npz", pos_0=0 * x, Ts=0.01)
    with pytest.raises(DataError, match="nothing moves"):
        learn.run([tmp_path / "still.npz"], tmp_path / "out")
    with pytest.raises(UsageError, match="no bag is given"):
        learn.gather([tmp_path / "d0"], pose="/pose")
    with pytest.raises(MissingInputError):
        learn.gather([tmp_path / "absent"])


def test_exit_codes(tmp_path):
    t, x, force = stroke(RIGHT, 0)
    put_bag(tmp_path / "one.bag", t, x, force)
    put_csv(_folder(tmp_path / "csv") / "a.csv", t, x, force)
    for arguments, code, word in (
        (["learn"], 64, "DATA"),
        (["learn", tmp_path / "absent"], 66, "absent"),
        (["learn", tmp_path / "absent.bag"], 66, "absent"),
        (["learn", tmp_path / "csv", "--wrench", "/w"], 64, "no bag"),
        (["learn", tmp_path / "csv", "--cutoff", "1.5"], 64, "between 0 and 1"),
        (["learn", tmp_path / "one.bag", "--pose", "/x"], 65, "/pose (geometry_msgs/PoseStamped)"),
        (["learn", tmp_path / "one.bag"], 65, "1 segment"),
        (["study", "validation", "--data", tmp_path], 64, "takes no data"),
        (["study", "prediction", "--data", tmp_path / "absent"], 66, "absent"),
    ):
        result = subprocess.run([COMMAND, *arguments], capture_output=True, text=True)
        assert (result.returncode, result.stderr.count("\n")) == (code, 1), result.stderr
        assert word in result.stderr, result.stderr


def test_command_and_data_of_the_study(tmp_path):
    folder = _folder(tmp_path / "d")
    for name, data in strokes(3):
        WRITERS["csv"](folder, name, *data)
    result = subprocess.run([COMMAND, "learn", tmp_path / "d", "--out", tmp_path / "o"], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert "constant velocity [mm]" in result.stdout
    assert json.loads((tmp_path / "o" / "library.json").read_text())["schema"].startswith("phri_learning/Primitive")
    lines = studies.run("prediction", studies.Options(tmp_path / "s", data=tmp_path / "d"))
    assert "1 movement(s), 9 demonstrations" in "\n".join(lines)


def test_train_from_bag_is_the_same_command(tmp_path):
    program = COMMAND.parents[2] / "catkin_ws" / "src" / "phri_learning" / "nodes" / "train_from_bag"
    environment = {**os.environ, "PATH": f"{COMMAND.parent}:{os.environ['PATH']}"}
    result = subprocess.run([program, tmp_path / "no.bag"], capture_output=True, text=True, env=environment)
    assert result.returncode == 66 and "no.bag" in result.stderr, result.stderr
