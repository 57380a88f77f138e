import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import synthetic
from phri_analysis import metrics

EXACT = 1e-12  # relative; sums of a thousand doubles


def measures(trial, subtask="whole"):
    return next(row for row in metrics.evaluate(trial) if row["subtask"] == subtask)


def test_constant_force_and_velocity_give_their_product_as_power():
    row = measures(synthetic.constant_trial(human=(3.0, 4.0), velocity=(-0.05, 0.1), environment=(0.0, -2.0)))
    assert row["human_force"] == pytest.approx(5.0, rel=EXACT)
    assert row["human_power"] == pytest.approx(3.0 * -0.05 + 4.0 * 0.1, rel=EXACT)
    assert row["collision_force"] == pytest.approx(2.0, rel=EXACT)
    assert row["contact_force"] == pytest.approx(2.0, rel=EXACT)
    assert row["completion_time"] == pytest.approx(1.0, rel=EXACT)


def test_braking_makes_negative_power():
    assert measures(synthetic.constant_trial(human=(-2.0, 0.0), velocity=(0.1, 0.0)))["human_power"] == pytest.approx(
        -0.2
    )


@pytest.mark.parametrize(
    "human, assistance, expected",
    [
        ((2.0, 0.0), (5.0, 0.0), 0.0),  # aligned
        ((2.0, 0.0), (-5.0, 0.0), 5.0),  # opposed: |u_r|, however small |u_h|
        ((1e-6, 0.0), (-5.0, 0.0), 5.0),
        ((0.0, 3.0), (-5.0, 0.0), 0.0),  # orthogonal
        ((1.0, 1.0), (-5.0, 0.0), 5.0 / np.sqrt(2.0)),  # only the part against the human
        ((0.0, 0.0), (-5.0, 0.0), 0.0),  # no human force, no disagreement
    ],
)
def test_disagreement_is_the_part_of_the_assistance_against_the_human(human, assistance, expected):
    row = measures(synthetic.constant_trial(human=human, assistance=assistance))
    assert row["disagreement"] == pytest.approx(expected, abs=EXACT)
    assert row["assistance_force"] == pytest.approx(np.hypot(*assistance), abs=EXACT)


def test_means_are_left_rectangle_sums():
    trial = synthetic.constant_trial(ticks=4)
    trial["human_x"] = [1.0, 2.0, 6.0, 1000.0]  # the last tick ends the trial and has no interval
    assert measures(trial)["human_force"] == pytest.approx(3.0, rel=EXACT)


def test_a_dropped_tick_weighs_its_neighbour_more():
    trial = synthetic.constant_trial(ticks=5)
    trial["human_x"] = [1.0, 1.0, 4.0, 4.0, 4.0]
    whole = measures(trial)["human_force"]
    thin = trial.drop(index=1).reset_index(drop=True)
    thin.attrs = trial.attrs
    assert measures(thin)["human_force"] == pytest.approx(whole, rel=EXACT)


def test_subtasks_split_where_x_first_falls_below_the_turning_point():
    # From x = 0.1 m at -0.2 m/s: at -0.04 m after 0.7 s; the first tick below it is the one at 0.701 s.
    trial = synthetic.constant_trial(velocity=(-0.2, 0.0), human=(1.0, 0.0), start=(0.1001, 0.0))
    assert measures(trial, "MO")["completion_time"] == pytest.approx(0.701, rel=1e-9)
    assert measures(trial, "NC")["completion_time"] == pytest.approx(0.299, rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.2, 0.2))
def test_means_of_the_subtasks_add_up_to_the_whole(seed, turning_point):
    random = np.random.default_rng(seed)
    trial = synthetic.constant_trial(ticks=300, turning_point_x=turning_point)
    for name in ("human_x", "human_y", "vx", "vy", "assistance_x", "assistance_y", "environment_x"):
        trial[name] = random.normal(0, 3, 300)
    trial["x"] = np.linspace(0.15, -0.15, 300) + random.normal(0, 0.01, 300)
    trial["t"] = np.cumsum(random.uniform(0.5e-3, 2e-3, 300))
    parts = metrics.windows(trial)
    rows = {row["subtask"]: row for row in metrics.evaluate(trial)}
    for name in ("human_force", "human_power", "disagreement", "collision_force"):
        total = sum(rows[part][name] * parts[part].duration for part in ("MO", "NC") if parts[part].duration > 0)
        assert total == pytest.approx(rows["whole"][name] * parts["whole"].duration, rel=1e-9, abs=1e-12)
    assert 0 <= rows["whole"]["disagreement"] <= rows["whole"]["assistance_force"]
    assert abs(rows["whole"]["human_power"]) <= np.max(np.hypot(trial["human_x"], trial["human_y"])) * np.max(
        np.hypot(trial["vx"], trial["vy"])
    )


def test_an_empty_subtask_and_a_single_tick_give_nan():
    never = synthetic.predict(synthetic.constant_trial(human=(1.0, 0.0)))  # stays at x = 0.1 m
    row = measures(never, "NC")
    assert all(np.isnan(row[name]) for name in metrics.MEASURES)
    assert row["limited"] is False
    assert measures(never, "MO")["human_force"] == pytest.approx(1.0)
    assert np.isnan(measures(never, "MO")["completion_time"])  # MO ends at the turning point, which never came
    single = measures(synthetic.constant_trial(ticks=1, human=(1.0, 0.0)))
    assert all(np.isnan(single[name]) for name in metrics.MEASURES)


def test_an_unfinished_trial_has_no_completion_time_but_other_measures():
    trial = synthetic.constant_trial(velocity=(-0.2, 0.0), human=(1.0, 0.0), completed=False)
    assert np.isnan(measures(trial)["completion_time"]) and np.isnan(measures(trial, "NC")["completion_time"])
    assert measures(trial)["human_force"] == pytest.approx(1.0)
    assert measures(trial, "MO")["completion_time"] > 0


def test_a_task_without_a_turning_point_has_no_subtasks():
    trial = synthetic.constant_trial()
    del trial.attrs["turning_point_x"]
    assert [row["subtask"] for row in metrics.evaluate(trial)] == ["whole"]


def contact_trial(*episodes):
    trial = synthetic.constant_trial(ticks=1001)
    for first, last in episodes:
        trial.loc[first : last - 1, "environment_x"] = 1.0
    return trial


@pytest.mark.parametrize(
    "episodes, expected",
    [
        ([], 0),
        ([(100, 101)], 1),
        ([(100, 150), (249, 300)], 1),  # released for 99 ms: the same collision
        ([(100, 150), (250, 300)], 2),  # for 100 ms: another
        ([(0, 10), (500, 600), (900, 1001)], 3),
    ],
)
def test_contacts_are_counted_by_episode(episodes, expected):
    assert measures(contact_trial(*episodes))["collision_count"] == expected


def test_noise_below_the_contact_force_is_no_collision():
    row = measures(synthetic.constant_trial(environment=(0.5 * metrics.CONTACT_FORCE, 0.0)))
    assert row["collision_count"] == 0 and np.isnan(row["contact_force"]) and row["collision_force"] > 0


def test_collision_force_counts_free_time_and_force_in_contact_does_not():
    row = measures(contact_trial((200, 450)))
    assert row["collision_force"] == pytest.approx(0.25) and row["contact_force"] == pytest.approx(1.0)


def test_prediction_error_by_hand():
    trial = synthetic.predict(synthetic.constant_trial(velocity=(0.1, 0.02)), error=(3e-3, 4e-3))
    row = measures(trial)
    assert row["prediction_error"] == pytest.approx(5e-3) and row["prediction_rmse"] == pytest.approx(5e-3)
    assert row["prediction_coverage_95"] == 0.0
    assert measures(synthetic.predict(synthetic.constant_trial(), error=(1e-3, 1e-3)))["prediction_coverage_95"] == 1.0


def test_rmse_weighs_large_errors_more_than_the_mean():
    error = np.zeros((51, 2))
    error[::2, 0] = 2e-3  # predictions that can be checked: 0..40, of which 21 are off by 2 mm
    row = measures(synthetic.predict(synthetic.constant_trial(), error=error))
    assert row["prediction_error"] == pytest.approx(2e-3 * 21 / 41)
    assert row["prediction_rmse"] == pytest.approx(2e-3 * np.sqrt(21 / 41))


def test_coverage_of_errors_drawn_from_the_belief_is_95_percent():
    # Where the belief is the truth the share inside is binomial(n, 0.95) / n, which
    # leaves 4 standard deviations once in 16000.
    covariance = np.array([[9e-6, 4e-6], [4e-6, 3e-6]])
    ticks = 60_001
    drawn = np.random.default_rng(5).multivariate_normal([0, 0], covariance, -(-ticks // synthetic.PERIOD))
    row = measures(synthetic.predict(synthetic.constant_trial(ticks), drawn, covariance))
    bound = 4 * np.sqrt(0.95 * 0.05 / (ticks // synthetic.PERIOD - 10))
    assert row["prediction_coverage_95"] == pytest.approx(0.95, abs=bound)


def test_every_prediction_belongs_to_one_subtask():
    trial = synthetic.predict(synthetic.constant_trial(velocity=(-0.2, 0.0)), error=(1e-3, 0.0))
    counts = {name: len(window.predictions) for name, window in metrics.windows(trial).items()}
    assert counts["MO"] + counts["NC"] == counts["whole"] == 41


def test_tracking_rmse_against_a_known_trajectory():
    trial = synthetic.constant_trial(velocity=(0.1, 0.0), start=(0.0, 0.003), desired_path=[[0, 0, 0], [1, 0.1, 0.0]])
    assert measures(trial)["tracking_rmse"] == pytest.approx(0.003)
    assert np.isnan(measures(synthetic.constant_trial())["tracking_rmse"])


def limited_trial(bits, share):
    trial = synthetic.constant_trial(ticks=1001)
    trial["limits"] = np.where(np.arange(1001) < 1000 * share, bits, 0)
    return trial


@pytest.mark.parametrize(
    "bits, share, marked", [(0b0010, 0.051, True), (0b0010, 0.05, False), (0b0001, 0.5, False)]
)  # bit 0 limits the sensor, not the assistance
def test_share_of_time_at_limits(known_limits, bits, share, marked):
    row = measures(limited_trial(bits, share))
    shares = [row[f"limited_{name}"] for name in known_limits]
    assert shares == pytest.approx([share if bits >> bit & 1 else 0.0 for bit in range(4)])
    assert row["limited"] is marked


def test_limits_without_the_library_keep_their_bit_number(unknown_limits):
    row = measures(limited_trial(0b100000, 0.3))
    assert row["limited_bit_5"] == pytest.approx(0.3) and row["limited"] is True


def test_every_measure_says_what_it_is():
    for name, entry in metrics.MEASURES.items():
        assert entry.name == name and entry.label and entry.unit and entry.source and len(entry.description) > 30
