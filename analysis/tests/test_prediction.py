"""The study of prediction: its measures on cases with a known answer, and the command on files of the user's."""

import numpy as np
import pandas as pd
import pytest
from test_demonstrations import write_lasa

from phri_analysis.errors import DataError, MissingInputError

pytest.importorskip("phri_learning", reason="the workspace is not built")
import studies  # noqa: E402
from phri_analysis import demonstrations  # noqa: E402
from phri_analysis.demonstrations import Demonstration, Movement  # noqa: E402
from studies import prediction  # noqa: E402


def arc(seed, samples=120):
    """A bow with an own pace, place and height, at rest at both ends [m]."""
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, int(samples * np.exp(0.1 * rng.normal())))
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    x = np.stack([0.2 * s, (0.1 + 0.01 * rng.normal()) * np.sin(np.pi * s)], axis=1)
    return x + 0.003 * rng.normal(size=2)


def movement(seeds, name="arc"):
    demos = [Demonstration(f"{name} {i}", prediction.DT * np.arange(len(x)), x) for i, x in
             ((i, arc(i)) for i in seeds)]  # fmt: skip
    return Movement(name, tuple(demos))


@pytest.fixture(scope="module")
def table():
    return prediction.evaluate([movement(range(6))])


def test_every_method_is_judged_on_the_same_samples(table):
    assert len(table) == 6 * len(prediction.METHODS) * len(prediction.HORIZONS)
    assert (table.groupby("held_out")["samples"].nunique() == 1).all()
    assert np.isfinite(table["error_mm"]).all()
    uncertain = table["method"].isin([prediction.DEFAULT, *prediction.THESIS])
    assert table.loc[uncertain, "coverage"].between(0.0, 1.0).all() and table.loc[~uncertain, "coverage"].isna().all()


def test_errors_grow_with_the_horizon_and_the_default_beats_constant_velocity(table):
    means = prediction.summary(table)["error_mm"].unstack("horizon")
    from_the_present = means.loc[[prediction.DEFAULT, prediction.VELOCITY, prediction.NEAREST]]
    assert (from_the_present.diff(axis=1).iloc[:, 1:] > 0.0).all(axis=None)
    assert means.loc[prediction.DEFAULT].iloc[-1] < 0.7 * means.loc[prediction.VELOCITY].iloc[-1]


def test_constant_velocity_misses_by_half_the_acceleration_times_time_squared():
    # x = a t^2 / 2 sampled: backward difference lags by dt / 2, hence a h (h + dt) / 2
    a, h = 0.4, 0.3
    t = prediction.DT * np.arange(100)
    parabola = Movement("p", tuple(Demonstration(f"p {i}", t, np.stack([a * t**2 / 2, 0 * t], 1)) for i in range(2)))
    table = prediction.evaluate([parabola])
    error = table[(table["method"] == prediction.VELOCITY) & (table["horizon"] == h)]["error_mm"]
    assert error.to_numpy() == pytest.approx(1e3 * a * h * (h + prediction.DT) / 2, rel=1e-9)
    # the two demonstrations are equal: a nearest sample is the sample itself, its neighbours are one sample off
    near = table[(table["method"] == prediction.NEAREST) & (table["horizon"] == h)]["error_mm"]
    assert near.max() < 1e3 * a * h * prediction.DT


def test_regions_hold_95_percent_of_gaussian_residuals():
    rng = np.random.default_rng(0)
    factor = np.array([[1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [-1.0, 0.3, 0.1]])
    residual = rng.normal(size=(20000, 3)) @ factor.T
    share = prediction.inside(residual, np.broadcast_to(factor @ factor.T, (20000, 3, 3))).mean()
    assert share == pytest.approx(0.95, abs=0.006)  # four standard errors


def test_summary_weighs_samples_within_and_movements_among_each_other():
    rows = [("a", 0, 10, 1.0, 0.9), ("a", 1, 30, 3.0, 1.0), ("b", 0, 5, 10.5, 0.5)]
    table = pd.DataFrame([
        {"movement": m, "held_out": e, "method": method, "horizon": 0.3, "samples": n, "error_mm": extra + error,
         "coverage": share}
        for m, e, n, error, share in rows
        for method, extra in ((prediction.DEFAULT, 0.0), (prediction.VELOCITY, 1.0))
    ])  # fmt: skip
    means = prediction.summary(table)
    default, other = means.loc[(prediction.DEFAULT, 0.3)], means.loc[(prediction.VELOCITY, 0.3)]
    assert default["error_mm"] == pytest.approx((2.5 + 10.5) / 2)
    assert default["coverage"] == pytest.approx((0.975 + 0.5) / 2)
    assert default["won"] == 0 and other["won"] == 2


def test_command_runs_on_a_folder_of_the_users(tmp_path, monkeypatch):
    folder = tmp_path / "lasa"
    folder.mkdir()
    for name in ("One", "Two"):
        write_lasa(folder / f"{name}.mat", count=3, unit=20.0)
    monkeypatch.setenv(prediction.VARIABLE, str(folder))
    lines = studies.run("prediction", studies.Options(tmp_path / "out"))
    text = "\n".join(lines)
    assert "2 movement(s), 6 demonstrations" in text
    assert all(method in text for method in prediction.METHODS)
    table = pd.read_csv(tmp_path / "out" / "table.csv")
    assert set(table["movement"]) == {"One", "Two"}
    assert (tmp_path / "out" / "session.yaml").is_file()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "5-NN" in page and "simulated" not in page  # recorded people
    monkeypatch.setenv(prediction.VARIABLE, str(tmp_path / "absent"))
    with pytest.raises(MissingInputError, match="absent"):
        studies.run("prediction", studies.Options(tmp_path / "out"))


def test_too_little_data_is_said():
    one = movement([0])
    with pytest.raises(DataError, match="at least 2"):
        prediction.evaluate([one])
    short = Movement("s", tuple(Demonstration(f"s {i}", prediction.DT * np.arange(20), arc(i)[:20]) for i in range(2)))
    with pytest.raises(DataError, match="s 0: 0.40 s long"):
        prediction.evaluate([short])


def test_on_real_recordings_the_default_beats_both_simple_predictors_and_its_regions_are_honest(monkeypatch):
    """0.3 s ahead, all six trials left out in turn."""
    monkeypatch.delenv(prediction.VARIABLE, raising=False)
    table = prediction.evaluate(demonstrations.load(prediction.source()))
    means = prediction.summary(table).xs(0.3, level="horizon")
    assert means.loc[prediction.DEFAULT, "error_mm"] < means.loc[prediction.VELOCITY, "error_mm"]
    assert means.loc[prediction.DEFAULT, "error_mm"] < 0.9 * means.loc[prediction.NEAREST, "error_mm"]
    assert means.loc[prediction.DEFAULT, "error_mm"] < 0.2 * means.loc["thesis (3.8) as printed", "error_mm"]
    assert 0.90 < means.loc[prediction.DEFAULT, "coverage"] < 0.98
