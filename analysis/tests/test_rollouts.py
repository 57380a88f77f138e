"""Statistics of roll-outs: intervals that cover, verdicts that follow from them."""

from types import SimpleNamespace

import numpy as np
import pytest
from figures import _rollouts
from phri_analysis.errors import DataError
from scipy import stats

REPETITIONS = 400
# 95 % intervals miss in 20 of 400; the binomial interval (4 standard deviations, 0.044) around it. Those of the third
# and fourth cumulant rest on few extreme runs and are known to be short by so much at 10^4 runs
COVERAGE, SPREAD, SHORT = 0.95, 0.044, {3: 0.03, 4: 0.05}
EXACT = 1e-9  # relative: power sums against the definition


@pytest.fixture(scope="module")
def gamma_sample():
    # kappa_r = shape (r - 1)! of the unit gamma distribution
    return np.random.default_rng(1).gamma(4.0, size=(REPETITIONS, 2000))


def test_leave_one_out_is_the_statistic_without_the_run():
    sample = 5.0 + 0.1 * np.random.default_rng(2).gamma(2.0, size=12)
    without = _rollouts.leave_one_out(sample)
    for i in range(len(sample)):
        np.testing.assert_allclose(without[:, i], _rollouts.k_statistics(np.delete(sample, i)), rtol=EXACT)
    for theta in (0.0, 3.0, -50.0, 4000.0):  # at 4000 one run is all of the sum
        _, left, _ = _rollouts.exponential(sample, theta)
        expected = [_rollouts.exponential(np.delete(sample, i), theta)[0] for i in range(len(sample))]
        np.testing.assert_allclose(left, expected, rtol=EXACT)


def test_constant_costs_have_no_spread():
    for estimate in _rollouts.cumulants(np.full(10, 2.0)):
        assert estimate.limits() == (estimate.value, estimate.value)
    value, _, weight = _rollouts.exponential(np.full(10, 2.0), 5.0)
    assert value == pytest.approx(2.0) and weight == pytest.approx(10.0)


def test_intervals_of_cumulants_cover():
    rng = np.random.default_rng(6)
    true = 4.0 * np.array([1.0, 1.0, 2.0, 6.0])
    covered = np.zeros(4)
    for _ in range(REPETITIONS):
        low, high = np.transpose([one.limits() for one in _rollouts.cumulants(rng.gamma(4.0, size=10000))])
        covered += (low < true) & (true < high)
    for order, share in enumerate(covered / REPETITIONS, start=1):
        assert COVERAGE - SPREAD - SHORT.get(order, 0.0) < share < COVERAGE + SPREAD, order


@pytest.mark.parametrize("theta", [0.2, -1.0])
def test_intervals_of_the_exponential_criterion_cover(gamma_sample, theta):
    true = -4.0 * np.log(1.0 - theta) / theta
    estimates = [_rollouts.Estimate(*_rollouts.exponential(sample, theta)) for sample in gamma_sample]
    limits = np.array([estimate.limits() for estimate in estimates])
    covered = np.mean((limits[:, 0] < true) & (true < limits[:, 1]))
    assert COVERAGE - SPREAD < covered < COVERAGE + SPREAD


def test_paired_differences_cover_and_are_shorter_than_unpaired(gamma_sample):
    rng = np.random.default_rng(3)
    covered, shorter = 0, 0
    for sample in gamma_sample:
        other = 0.9 * sample + rng.normal(0.0, 0.2, len(sample))  # variance 0.81 * 4 + 0.04
        one, two = _rollouts.cumulants(sample)[1], _rollouts.cumulants(other)[1]
        low, high = (two - one).limits()
        covered += low < -0.72 < high
        unpaired = np.hypot(*(np.diff(estimate.limits())[0] for estimate in (one, two)))
        shorter += high - low < 0.5 * unpaired
    assert COVERAGE - SPREAD < covered / REPETITIONS < COVERAGE + SPREAD
    assert shorter == REPETITIONS


@pytest.mark.parametrize("p, q", [(0.02, 0.02), (0.3, 0.2)])
def test_intervals_of_shares_cover(p, q):
    rng = np.random.default_rng(4)
    single, paired = 0, 0
    for _ in range(REPETITIONS):
        common = rng.uniform(size=500)
        flags, others = common < p, np.where(rng.uniform(size=500) < 0.5, common, rng.uniform(size=500)) < q
        _, low, high = _rollouts.share(flags)
        single += low < p < high
        _, low, high = _rollouts.share_difference(flags, others)
        paired += low < p - q < high
    for covered in (single, paired):
        assert COVERAGE - SPREAD < covered / REPETITIONS <= 1.0
    value, low, high = _rollouts.share_difference(np.zeros(100, bool), np.zeros(100, bool))
    assert value == 0.0 and low < 0.0 < high < 0.05  # no event at all is not a proof of none


def test_criterion_is_that_of_the_attitude():
    first, second = np.random.default_rng(5).gamma([[2.0], [3.0]], size=(2, 1000))
    risk = _rollouts.criterion(SimpleNamespace(theta=[0.2, 0.0]), [first, second])
    assert risk.value == pytest.approx(0.5 * (np.log(np.mean(np.exp(0.2 * first))) / 0.2 + second.mean()), rel=EXACT)
    assert risk.weight == pytest.approx(np.exp(0.2 * first).sum() ** 2 / np.exp(0.4 * first).sum())
    weighted = SimpleNamespace(gamma=np.array([[0.5, -0.1], [0.0, 0.3]]))
    mixed = _rollouts.criterion(weighted, [first, second])
    expected = first.mean() + 0.5 * first.var(ddof=1) - 0.1 * stats.kstat(first, 3)
    expected += second.mean() + 0.3 * stats.kstat(second, 3)
    assert mixed.value == pytest.approx(0.5 * expected, rel=EXACT)
    with pytest.raises(DataError, match="kappa_5"):
        _rollouts.criterion(SimpleNamespace(gamma=np.ones((1, 4))), [first])


def test_a_table_of_policies():
    """Figure 4.4 is linear-quadratic: the averse policy is the best one of its criterion in the true cost too, and pays
    for it in the mean. No feedback is worse than any."""
    pc = pytest.importorskip("phri_control")
    scene = pc.thesis_scene("4.4").scene
    averse, none = pc.RiskSensitive([4.0]), pc.RiskSensitive([0.0])
    plain, careful = scene.solve(none), scene.solve(averse)
    lazy = SimpleNamespace(
        states=plain.states, controls=plain.controls, gains=0.0 * plain.gains, usable=True, share=1.0
    )
    lost = SimpleNamespace(usable=False, share=0.0)
    results = {"a": plain, "b": careful, "c": lazy, "d": lost}
    table = _rollouts.compare(scene, results, {"a": none, "b": averse, "c": averse, "d": averse}, 2000, seed=2)
    assert list(table["verdict"]) == ["reference", "pays", "costs", "no policy"]
    assert table.loc["b", "verdict_variance"] == "pays" and table.loc["b", "verdict_mean"] == "costs"
    assert list(table["verdict_collisions"][:3]) == ["reference", "no difference", "no difference"]
    assert table.loc["d", "mean":"clearance"].isna().all()
    runs, others = pc.roll_out(scene, careful, 2000, seed=2).costs, pc.roll_out(scene, plain, 2000, seed=2).costs
    row = table.loc["b"]
    assert row["mean"] == pytest.approx(runs.mean()) and row["variance"] == pytest.approx(runs.var(ddof=1))
    assert row["d_mean"] == pytest.approx((runs - others).mean())
    reach = stats.norm.ppf(0.975) * (runs - others).std(ddof=1) / np.sqrt(2000)  # of a mean: the ordinary interval
    assert row["d_mean_high"] - row["d_mean"] == pytest.approx(reach)
    wanted = np.log(np.mean(np.exp(4.0 * runs))) / 4.0
    assert row["criterion"] == pytest.approx(wanted) and row["weight"] < 2000


def test_marginal_criteria_of_two_sources():
    pc = pytest.importorskip("phri_control")
    scene = pc.thesis_scene("4.7").scene
    scene.horizon = 30
    attitude = pc.CostCumulants([[-1.0], [2.0]])
    result = scene.solve(attitude)
    table = _rollouts.compare(scene, {"b": result}, {"b": attitude}, 500, seed=3, reference=scene.solve())
    goal, obstacle = (pc.roll_out(scene, result, 500, seed=3, source=s).model_costs for s in (0, 1))
    wanted = 0.5 * (goal.mean() - goal.var(ddof=1) + obstacle.mean() + 2.0 * obstacle.var(ddof=1))
    assert table.loc["b", "criterion"] == pytest.approx(wanted) and np.isnan(table.loc["b", "weight"])
    runs = pc.roll_out(scene, result, 500, seed=3)
    assert table.loc["b", "collisions_moving"] == (runs.distances[:, 0] < 1.0).mean()
    assert table.loc["b", "collisions_static"] == (runs.distances[:, 1:] < 1.0).any(axis=1).mean()
    assert table.loc["b", "clearance"] == np.median(runs.clearance)


def test_runs_that_diverge_have_no_moments():
    pc = pytest.importorskip("phri_control")
    scene = pc.thesis_scene("4.4").scene
    plain, attitude = scene.solve(), pc.RiskSensitive([1.0])
    wild = SimpleNamespace(
        states=plain.states, controls=plain.controls, gains=1e200 * np.ones_like(plain.gains), usable=True, share=1.0
    )
    results = {"wild": wild, "plain": plain}
    table = _rollouts.compare(scene, results, dict.fromkeys(results, attitude), 50, reference=plain)
    row = table.loc["wild"]
    assert row["diverged"] == 1.0 and row["better"] == 0.0 and np.isinf(row["median"])
    assert row["mean":"criterion_high"].isna().all() and row["d_mean":"d_criterion_high"].isna().all()
    assert row["verdict"] == row["verdict_mean"] == row["verdict_variance"] == "diverges"
    row = table.loc["plain"]  # it is the reference itself: nothing differs
    assert row["verdict"] == "reference" and row["diverged"] == row["d_mean"] == 0.0 and np.isnan(row["better"])
    beaten = _rollouts.compare(scene, {"plain": plain}, {"plain": attitude}, 50, reference=wild).loc["plain"]
    assert beaten["verdict"] == "diverges" and beaten["better"] == 1.0 and np.isfinite(beaten["mean"])
