"""The Python surface of the default predictor."""
import numpy as np
import pytest

import phri_core
import phri_learning
from phri_learning import DisplacementMixture

DT = 0.02  # [s]


def movements(seed, count, dimension=2):
    """Smooth curves with an own pace and an own offset each, (T, dimension)."""
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(count):
        u = np.linspace(0.0, 1.0, int(150 * np.exp(0.1 * rng.normal())))
        s = u + 0.1 * rng.normal() * np.sin(2 * np.pi * u) / 2
        result.append(np.stack([np.sin((2 + j) * s + j) + 0.02 * rng.normal() for j in range(dimension)], axis=1))
    return result


@pytest.fixture(scope='module')
def fitted():
    return DisplacementMixture(axes=2, dt=DT).fit(movements(1, 5))


def test_follow_is_observe_and_forecast_from_the_start(fitted):
    x = movements(2, 1)[0]
    means, covariances = fitted.follow(x, 0.3)
    fitted.reset()
    for t in range(60):
        fitted.observe(x[t])
        mean, covariance = fitted.forecast(0.3)
        assert np.array_equal(mean, means[t]) and np.array_equal(covariance, covariances[t])
    assert sum(fitted.weights(0.3)) == pytest.approx(1.0, abs=1e-12)
    again, _ = fitted.follow(x, 0.3)  # a movement of its own, undisturbed by the one observed
    assert np.array_equal(again, means)


@pytest.mark.parametrize('dimension', [1, 2, 3])
def test_predicts_better_than_constant_velocity_in_any_dimension(dimension):
    model = DisplacementMixture(axes=dimension, dt=DT).fit(movements(3, 6, dimension))
    ours, straight, inside = [], [], []
    for x in movements(4, 6, dimension):
        means, covariances = model.follow(x, 0.3)
        assert covariances.shape == (len(x), dimension, dimension)
        for t in range(10, len(x) - 15):
            e = means[t] - x[t + 15]
            ours.append(np.linalg.norm(e))
            straight.append(np.linalg.norm(x[t] + 15 * (x[t] - x[t - 1]) - x[t + 15]))
            inside.append(e @ np.linalg.solve(covariances[t], e) / dimension)
    assert np.mean(ours) < 0.6 * np.mean(straight)
    assert 0.2 < np.mean(inside) < 2.0  # squared errors in units of what was promised


def test_unfitted_and_bad_use_says_what_to_do(fitted):
    for use in (lambda m: m.observe([0.0, 0.0]), lambda m: m.forecast(0.1), lambda m: m.follow(np.zeros((3, 2)), 0.1),
                lambda m: m.length_, lambda m: phri_learning.DisplacementModel(m)):
        with pytest.raises(ValueError, match='fit'):
            use(DisplacementMixture())
    fitted.reset()
    for horizon in (-0.1, 0.5, float('nan')):
        with pytest.raises(ValueError, match='horizon'):
            fitted.follow(np.zeros((3, 2)), horizon)
    with pytest.raises(ValueError, match='no sample'):
        fitted.forecast(0.1)
    with pytest.raises(ValueError, match='no sample'):
        fitted.weights(0.1)
    with pytest.raises(ValueError, match='demonstration 0'):
        DisplacementMixture(axes=2).fit([np.zeros((100, 3))])
    with pytest.raises(ValueError, match='longest'):
        DisplacementMixture(axes=2).fit([np.zeros((9, 2))])


def test_behaviour_model_predicts_motion_and_wrench():
    trials = [[phri_core.Observation(t * DT, np.concatenate([p, v]), 150.0 * v)
               for t, (p, v) in enumerate(zip(x, np.gradient(x, DT, axis=0)))] for x in movements(5, 4)]
    rows = [phri_learning.demonstration(trial) for trial in trials]
    model = phri_learning.DisplacementModel(DisplacementMixture(axes=2, dt=DT).fit(rows[:3]))
    assert isinstance(model, phri_core.BehaviorModel)
    assert model.predict(0.3, DT) is None
    for t in range(60):
        model.observe(trials[3][t])
    prediction = model.predict(0.3, DT)
    assert len(prediction.desired_state) == len(prediction.human_wrench) == 16
    assert prediction.model == 'displacement'
    error = [np.linalg.norm(g.mean[:2] - rows[3][59 + k, :2]) for k, g in enumerate(prediction.desired_state)]
    moved = np.linalg.norm(rows[3][74, :2] - rows[3][59, :2])
    assert error[0] == 0.0 and error[15] < 0.3 * moved
