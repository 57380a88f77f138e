"""The Python surface of the time-based HMM, and its accuracy on real recordings."""
import json
import os

import numpy as np
import pytest

import phri_core
import phri_learning
from phri_learning import ModelFileError, TimeHmm

DT = 0.02  # [s]
DATA = os.path.join(os.path.dirname(__file__), 'data', 'panda_comanip_17_50hz.npz')


def movements(seed, count, dimension=3, samples=150, pace=0.1):
    """Smooth curves with an own pace and an own offset each, (T, dimension)."""
    rng = np.random.default_rng(seed)
    demonstrations = []
    for _ in range(count):
        length = int(samples * np.exp(pace * rng.normal()))
        u = np.linspace(0.0, 1.0, length)
        s = u + pace * rng.normal() * np.sin(2 * np.pi * u)
        columns = [np.sin((2 + j) * s + j) + 0.03 * rng.normal() + 0.005 * rng.normal(size=length)
                   for j in range(dimension)]
        demonstrations.append(np.stack(columns, axis=1))
    return demonstrations


@pytest.fixture(scope='module')
def fitted():
    return TimeHmm(12, dt=DT).fit(movements(1, 4))


def test_fit_returns_self_and_learns_the_documented_attributes(fitted):
    model = TimeHmm(states=12, components=1, dt=DT)
    assert model.fit(movements(1, 4)) is model
    assert model.transition_.shape == (12, 12)
    assert model.means_.shape == (12, 3)
    assert model.covariances_.shape == (12, 3, 3)
    assert model.durations_.shape == (12,)
    assert np.allclose(model.transition_.sum(axis=1), 1.0)
    assert np.all(np.diff(model.time_means_) > 0.0)
    # the states share the mean length of the demonstrations
    assert model.length_ == pytest.approx(np.mean([len(x) for x in movements(1, 4)]) * DT, rel=0.15)
    assert np.all(np.diff(model.log_likelihood_) >= -1e-9 * abs(model.log_likelihood_[-1]))
    assert model.starved_ == []
    assert np.array_equal(model.means_, fitted.means_)  # deterministic


def test_components_of_a_state_share_its_weight():
    model = TimeHmm(5, components=2, dt=DT).fit(movements(1, 4))
    assert model.means_.shape == (10, 3)
    assert model.weights_.shape == (5, 2)
    assert np.allclose(model.weights_.sum(axis=1), 1.0)


def test_unfitted_use_says_what_to_do():
    model = TimeHmm(5, dt=DT)
    x = movements(1, 1)[0]
    for use in (lambda: model.score(x), lambda: model.viterbi(x), lambda: model.regress([0.0]),
                lambda: model.predict(x, 0.1), lambda: model.to_json('/nowhere'), lambda: model.transition_,
                lambda: model.log_likelihood_, lambda: phri_learning.TimeHmmModel(model)):
        with pytest.raises(ValueError, match='fit'):
            use()


def test_refuses_bad_arguments_by_name():
    for arguments, word in (({'states': 0}, 'states'), ({'states': 3, 'dt': -1.0}, 'dt'),
                            ({'states': 3, 'mode': 'other'}, 'mode'), ({'states': 3, 'components': 0}, 'components')):
        with pytest.raises(ValueError, match=word):
            TimeHmm(**arguments)
    with pytest.raises(ValueError, match='demonstration 1'):
        TimeHmm(3).fit([np.zeros((5, 2)), np.full((5, 2), np.nan)])
    model = TimeHmm(3, dt=DT).fit(movements(1, 2))
    x = movements(1, 1)[0]
    for arguments in ({'reference': 'other'}, {'time': 'other'}, {'velocity': (1, 9)}):
        with pytest.raises(ValueError):
            model.predict(x, 0.1, **arguments)
    with pytest.raises(ValueError):
        model.predict(x[:, :2], 0.1)


def test_a_model_recognises_its_own_kind(fitted):
    own, other = movements(2, 1)[0], movements(2, 1)[0][::-1]
    assert fitted.score(own) > fitted.score(other)
    path = fitted.viterbi(own)
    assert len(path) == len(own)
    assert set(np.diff(path)) <= {0, 1}  # left to right, no state left out


def test_regression_follows_the_mean_movement():
    """Demonstrations of one pace: regression over time must return their mean; (3.6) as printed misses variance."""
    demonstrations = movements(1, 6, pace=0.0)
    model = TimeHmm(12, dt=DT).fit(demonstrations)
    times = np.arange(150) * DT
    means, covariances = model.regress(times)
    printed_means, printed = model.regress(times, full_covariance=False)
    assert means.shape == (150, 3) and covariances.shape == (150, 3, 3)
    assert np.array_equal(means, printed_means)
    assert np.all(np.linalg.eigvalsh(covariances - printed) > -1e-12)
    # 12 straight pieces of 12 samples of sin(4 s): sagitta 0.4^2 16 / 8 / 144 = 0.002, mean of 6 offsets of 0.03: 0
    assert np.abs(means - np.mean(demonstrations, axis=0)).mean() < 0.01


@pytest.mark.parametrize('dimension', [1, 2, 5])
def test_predicts_in_any_dimension_and_unit(dimension):
    train, test = movements(3, 5, dimension), movements(4, 3, dimension)
    unit = 10.0 ** np.arange(-3, -3 + 2 * dimension, 2)
    model = TimeHmm(12, dt=DT).fit(train)
    scaled = TimeHmm(12, dt=DT).fit([x * unit for x in train])
    errors, still = [], []
    for x in test:
        for t in range(30, len(x) - 10, 7):
            mean, covariance = model.predict(x[t - 30:t], 10 * DT)
            mean_s, covariance_s = scaled.predict(x[t - 30:t] * unit, 10 * DT)
            assert mean.shape == (dimension,) and covariance.shape == (dimension, dimension)
            assert np.allclose(mean_s, mean * unit, rtol=1e-6, atol=1e-9 * unit)
            assert np.allclose(covariance_s, covariance * np.outer(unit, unit), rtol=1e-6)
            assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
            errors.append(np.linalg.norm(mean - x[t + 9]))
            still.append(np.linalg.norm(x[t - 1] - x[t + 9]))
    assert np.mean(errors) < 0.6 * np.mean(still)


def test_thesis_mode_keeps_the_printed_formulas():
    train, test = movements(5, 5), movements(6, 4)
    corrected, thesis = TimeHmm(12, dt=DT).fit(train), TimeHmm(12, dt=DT, mode='thesis').fit(train)
    v = thesis.time_variances_ / DT ** 2
    assert np.allclose(thesis.durations_, np.maximum(1.0, (-3.0 + np.sqrt(1.0 + 48.0 * v)) / 4.0))
    assert np.allclose(corrected.durations_, np.sqrt(1.0 + 12.0 * v))
    printed, entry = [], []
    for x in test:
        for t in range(30, len(x) - 10, 5):
            future = x[t + 9]
            printed.append(np.linalg.norm(thesis.predict(x[t - 30:t], 10 * DT)[0] - future))
            entry.append(np.linalg.norm(corrected.predict(x[t - 30:t], 10 * DT, reference='path',
                                                          time='entry_corrected')[0] - future))
    assert np.mean(entry) < 0.8 * np.mean(printed)


def test_predictors_have_names_and_covariances_are_optional(fitted):
    window = movements(2, 1)[0][40:70]
    for name, reference, time in (('thesis', 'path', 'thesis'), ('entry_corrected', 'path', 'entry_corrected'),
                                  ('displacement', 'displacement', 'regressed')):
        mean, covariance = fitted.predict(window, 0.2, predictor=name)
        same_mean, same_covariance = fitted.predict(window, 0.2, reference=reference, time=time)
        assert np.array_equal(mean, same_mean) and np.array_equal(covariance, same_covariance)
        assert np.array_equal(fitted.predict(window, 0.2, predictor=name, return_cov=False), mean)
    assert np.array_equal(fitted.predict(window, 0.2)[0], fitted.predict(window, 0.2, predictor='displacement')[0])
    assert fitted.regress([0.1, 0.2], return_cov=False).shape == (2, 3)
    with pytest.raises(ValueError, match='displacement.*entry_corrected|entry_corrected.*displacement'):
        fitted.predict(window, 0.2, predictor='other')


def test_random_state_makes_samples_repeatable(fitted):
    x = [TimeHmm(12, dt=DT, random_state=seed).fit(movements(1, 4)).sample(100) for seed in (3, 3, 4)]
    assert x[0].shape == (100, 3) and np.array_equal(x[0], x[1]) and not np.array_equal(x[0], x[2])
    model = TimeHmm(12, dt=DT).fit(movements(1, 4))
    assert not np.array_equal(model.sample(100), model.sample(100))
    assert model.score(x[0]) > model.score(x[0][::-1])


def test_states_at_the_floor_are_reported():
    steps = np.repeat(np.arange(6.0), 20)[:, None]
    assert TimeHmm(6, dt=DT, shrinkage=0.0).fit([steps]).collapsed_ == list(range(6))
    assert TimeHmm(6, dt=DT).fit(movements(1, 4)).collapsed_ == []
    assert TimeHmm(6, dt=DT).fit(movements(1, 4)).between_time_variances_.shape == (6,)


def test_movements_follow_each_other(fitted):
    """A chain goes on where its first part ends, and is far from both; a window of it keeps the chain's times."""
    other = TimeHmm(12, dt=DT).fit([x + 2.0 for x in movements(3, 4)])
    chain = fitted.concatenate(other)
    assert chain.states == 24 and chain.length_ == pytest.approx(fitted.length_ + other.length_)
    assert chain.transition_[11, 12] == pytest.approx(1.0 / fitted.durations_[11])
    assert np.allclose(chain.time_means_[12:], other.time_means_ + fitted.length_)
    window, first = chain.window(11, 10)
    assert first == 7 and window.states == 10
    assert np.array_equal(window.time_means_, chain.time_means_[7:17])
    assert fitted.distance(fitted) == 0.0
    assert fitted.distance(other) == other.distance(fitted) > 1.0
    with pytest.raises(ValueError, match='dimension'):
        fitted.concatenate(TimeHmm(5, dt=DT).fit(movements(1, 2, dimension=2)))


def test_file_round_trip_predicts_the_same_bits(fitted, tmp_path):
    path = str(tmp_path / 'model.json')
    fitted.to_json(path)
    loaded = TimeHmm.from_json(path)
    x = movements(7, 1)[0]
    assert loaded.states == 12 and loaded.dt == DT and loaded.mode == 'corrected'
    assert loaded.score(x) == fitted.score(x)
    for a, b in zip(loaded.predict(x[:40], 0.2), fitted.predict(x[:40], 0.2)):
        assert np.array_equal(a, b)
    document = json.load(open(path))
    assert document['schema'] == 'phri_learning/TimeHmm' and document['schema_version'] == 1
    assert np.array_equal(document['model']['mean_s'], fitted.means_)  # readable without this library


def test_damaged_files_are_refused_with_a_typed_error(fitted, tmp_path):
    path = str(tmp_path / 'model.json')
    fitted.to_json(path)
    text = open(path).read()
    assert issubclass(ModelFileError, ValueError)
    for length in range(0, len(text) - 2, len(text) // 50):
        with open(path, 'w') as file:
            file.write(text[:length])
        with pytest.raises(ModelFileError, match='truncated'):
            TimeHmm.from_json(path)
    number = repr(float(fitted.means_[3, 1]))
    with open(path, 'w') as file:
        file.write(text.replace(number, repr(float(np.nextafter(fitted.means_[3, 1], 9.0))), 1))
    with pytest.raises(ModelFileError, match='sha256'):  # the smallest change a double can have
        TimeHmm.from_json(path)
    with pytest.raises(ModelFileError, match='not readable'):
        TimeHmm.from_json(str(tmp_path / 'absent.json'))


def observations(x, velocity):
    return [phri_core.Observation(t * DT, np.concatenate([p, v]), 150.0 * v) for t, (p, v) in
            enumerate(zip(x, velocity))]


def test_behaviour_model_agrees_with_the_estimator():
    trials = [observations(x, np.gradient(x, DT, axis=0)) for x in movements(8, 4, dimension=2)]
    demonstrations = [phri_learning.demonstration(trial) for trial in trials]
    assert demonstrations[0].shape == (len(trials[0]), 6)
    estimator = TimeHmm(15, dt=DT).fit(demonstrations[:3])
    model = phri_learning.TimeHmmModel(estimator, reference='displacement', time='regressed', recognition='all',
                                       adapt_pace=True)
    assert isinstance(model, phri_core.BehaviorModel)
    assert model.predict(0.2, DT) is None
    for t in range(60):
        model.observe(trials[3][t])
    prediction = model.predict(0.2, DT)
    assert len(prediction.desired_state) == len(prediction.human_wrench) == 11
    assert prediction.model == 'time_hmm' and prediction.t0 == pytest.approx(59 * DT)
    mean, covariance = estimator.predict(demonstrations[3][30:60], 0.2, velocity=(2, 4))
    assert np.allclose(prediction.desired_state[10].mean, mean[:4], rtol=0, atol=1e-12)
    assert np.allclose(prediction.human_wrench[10].covariance, covariance[4:, 4:], rtol=1e-12)
    model.reset()
    assert model.predict(0.2, DT) is None


def recordings():
    """Real trials as [position; velocity; force], velocities by differences. Their pace differs 3x, with pauses."""
    with np.load(DATA) as file:
        trials = [file['trial_%d' % i].astype(float) for i in range(6)]
    result = []
    for x in trials:
        velocity = np.diff(x[:, :2], axis=0, prepend=x[:1, :2]) / DT
        result.append(np.hstack([x[:, :2], velocity, x[:, 2:]]))
    return result


def test_on_real_recordings_every_correction_pays():
    """Leave one out, 0.3 s ahead. What must hold: the time regressed in the state beats both ways of counting samples,
    which pauses mislead; displacement beats all absolute predictions by far; ellipses are honest."""
    trials, ahead = recordings(), 15
    errors = {name: [] for name in ('thesis', 'entry_corrected', 'regressed', 'displacement')}
    inside = []
    for held_out in range(6):
        model = TimeHmm(10, dt=DT).fit([x for i, x in enumerate(trials) if i != held_out])
        x = trials[held_out]
        for t in range(30, len(x) - ahead, 3):
            window, future = x[t - 29:t + 1], x[t + ahead, :2]
            for time in ('thesis', 'entry_corrected', 'regressed'):
                mean, _ = model.predict(window, ahead * DT, reference='path', time=time)
                errors[time].append(np.linalg.norm(mean[:2] - future))
            mean, covariance = model.predict(window, ahead * DT, velocity=(2, 4))
            residual = mean[:2] - future
            errors['displacement'].append(np.linalg.norm(residual))
            inside.append(residual @ np.linalg.solve(covariance[:2, :2], residual) < 5.991)
    mean = {name: np.mean(values) for name, values in errors.items()}
    assert mean['displacement'] < 0.5 * mean['regressed']
    assert mean['regressed'] < 0.9 * min(mean['entry_corrected'], mean['thesis'])
    assert 0.85 < np.mean(inside) < 0.99


def test_ellipses_are_honest_on_real_recordings():
    """Share of a trial that was not learned from inside the 95 % ellipses of the others' regression, at the same share
    of the movement. (3.6) as printed knows neither the spread of the means nor that trials differ in time."""
    trials = recordings()
    inside = {True: [], False: []}
    for held_out in range(6):
        model = TimeHmm(10, dt=DT).fit([x for i, x in enumerate(trials) if i != held_out])
        x = trials[held_out]
        for full, result in inside.items():
            means, covariances = model.regress(np.linspace(0.0, model.length_, len(x)), full_covariance=full)
            residual = (x - means)[:, :2, None]
            square = (residual.transpose(0, 2, 1) @ np.linalg.solve(covariances[:, :2, :2], residual))[:, 0, 0]
            result.append(np.mean(square < 5.991))
    assert np.mean(inside[True]) > 0.85  # six trials with pauses: not 95 %
    assert np.mean(inside[True]) > np.mean(inside[False]) + 0.2
