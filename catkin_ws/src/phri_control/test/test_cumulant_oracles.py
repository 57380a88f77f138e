"""Cost cumulants through the Python surface: Monte Carlo, theta-derivatives of the risk-sensitive value, limits."""
import math

import numpy as np
import phri_control
import pytest
from lq_fixtures import random_arguments
from scipy.stats import kstat, norm

# Two orders of the same sums, well-conditioned problems of some ten unknowns.
EXACT = 1e-10


def random_problem(seed, n=3, m=2, horizon=8):
    """Arguments of a stable time-varying affine problem, and a factor of noise per source."""
    rng = np.random.default_rng(seed)
    arguments = random_arguments(rng, n, m, horizon, keep=0.8, spread=0.15, linear=0.5, drift=0.3)
    return arguments, [0.3 * rng.normal(size=(horizon, n, 1)), np.diag([0.3, 0.0, 0.2])]


def problem_of(arguments, factors):
    problem = phri_control.LinearQuadraticProblem(**arguments)
    for index, factor in enumerate(factors):
        problem.add_noise(f"source {index}", factor=factor)
    return problem


def costs(p, factor, solution, x0, trials, seed):
    """J of simulated trials with the noise of one source."""
    rng = np.random.default_rng(seed)
    x, cost = np.tile(x0, (trials, 1)), np.zeros(trials)
    for k, (gain, feedforward) in enumerate(zip(solution.gains, solution.feedforward)):
        u = x @ gain.T + feedforward
        cost += 0.5 * np.einsum("ij,jk,ik->i", x, p["Q"][k], x) + x @ p["q"][k]
        cost += 0.5 * np.einsum("ij,jk,ik->i", u, p["R"][k], u) + u @ p["r"][k]
        e = factor if factor.ndim == 2 else factor[k]
        x = x @ p["A"][k].T + u @ p["B"][k].T + p["drift"][k] + rng.normal(size=(trials, e.shape[1])) @ e.T
    return cost + 0.5 * np.einsum("ij,jk,ik->i", x, p["terminal_Q"], x) + x @ p["terminal_q"]


@pytest.mark.parametrize("seed", [1, 2])
def test_cumulants_are_those_of_simulated_costs(seed):
    """k-statistics of 200 batches are unbiased; their mean has a normal error that the batches tell."""
    p, factors = random_problem(seed)
    solution = phri_control.solve(problem_of(p, factors), phri_control.CostCumulants([[0.3, 0.1], [-0.05, 0.0]]))
    x0 = np.array([1.0, -0.5, 0.3])
    kappa = solution.cumulants(x0)
    assert kappa.shape == (2, 3)
    limit = norm.ppf(1.0 - 0.5 * 1e-4 / 6)  # six comparisons, one false alarm in 10 000 seeds
    for source, factor in enumerate(factors):
        batches = costs(p, factor, solution, x0, 1_000_000, 100 + source).reshape(200, -1)
        for r in (1, 2, 3):
            sample = np.array([kstat(batch, r) for batch in batches])
            error = sample.std(ddof=1) / math.sqrt(len(sample))
            assert abs(sample.mean() - kappa[source, r - 1]) < limit * error, (source, r)
            assert abs(kappa[source, r - 1]) > 10.0 * error  # the test could tell it from zero


def test_cumulants_are_theta_derivatives_of_the_risk_sensitive_value():
    p, factors = random_problem(3)
    problem = problem_of(p, factors[:1])
    solution = phri_control.solve(problem, phri_control.CostCumulants(np.zeros((1, 0))))
    x0 = np.array([0.5, 1.0, -1.0])

    def value(theta):
        attitude = phri_control.RiskSensitive([theta])
        return phri_control.evaluate(problem, attitude, solution.gains, solution.feedforward).value(x0)

    kappa = solution.cumulants(x0, 4)[0]
    # five points, exact up to theta^5 h^4; steps that balance the rest of the series against rounding
    h = 0.01 * phri_control.theta_max(problem)
    v = np.array([value(i * h) for i in range(-3, 4)])
    first = (v[5] * -1 + 8 * v[4] - 8 * v[2] + v[1]) / (12 * h)
    second = (-v[5] + 16 * v[4] - 30 * v[3] + 16 * v[2] - v[1]) / (12 * h**2)
    third = (-v[6] + 8 * v[5] - 13 * v[4] + 13 * v[2] - 8 * v[1] + v[0]) / (8 * h**3)
    np.testing.assert_allclose(kappa[0], v[3], rtol=EXACT)
    np.testing.assert_allclose(kappa[1:], [2 * first, 3 * second, 4 * third], rtol=1e-6)


def test_all_weights_of_the_exponential_give_the_risk_sensitive_policy():
    p, factors = random_problem(4)
    problem = problem_of(p, factors)
    thetas = np.array([0.1, -0.15])
    gamma = [[theta**(r - 1) / math.factorial(r) for r in range(2, 11)] for theta in thetas]
    ours = phri_control.solve(problem, phri_control.CostCumulants(gamma))
    exact = phri_control.solve(problem, phri_control.RiskSensitive(thetas))
    neutral = phri_control.solve(problem)
    np.testing.assert_allclose(ours.gains, exact.gains, atol=1e-8)
    np.testing.assert_allclose(ours.feedforward, exact.feedforward, atol=1e-8)
    assert ours.value(np.ones(3)) == pytest.approx(exact.value(np.ones(3)), rel=1e-7)
    assert np.abs(neutral.gains - exact.gains).max() > 1e-3


def test_averse_weights_buy_variance_with_mean():
    p, factors = random_problem(5)
    problem = problem_of(p, factors[:1])
    x0 = np.array([1.0, 1.0, -1.0])
    kappa = np.array([
        phri_control.solve(problem, phri_control.CostCumulants([[gamma]])).cumulants(x0)[0]
        for gamma in (-0.02, 0.0, 0.02)])
    assert kappa[1, 0] < min(kappa[0, 0], kappa[2, 0])
    assert kappa[0, 1] > kappa[1, 1] > kappa[2, 1]


def test_cumulants_of_any_policy_and_any_number():
    p, factors = random_problem(6)
    problem = problem_of(p, factors)
    x0 = np.array([0.2, 0.1, 0.4])
    solution = phri_control.solve(problem, phri_control.CostCumulants(np.full((2, 2), 0.1)))
    assert solution.gains.shape == (8, 2, 3) and solution.feedforward.shape == (8, 2)
    values = phri_control.evaluate_cumulants(problem, 5, solution.gains, solution.feedforward)
    np.testing.assert_allclose(solution.cumulants(x0, 5), values.cumulants(x0), rtol=EXACT)
    np.testing.assert_allclose(solution.cumulants(x0), values.cumulants(x0)[:, :3], rtol=EXACT)
    np.testing.assert_allclose(solution.cumulants(x0, 1), values.cumulants(x0)[:, :1], rtol=EXACT)
    kappa = solution.cumulants(x0)
    assert solution.value(x0) == pytest.approx(np.mean(kappa @ [1.0, 0.1, 0.1]), rel=EXACT)
    problem.add_noise("later", covariance=np.eye(3))  # the solution keeps the problem that it solved
    assert solution.cumulants(x0, 5).shape == (2, 5)
    risk = phri_control.solve(problem, phri_control.RiskSensitive([0.01, 0.0, -0.01]))
    assert phri_control.evaluate_cumulants(problem, 2, risk.gains, risk.feedforward).cumulants(x0).shape == (3, 2)


def test_printed_weighting_is_another_policy():
    p, factors = random_problem(7)
    problem, attitude = problem_of(p, factors), phri_control.CostCumulants([[0.1], [0.2]])
    printed = phri_control.solve(problem, attitude, printed=True)
    half = phri_control.solve(problem, phri_control.CostCumulants([[0.05], [0.1]]))
    # for K = 2 leaving out the factor 2 is the same as halving the weights
    np.testing.assert_allclose(printed.gains, half.gains, rtol=EXACT)
    assert np.abs(printed.gains - phri_control.solve(problem, attitude).gains).max() > 1e-4


def test_breakdown_and_bad_arguments():
    p, factors = random_problem(8)
    problem = problem_of(p, factors)
    with pytest.raises(phri_control.RiskBreakdown) as error:
        phri_control.solve(problem, phri_control.CostCumulants([[-100.0], [0.0]]))
    assert error.value.kind == "hessian" and 0 <= error.value.stage < 8
    for gamma, words in (([0.1, 0.2], r"gamma has shape \(2\)"), (np.zeros((3, 1)), "3 rows, expected 2"),
                         ([[np.nan], [0.0]], "gamma")):
        with pytest.raises(ValueError, match=words):
            phri_control.solve(problem, phri_control.CostCumulants(gamma))
    solution = phri_control.solve(problem, phri_control.CostCumulants([[0.0], [0.0]]))
    with pytest.raises(ValueError, match="x0"):
        solution.cumulants(np.zeros(4))
    with pytest.raises(ValueError, match="count = 0"):
        solution.cumulants(np.zeros(3), 0)
    with pytest.raises(ValueError, match="gains"):
        phri_control.evaluate_cumulants(problem, 2, solution.gains[:4], solution.feedforward)
