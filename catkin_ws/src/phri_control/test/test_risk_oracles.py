"""Risk-sensitive control from Python against numpy and scipy: nothing here shares code with the solver."""
import math

import numpy as np
import phri_control
import pytest
from lq_fixtures import random_arguments
from scipy.linalg import solve_discrete_are

EXACT = 1e-10  # relative: dense solutions of well-conditioned problems of some 40 unknowns


def random_problem(seed, n=3, m=2, horizon=8, sources=2):
    """Arguments of a problem, and the factors (T, n, p) of its sources; the last source is singular."""
    rng = np.random.default_rng(seed)
    arguments = random_arguments(rng, n, m, horizon, drift=0.3)
    factors = [0.4 * rng.normal(size=(horizon, n, n if s + 1 < sources else 1)) for s in range(sources)]
    problem = phri_control.LinearQuadraticProblem(**arguments)
    for s, factor in enumerate(factors):
        problem.add_noise(f"source {s}", factor=factor)
    return arguments, factors, problem


def stacked(p, factor, gains, feedforward, x0):
    """M, g, j of J = 1/2 z'M z + g'z + j in the noise z of all stages: linear maps by brute force."""
    horizon, n, columns = factor.shape
    size = horizon * columns

    def trajectory(z, constants):
        x, states, controls = constants * x0, [], []
        for k in range(horizon):
            u = gains[k] @ x + constants * feedforward[k]
            states.append(x)
            controls.append(u)
            noise = factor[k] @ z[k * columns:(k + 1) * columns]
            x = p["A"][k] @ x + p["B"][k] @ u + constants * p["drift"][k] + noise
        return np.concatenate(states + [x]), np.concatenate(controls)

    weights = np.zeros(((horizon + 1) * n,) * 2)
    for k, q in enumerate([*p["Q"], p["terminal_Q"]]):
        weights[k * n:(k + 1) * n, k * n:(k + 1) * n] = q
    m = p["R"].shape[1]
    effort = np.zeros((horizon * m,) * 2)
    for k in range(horizon):
        effort[k * m:(k + 1) * m, k * m:(k + 1) * m] = p["R"][k]
    q, r = np.concatenate([p["q"].ravel(), p["terminal_q"]]), p["r"].ravel()
    x, u = trajectory(np.zeros(size), 1.0)
    columns_of = [trajectory(unit, 0.0) for unit in np.eye(size)]
    X, U = (np.array([pair[i] for pair in columns_of]).T for i in (0, 1))
    M = X.T @ weights @ X + U.T @ effort @ U
    g = X.T @ (weights @ x + q) + U.T @ (effort @ u + r)
    return M, g, 0.5 * x @ weights @ x + q @ x + 0.5 * u @ effort @ u + r @ u


def closed_form(M, g, j, theta):
    if theta == 0.0:
        return j + 0.5 * np.trace(M)
    F = np.eye(len(g)) - theta * M
    if np.linalg.eigvalsh(F)[0] <= 0.0:
        return math.inf
    return j + 0.5 * theta * g @ np.linalg.solve(F, g) - np.linalg.slogdet(F)[1] / (2.0 * theta)


@pytest.mark.parametrize("seed", range(5))
def test_value_is_the_stacked_closed_form(seed):
    p, factors, problem = random_problem(seed)
    x0 = np.linspace(-1.0, 2.0, 3)
    theta = [0.7 * phri_control.theta_max(problem), -0.8]
    solution = phri_control.solve(problem, phri_control.RiskSensitive(theta))
    assert solution.gains.shape == (8, 2, 3) and solution.feedforward.shape == (8, 2)
    forms = [closed_form(*stacked(p, f, solution.gains, solution.feedforward, x0), t)
             for f, t in zip(factors, theta)]
    np.testing.assert_allclose(solution.values(x0), forms, rtol=EXACT)
    assert solution.value(x0) == pytest.approx(np.mean(forms), rel=EXACT)
    again = phri_control.evaluate(problem, phri_control.RiskSensitive(theta), solution.gains, solution.feedforward)
    assert again.value(x0) == pytest.approx(solution.value(x0), rel=EXACT)


@pytest.mark.parametrize("seed", range(5))
def test_theta_max_is_the_eigenvalue_of_its_own_policy(seed):
    p, factors, problem = random_problem(seed, sources=1)
    limit = phri_control.theta_max(problem)
    solution = phri_control.solve(problem, phri_control.RiskSensitive([limit]))
    M = stacked(p, factors[0], solution.gains, solution.feedforward, np.zeros(3))[0]
    assert 1.0 / np.linalg.eigvalsh(M)[-1] == pytest.approx(limit, rel=1e-7)
    with pytest.raises(phri_control.RiskBreakdown) as error:
        phri_control.solve(problem, phri_control.RiskSensitive([1.01 * limit]))
    assert error.value.kind == "expectation" and error.value.source == 0
    assert error.value.theta == 1.01 * limit > error.value.limit
    assert 0 <= error.value.stage < 8 and f"stage {error.value.stage}" in str(error.value)
    assert isinstance(error.value, ArithmeticError)


def test_without_attitude_it_is_the_expected_cost():
    _, _, problem = random_problem(6, sources=1)
    x0 = np.ones(3)
    plain, none = phri_control.solve(problem), phri_control.solve(problem, None)
    neutral = phri_control.solve(problem, phri_control.RiskSensitive([0.0]))
    np.testing.assert_array_equal(plain.gains, none.gains)
    np.testing.assert_allclose(neutral.gains, plain.gains, rtol=1e-10, atol=1e-12)
    assert neutral.value(x0) == pytest.approx(plain.value(x0), rel=EXACT)


# theta = 0 of an infinite horizon is the discrete algebraic Riccati equation.
def test_stationary_gain_is_scipys_for_no_risk():
    rng = np.random.default_rng(7)
    A, B = np.eye(4) + 0.3 * rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    Q, R = np.diag([1.0, 2.0, 0.5, 0.1]), np.diag([0.3, 1.0])
    P = solve_discrete_are(A, B, Q, R)
    expected = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    for attitude in (None, phri_control.RiskSensitive([0.0])):
        gain = phri_control.stationary_gain(A, B, Q, R, factors=[np.eye(4)], attitude=attitude)
        np.testing.assert_allclose(gain, expected, rtol=1e-9, atol=1e-10)


# Noise through B of covariance Su is a control of the other sign: R^-1 becomes R^-1 - theta Su in the Riccati equation
# (Whittle's form), which scipy solves in the coordinates of an equivalent control.
@pytest.mark.parametrize("theta", [-2.0, -0.1, 0.2])
def test_stationary_risk_gain_is_scipys_of_the_equivalent_control(theta):
    A, B = np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([[0.0], [0.1]])
    Q, r, variance = np.diag([1.0, 0.1]), 0.5, 0.3
    P = solve_discrete_are(A, B, Q, np.array([[1.0 / (1.0 / r - theta * variance)]]))
    inside = np.linalg.inv(P) + B @ B.T * (1.0 / r - theta * variance)
    expected = -B.T @ np.linalg.solve(inside, A) / r
    gain = phri_control.stationary_gain(A, B, Q, np.array([[r]]), factors=[B * math.sqrt(variance)],
                                        attitude=phri_control.RiskSensitive([theta]))
    np.testing.assert_allclose(gain, expected, rtol=1e-9)


def test_beyond_the_limit_there_is_an_error_and_no_number():
    A, B = np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([[0.0], [0.1]])
    with pytest.raises(phri_control.RiskBreakdown) as error:
        phri_control.stationary_gain(A, B, np.eye(2), np.eye(1), [B], phri_control.RiskSensitive([1.5]))
    assert error.value.kind == "expectation"
    with pytest.raises(ArithmeticError, match="no convergence in 5"):
        phri_control.stationary_gain(A, B, np.eye(2), np.eye(1), max_iterations=5)


def test_indefinite_control_weight_is_a_breakdown_without_source():
    p, _, _ = random_problem(8)
    p["R"][4] -= 1e6 * np.eye(2)
    problem = phri_control.LinearQuadraticProblem(**p)
    with pytest.raises(phri_control.RiskBreakdown) as error:
        phri_control.solve(problem, phri_control.RiskSensitive([]))
    assert (error.value.kind, error.value.stage, error.value.source) == ("hessian", 4, None)


def test_bad_arguments_are_named():
    _, _, problem = random_problem(9)
    with pytest.raises(ValueError, match="1 thetas, expected 2"):
        phri_control.solve(problem, phri_control.RiskSensitive([0.1]))
    with pytest.raises(ValueError, match="theta"):
        phri_control.solve(problem, phri_control.RiskSensitive([math.nan, 0.0]))
    with pytest.raises(ValueError, match="source 2"):
        phri_control.theta_max(problem, source=2)
    solution = phri_control.solve(problem)
    attitude = phri_control.RiskSensitive([0.0, 0.0])
    with pytest.raises(ValueError, match="gains has 7 stages, expected 8"):
        phri_control.evaluate(problem, attitude, solution.gains[1:], solution.feedforward)
    with pytest.raises(ValueError, match=r"gains\[0\]"):
        phri_control.evaluate(problem, attitude, solution.gains[:, :, :2], solution.feedforward)
    with pytest.raises(ValueError, match="x0"):
        phri_control.solve(problem, attitude).value(np.zeros(2))


def test_silent_noise_has_no_limit():
    p, _, _ = random_problem(10)
    problem = phri_control.LinearQuadraticProblem(**p)
    problem.add_noise("silent", covariance=np.zeros((3, 3)))
    assert phri_control.theta_max(problem) == math.inf


def test_cumulants_of_a_risk_sensitive_policy_are_the_series_of_its_value():
    """V(theta) of a FIXED policy is sum theta^(r-1) / r! kappa_r; so is the value of the solution's own policy."""
    problem = phri_control.LinearQuadraticProblem(
        np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([[0.0], [0.1]]), np.eye(2), np.eye(1), terminal_Q=np.eye(2),
        horizon=20)
    problem.add_noise("force", covariance=np.diag([0.0, 1e-3]))
    theta, x0 = 0.5, np.array([0.3, -0.2])
    solution = phri_control.solve(problem, phri_control.RiskSensitive([theta]))
    kappa = solution.cumulants(x0, 8)[0]
    factorial = np.cumprod(np.arange(1, 9))
    series = np.sum(theta ** np.arange(8) / factorial * kappa)
    assert abs(series - solution.value(x0)) < 1e-10 * abs(series)
    assert kappa[1] > 1e-4 * kappa[0], "no spread: the test would prove nothing"
