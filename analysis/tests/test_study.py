import numpy as np
import pandas as pd
import pytest

import synthetic
from phri_analysis import metrics, study
from phri_analysis.errors import DataError, OutputError


def trials():
    return [
        synthetic.constant_trial(
            human=(force, 0.0), participant=participant, controller=controller, trial=trial, evaluated=trial == 2
        )
        for participant, controller, trial, force in [
            (1, "none", 1, 100.0),
            (1, "none", 2, 10.0),
            (2, "none", 2, 14.0),
            (10, "none", 2, 12.0),
            (1, "lqr", 2, 6.0),
            (2, "lqr", 2, 8.0),
        ]
    ]


def test_the_table_does_not_depend_on_the_order_of_the_trials():
    table = study.study_table(trials())
    assert table.equals(study.study_table(list(reversed(trials()))))
    assert list(table["subtask"][:3]) == ["whole", "MO", "NC"]
    whole = table[table["subtask"] == "whole"]
    assert list(zip(whole["participant"], whole["controller"], whole["trial"])) == [
        (1, "none", 1),
        (1, "none", 2),
        (1, "lqr", 2),
        (2, "none", 2),
        (2, "lqr", 2),
        (10, "none", 2),
    ]
    assert list(table.columns[: len(study.KEYS)]) == list(study.KEYS)
    assert set(metrics.MEASURES) <= set(table.columns)


def test_controllers_are_compared_over_participants_on_evaluated_trials_only():
    summary = study.per_controller(study.study_table(trials()))
    assert list(summary) == ["none", "lqr"]
    row = summary["none"].loc["human_force"]
    assert (row["mean"], row["sd"], row["n"]) == pytest.approx((12.0, 2.0, 3))  # 10, 14, 12; never the 100 N of trial 1
    assert row["se"] == pytest.approx(2.0 / np.sqrt(3))


def test_each_participant_counts_once_however_many_trials():
    extra = synthetic.constant_trial(human=(30.0, 0.0), participant=1, controller="none", trial=3)
    summary = study.per_controller(study.study_table([*trials(), extra]))
    assert summary["none"].loc["human_force", "mean"] == pytest.approx((20 + 14 + 12) / 3)


def test_one_participant_has_no_spread():
    summary = study.per_controller(study.study_table(trials()[1:2]))["none"].loc["human_force"]
    assert summary["mean"] == pytest.approx(10.0) and np.isnan(summary["sd"])


def test_without_a_marked_trial_all_count():
    table = study.study_table([synthetic.constant_trial(evaluated=False)])
    assert len(study.judged(table)) == len(table) == 3


def test_tables_are_equal_to_the_byte_and_read_back_to_the_bit(tmp_path):
    random = np.random.default_rng(3)
    table = study.study_table(
        [synthetic.predict(synthetic.constant_trial(human=random.normal(0, 10, 2)), (1e-3, 1 / 3e4))]
    )
    study.write_table(table, tmp_path / "new" / "a.csv")
    study.write_table(table.copy(), tmp_path / "b.csv")
    written = (tmp_path / "new" / "a.csv").read_bytes()
    assert written == (tmp_path / "b.csv").read_bytes() and b"\r" not in written
    read = study.read_table(tmp_path / "b.csv")
    assert list(read.columns) == list(table.columns)
    for name in metrics.MEASURES:
        assert read[name].to_numpy(dtype=float).tobytes() == table[name].to_numpy(dtype=float).tobytes(), name
    assert read["evaluated"].dtype == bool and list(read["controller"]) == list(table["controller"])


def test_a_controller_called_like_a_missing_value_survives(tmp_path):
    for name in ("NA", "null", "none"):
        study.write_table(study.study_table([synthetic.constant_trial(controller=name)]), tmp_path / "a.csv")
        assert set(study.read_table(tmp_path / "a.csv")["controller"]) == {name}


def test_a_table_that_cannot_be_written_says_where(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file/a.csv"):
        study.write_table(study.study_table(trials()[:1]), tmp_path / "file" / "a.csv")


def test_limits_seen_in_some_trials_only_are_zero_in_the_others(unknown_limits):
    limited = synthetic.constant_trial(participant=2)
    limited["limits"] = 8
    table = study.study_table([synthetic.constant_trial(), limited])
    assert list(table["limited_bit_3"][table["subtask"] == "whole"]) == [0.0, 1.0]


def test_merged_parts_equal_the_whole():
    whole, left, right = study.Study(), study.Study(), study.Study()
    for i, trial in enumerate(trials()):
        whole.add(trial)
        (left, right)[i % 2].add(trial)
    right.merge(left)
    assert right.table().equals(whole.table())
    assert {name: (t.attrs["participant"], t.attrs["trial"]) for name, t in right.examples.items()} == {
        "none": (1, 2),
        "lqr": (1, 2),
    }
    for one, other in zip(right.shown_tracks(), whole.shown_tracks(), strict=True):
        pd.testing.assert_frame_equal(one, other)


def test_nothing_to_tabulate_is_an_error():
    with pytest.raises(DataError, match="at least one"):
        study.Study().table()
