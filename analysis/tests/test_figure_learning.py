"""Figures 3.4 to 3.6, 5.2 and 5.3: synthetic people obey the object's equation, measures have known answers in limits,
findings follow the numbers."""

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("phri_learning", reason="the workspace is not built")
import phri_learning  # noqa: E402

import figures  # noqa: E402
from figures import _flower, _page, _primitives, time_hmm  # noqa: E402

FINE = 0.01  # [s]
REGION = 0.95
SHARE_ERROR = 0.01  # of 20000 draws, six standard errors


@pytest.fixture(scope="module")
def run():
    return _flower.person(3, 4)


def test_people_move_the_object_of_the_thesis():
    """Velocity and force are the derivatives of the place: what the object integrates is what the person did."""
    fine = _flower.person(3, 2, dt=FINE).samples
    x, v, force = fine[:, :2], fine[:, 2:4], fine[:, 4:]
    # central differences of pieces of cubics err at their knots, by at most FINE times a jump of the third derivative
    assert np.abs((x[2:] - x[:-2]) / (2 * FINE) - v[1:-1]).max() < 1e-3
    impulse = FINE * (force[1:] + force[:-1]) / 2 - _flower.DAMPING * np.diff(x, axis=0)
    momentum = _flower.MASS * np.diff(v, axis=0)
    assert impulse.sum(axis=0) == pytest.approx(momentum.sum(axis=0), abs=1e-2)
    assert np.abs(impulse - momentum).max() < 1e-2 * np.abs(momentum).max()


def test_people_go_through_all_parts_in_order_and_differ(run):
    order = run.part[np.concatenate([[True], np.diff(run.part) != 0])]
    assert list(order) == [0, 1, 2, 3, 4] * 4
    assert [len(run.pieces(part)) for part in range(5)] == [4] * 5
    again, other = _flower.person(3, 4), _flower.person(4, 4)
    assert (again.samples == run.samples).all()
    assert len(other.samples) != len(run.samples)


def test_region_share_is_that_of_gaussians():
    rng = np.random.default_rng(0)
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    mean = rng.normal(size=(20000, 2))
    drawn = mean + rng.normal(size=(20000, 2)) @ np.linalg.cholesky(covariance).T
    tensor = np.broadcast_to(covariance, (20000, 2, 2))
    assert time_hmm._inside([drawn], mean, tensor) == pytest.approx(REGION, abs=SHARE_ERROR)
    assert time_hmm._inside([drawn], mean, 0.25 * tensor) < 0.6


def test_while_nothing_is_known_the_error_is_the_way_to_come():
    found = _primitives.online(3, 4)
    x = _flower.person(3, 4).samples[:, :2]
    way = np.linalg.norm(x[_primitives.STEPS:] - x[: -_primitives.STEPS], axis=1)
    first = found["repetition"] == 1
    assert not found["predicted"][first].any() and found["primitives"][0] == 0
    assert found["error"][~found["predicted"]] == pytest.approx(way[~found["predicted"]], abs=1e-12)
    assert found["primitives"][-1] > 0 and found["predicted"][found["repetition"] == 4].mean() > 0.5
    # displacement form: what is learned is better than to stand still
    better = _primitives.online(3, 4, "displacement")
    last = better["repetition"] == 4
    assert better["error"][last].mean() < 0.7 * way[last].mean()


def test_window_helps_at_transitions_and_errors_are_against_the_later_place(run):
    learner = _primitives.taught(run, 3)
    assert len(learner.snapshot.nodes) == 5
    found = _primitives.followed(learner, run, 4)
    mine = np.flatnonzero(run.repetition == 4)[: len(found["t"])]
    assert (found["ahead"] == run.samples[mine + 6, :2]).all() and (found["x"] == run.samples[mine, :2]).all()
    error = {way: np.linalg.norm(found[way] - found["ahead"], axis=1) for way in ("own", "window")}
    assert error["window"].mean() < error["own"].mean()


def test_pages_are_pages(tmp_path):
    for name in ("3.4", "3.5"):
        page = time_hmm.page(name, figures.Options())
        folder = _page.write(page, tmp_path)
        data = pd.read_csv(folder / "data.csv")
        assert len(data) == len(page.data) and (folder / "figure.png").stat().st_size > 10000
        assert all(line.startswith(("holds: ", "MISS: ", "Not in the thesis: ")) for line in page.findings)
    table = time_hmm.page("3.4", figures.Options()).tables["smoothness"]
    train = _flower.person(time_hmm.SUBJECT, time_hmm.REPETITIONS).pieces(time_hmm.PART)[: -time_hmm.HELD_OUT]
    model = phri_learning.TimeHmm(10, dt=0.05).fit(train)
    mean, _ = model.regress(np.arange(0.0, model.length_, 0.05))
    step = 1e3 * np.linalg.norm(np.diff(mean[:, :2], axis=0), axis=1).max()
    assert table["largest_step_mm"].iloc[0] == pytest.approx(step, rel=1e-9)


def test_learning_page_of_few(tmp_path):
    page = time_hmm._learning(figures.Options(), people=2, repetitions=4)
    assert len(page.data) == 2 * 2 * 4
    one = page.data[(page.data["person"] == 2) & (page.data["reference"] == "path")]
    expected = _primitives.online(2, 4)
    for k, error, square in zip(one["repetition"], one["error_mm"], one["mse_mm2"]):
        mine = expected["error"][expected["repetition"] == k]
        assert error == pytest.approx(1e3 * mine.mean()) and square == pytest.approx(1e6 * (mine**2).mean())
    _page.write(page, tmp_path)


class Experiment:
    trials, assistance_off, seed = 20, (16, 17, 18), 7


def study_table(sign):
    """Two participants; with `sign` 1 all trends of the thesis, with -1 their opposites."""
    rows = []
    for condition in ("self-paced", "paced"):
        strength = 1.0 if condition == "self-paced" else 2.0
        for person in (0, 1):
            for trial in range(1, 21):
                helped = min(trial, 9) / 9.0 * (trial not in Experiment.assistance_off)
                late = max(trial - 9, 0) * (trial not in Experiment.assistance_off) * (condition == "self-paced")
                rows.append({
                    "condition": condition, "participant": person, "trial": trial, "seed": 1, "completed": True,
                    "assisted": trial not in Experiment.assistance_off, "primitives": 5, "predicted": 1.0,
                    "prediction_error": 0.02 - sign * 0.0005 * trial,
                    "human_force": 6.0 - sign * strength * helped + sign * 0.05 * late,
                    "completion_time": 28.0 - sign * (3.0 * helped + 0.1 * late) * (condition == "self-paced"),
                })  # fmt: skip
    return pd.DataFrame(rows)


@pytest.mark.parametrize("sign", [1, -1])
def test_findings_of_emerging_assistance_follow_the_table(monkeypatch, sign, tmp_path):
    emerging = pytest.importorskip("figures.emerging")
    monkeypatch.setattr(emerging, "_measured", lambda jobs: (study_table(sign), Experiment))
    for name in emerging.IDS:
        page = emerging.page(name, figures.Options())
        verdicts = [line.partition(":")[0] for line in page.findings if line.startswith(("holds", "MISS"))]
        recovered = ["recovered" in line for line in page.findings][: len(verdicts)]
        expected = "holds" if sign > 0 else "MISS"
        assert all(verdict == expected for verdict, either in zip(verdicts, recovered) if not either), page.findings
        assert len(verdicts) >= 4
        assert set(page.data["condition"]) == {emerging.CONDITIONS[name]}
        _page.write(page, tmp_path)
