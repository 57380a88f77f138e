import numpy as np
import pytest
import rosbag
from std_msgs.msg import String

import bag_writer
import synthetic
from phri_analysis import bags
from phri_analysis.errors import BagError, MissingInputError


@pytest.fixture
def table():
    trial = synthetic.plausible_trial().iloc[:400].reset_index(drop=True)
    # Exact in binary, so that the writer's horizon / steps times steps is the same double again.
    trial["prediction_horizon"] = 20 * 2.0**-7
    trial.attrs = synthetic.plausible_trial().attrs
    return trial


def test_a_bag_gives_the_table_back_bit_for_bit(table, tmp_path):
    read = bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag"))
    assert list(read.columns) == list(table.columns) and list(read.dtypes) == list(table.dtypes)
    for name in table.columns:
        assert read[name].to_numpy().tobytes() == table[name].to_numpy().tobytes(), name
    assert read.attrs == table.attrs


def test_a_trial_without_predictions_can_be_read(table, tmp_path):
    table.loc[:, [name for name in table if name.startswith("prediction_")]] = np.nan
    assert bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag"))["prediction_t0"].isna().all()


def test_joints_are_found_by_name_not_by_order(table, tmp_path):
    def swap(topic, row, message):
        if topic == "joint_states":
            for name in ("name", "position", "velocity"):
                setattr(message, name, list(reversed(getattr(message, name))))
        return message

    read = bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag", change=swap))
    assert read[["x", "y", "vx", "vy"]].equals(table[["x", "y", "vx", "vy"]])


def refused(path, *words):
    with pytest.raises(BagError) as error:
        bags.read_trial(path)
    text = str(error.value)
    assert "\n" not in text and all(word in text for word in [str(path), *words]), text


@pytest.mark.parametrize("topic", ["human_wrench", "joint_states", "experiment_node/tick", "metadata"])
def test_a_missing_topic_is_named(table, tmp_path, topic):
    refused(
        bag_writer.write_bag(table, tmp_path / "a.bag", omit=[topic]),
        f"/phri/{topic}",
        "missing",
        "/phri/assistance_wrench",
    )


@pytest.mark.parametrize(
    "topic, field, column", [("human_wrench", "wrench.force.x", "human_x"), ("experiment_node/tick", "tank", "tank")]
)
def test_nan_is_refused_with_topic_and_time(table, tmp_path, topic, field, column):
    def spoil(name, row, message):
        if name == topic and row == 7:
            *path, last = field.split(".")
            owner = message
            for part in path:
                owner = getattr(owner, part)
            setattr(owner, last, float("nan"))
        return message

    refused(
        bag_writer.write_bag(table, tmp_path / "a.bag", change=spoil), f"/phri/{topic}", f"{column} is nan", "1.007 s"
    )


def test_nan_in_a_prediction_is_refused(table, tmp_path):
    table.loc[20:39, "prediction_xx"] = np.nan
    refused(bag_writer.write_bag(table, tmp_path / "a.bag"), "/phri/prediction/time_hmm", "0.02 s", "not finite")


@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_a_truncated_bag_is_refused(table, tmp_path, share):
    path = bag_writer.write_bag(table, tmp_path / "a.bag")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(path)


def test_a_bag_whose_recorder_was_killed_says_so(table, tmp_path):
    path = tmp_path / "a.bag"
    with rosbag.Bag(str(path), "w") as bag:
        bag.write("/phri/metadata", String("{}"))
        bag.flush()
        path.with_name("b.bag").write_bytes(path.read_bytes())  # as left on the disk: no index yet
    refused(path.with_name("b.bag"), "no index", "phri-analysis recover")


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "a.bag"
    path.write_bytes(b"not a bag at all")
    refused(path, "not a readable ROS bag", "b'not a bag at ', expected b'#ROSBAG V2.0")
    path.write_bytes(b"")
    refused(path, "not a readable ROS bag")


@pytest.mark.parametrize(
    "metadata, words",
    [
        ("{", ["not JSON"]),
        ("[1]", ["list", "expected an object"]),
        ('{"participant": 1}', ["attribute controller is None"]),
    ],
)
def test_bad_metadata_is_refused(table, tmp_path, metadata, words):
    refused(bag_writer.write_bag(table, tmp_path / "a.bag", metadata=metadata), *words)


def test_a_wrong_type_is_named(table, tmp_path):
    path = bag_writer.write_bag(table, tmp_path / "a.bag", omit=["human_wrench"], digest_every=0)
    with rosbag.Bag(str(path), "a") as bag:
        bag.write("/phri/human_wrench", String("pushes"))
    refused(path, "/phri/human_wrench", "std_msgs/String", "expected geometry_msgs/WrenchStamped")


def test_few_lost_messages_are_counted_and_many_refused(table, tmp_path):
    few = [("human_wrench", 10), ("joint_states", 11), ("joint_states", 10)]
    read = bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag", drop=few))
    assert read.attrs["dropped_ticks"] == 2
    kept = table.drop(index=[10, 11]).reset_index(drop=True)
    assert read.equals(kept)
    many = [("human_wrench", row) for row in range(5)]
    refused(
        bag_writer.write_bag(table, tmp_path / "b.bag", drop=many), "5 of 400 ticks", "at most 1%", "human_wrench 395"
    )


def test_the_prediction_in_use_is_chosen_among_models(table, tmp_path):
    path = bag_writer.write_bag(table, tmp_path / "a.bag", model="other", digest_every=0)

    def double(topic, row, message):
        if topic.startswith("prediction/"):
            message.mean = [2 * value for value in message.mean]
        return message

    table.attrs["model"] = "time_hmm"
    both = bag_writer.write_bag(table, tmp_path / "b.bag", change=double, digest_every=0)
    for target, source in ((path, both), (both, path)):
        with rosbag.Bag(str(target), "a") as bag, rosbag.Bag(str(source)) as second:
            for topic, message, stamp in second.read_messages():
                if "/prediction/" in topic and topic not in bag.get_type_and_topic_info().topics:
                    bag.write(topic, message, stamp)
    assert bags.read_trial(both)["prediction_x"].equals(2 * table["prediction_x"])
    refused(path, "attribute model is None", "/phri/prediction/other, /phri/prediction/time_hmm")


def test_a_model_that_cannot_tell_changes_nothing(table, tmp_path):
    def silence(topic, row, message):
        if topic.startswith("prediction/") and row in (0, 100):
            message.mean, message.covariance = [], []
        return message

    read = bags.read_trial(bag_writer.write_bag(table, tmp_path / "a.bag", change=silence))
    assert read["prediction_x"][:20].isna().all() and read["prediction_x"][20:100].equals(table["prediction_x"][20:100])
    assert (read["prediction_x"][100:120] == table["prediction_x"][99]).all()
    assert read["prediction_x"][120:].equals(table["prediction_x"][120:])


def test_bags_are_found_in_folders(tmp_path):
    (tmp_path / "s" / "t").mkdir(parents=True)
    for name in ("b.bag", "s/a.bag", "s/t/c.bag", "s/t/d.bag.active", "e.txt"):
        (tmp_path / name).touch()
    found = bags.find_bags([tmp_path, tmp_path / "b.bag"])
    assert [str(path.relative_to(tmp_path)) for path in found] == ["b.bag", "s/a.bag", "s/t/c.bag"]
    (tmp_path / "s" / "t" / "c.bag").unlink()
    with pytest.raises(MissingInputError, match="d.bag.active was cut off"):
        bags.find_bags([tmp_path / "s" / "t"])
    with pytest.raises(MissingInputError, match="nowhere"):
        bags.find_bags([tmp_path / "nowhere"])
