"""Python surface of phri_control: linear-quadratic problems, policies and assistance against numpy and scipy."""
import numpy as np
import phri_control
import phri_core
import pytest
from lq_fixtures import random_arguments
from scipy.linalg import block_diag, solve_discrete_are

# Two dense solutions of well-conditioned problems of some hundred unknowns.
EXACT = 1e-10


def random_problem(seed, n=4, m=2, horizon=15):
    return random_arguments(np.random.default_rng(seed), n, m, horizon)


def kkt_solution(p, x0):
    """States, controls and cost that satisfy the Karush-Kuhn-Tucker conditions without noise, in one linear solve.

    Unknowns: x_1..x_T, u_0..u_T-1, multipliers of x+ = A x + B u + drift.
    """
    horizon, n, m = p["B"].shape
    nx, nu = horizon * n, horizon * m
    hessian = block_diag(*p["Q"][1:], p["terminal_Q"], *p["R"])
    gradient = np.concatenate([p["q"][1:].ravel(), p["terminal_q"], p["r"].ravel()])
    dynamics, constant = np.zeros((nx, nx + nu)), p["drift"].ravel().copy()
    constant[:n] += p["A"][0] @ x0
    for k in range(horizon):
        rows = slice(k * n, (k + 1) * n)
        dynamics[rows, rows] = np.eye(n)
        if k:
            dynamics[rows, (k - 1) * n:k * n] = -p["A"][k]
        dynamics[rows, nx + k * m:nx + (k + 1) * m] = -p["B"][k]
    matrix = np.block([[hessian, dynamics.T], [dynamics, np.zeros((nx, nx))]])
    z = np.linalg.solve(matrix, np.concatenate([-gradient, constant]))[:nx + nu]
    cost = 0.5 * z @ hessian @ z + gradient @ z + 0.5 * x0 @ p["Q"][0] @ x0 + p["q"][0] @ x0
    return np.vstack([x0, z[:nx].reshape(horizon, n)]), z[nx:].reshape(horizon, m), cost


def roll_out(p, solution, x0, noise=None):
    """States, controls and costs of many trajectories (trials, n) under the policy."""
    x = np.array(x0)
    states, controls, cost = [x], [], 0.0
    for k in range(len(p["A"])):
        u = x @ solution.gains[k].T + solution.feedforward[k]
        cost = cost + 0.5 * np.einsum("ij,jk,ik->i", x, p["Q"][k], x) + x @ p["q"][k]
        cost = cost + 0.5 * np.einsum("ij,jk,ik->i", u, p["R"][k], u) + u @ p["r"][k]
        x = x @ p["A"][k].T + u @ p["B"][k].T + p["drift"][k] + (0.0 if noise is None else noise[k])
        states.append(x)
        controls.append(u)
    cost = cost + 0.5 * np.einsum("ij,jk,ik->i", x, p["terminal_Q"], x) + x @ p["terminal_q"]
    return np.array(states), np.array(controls), cost


@pytest.mark.parametrize("seed", range(5))
def test_policy_satisfies_the_kkt_conditions(seed):
    p = random_problem(seed)
    solution = phri_control.solve(phri_control.LinearQuadraticProblem(**p))
    assert solution.gains.shape == (15, 2, 4) and solution.feedforward.shape == (15, 2)
    x0 = np.linspace(-1.0, 2.0, 4)
    states, controls, cost = kkt_solution(p, x0)
    ours = roll_out(p, solution, x0[None])
    scale = 1.0 + np.abs(states).max()
    assert np.abs(ours[0][:, 0] - states).max() < EXACT * scale
    assert np.abs(ours[1][:, 0] - controls).max() < EXACT * scale
    assert solution.value(x0) == pytest.approx(cost, rel=EXACT)


def test_long_horizon_is_the_discrete_riccati_equation():
    n, m = 4, 2
    rng = np.random.default_rng(3)
    A, B = np.eye(n) + 0.3 * rng.normal(size=(n, n)), rng.normal(size=(n, m))
    Q, R = np.diag([1.0, 2.0, 0.5, 0.1]), np.diag([0.3, 1.0])
    P = solve_discrete_are(A, B, Q, R)
    gain = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    solution = phri_control.solve(phri_control.LinearQuadraticProblem(A, B, Q, R, horizon=500))
    # the closed loop contracts: after 500 stages nothing is left of the horizon's end
    assert np.abs(np.linalg.eigvals(A + B @ gain)).max() < 0.9
    np.testing.assert_allclose(solution.gains[0], gain, rtol=1e-9, atol=1e-10)
    assert solution.value(np.ones(n)) == pytest.approx(0.5 * np.ones(n) @ P @ np.ones(n), rel=1e-9)


def test_value_is_the_mean_cost_of_noisy_trials():
    p = random_problem(7)
    problem = phri_control.LinearQuadraticProblem(**p)
    rng = np.random.default_rng(8)
    factor = 0.5 * rng.normal(size=(15, 4, 1))  # singular, time-varying
    covariance = np.diag([0.2, 0.0, 0.1, 0.4])
    problem.add_noise("varying", factor=factor)
    problem.add_noise("constant", covariance=covariance)
    assert problem.noise == ["varying", "constant"]
    solution = phri_control.solve(problem)
    trials = 200_000
    noise = [rng.normal(size=(trials, 1)) @ factor[k].T + rng.normal(size=(trials, 4)) @ np.sqrt(covariance)
             for k in range(15)]
    x0 = np.array([1.0, -1.0, 0.5, 0.0])
    cost = roll_out(p, solution, np.tile(x0, (trials, 1)), noise)[2]
    error = cost.std() / np.sqrt(trials)
    assert abs(cost.mean() - solution.value(x0)) < 4.0 * error  # one seed in 16 000 would miss by chance
    without = phri_control.solve(phri_control.LinearQuadraticProblem(**p)).value(x0)
    assert solution.value(x0) - without > 20.0 * error  # the noise's constant is really tested


def test_residual_judges_any_policy():
    problem = phri_control.LinearQuadraticProblem(**random_problem(9))
    other = phri_control.solve(phri_control.LinearQuadraticProblem(**random_problem(10)))
    assert phri_control.residual(problem, phri_control.solve(problem)) < 1e-11
    assert phri_control.residual(problem, other) > 1e-3


def test_one_matrix_stands_for_all_stages():
    p = random_problem(11, horizon=1)
    one = {key: p[key][0] for key in ("A", "B", "Q", "R", "q", "r", "drift")}
    many = {key: np.repeat(value[None], 6, axis=0) for key, value in one.items()}
    a = phri_control.solve(phri_control.LinearQuadraticProblem(**one, horizon=6))
    b = phri_control.solve(phri_control.LinearQuadraticProblem(**many))
    np.testing.assert_array_equal(a.gains, b.gains)
    np.testing.assert_array_equal(a.feedforward, b.feedforward)


@pytest.mark.parametrize("change, words", [
    ({"horizon": 4}, ["A has 15 stages", "4"]),
    ({"B": np.zeros((15, 3, 2))}, ["stages[0].B"]),
    ({"Q": np.triu(np.ones((4, 4)))}, ["stages[0].Q", "symmetric"]),
    ({"q": np.zeros((15, 5))}, ["stages[0].q"]),
    ({"A": np.full((15, 4, 4), np.nan)}, ["stages[0].A"]),
    ({"terminal_Q": np.eye(3)}, ["terminal"]),
    ({"R": np.zeros(2)}, ["R has shape (2)"]),
])
def test_bad_arguments_are_named(change, words):
    with pytest.raises(ValueError) as error:
        phri_control.LinearQuadraticProblem(**{**random_problem(12), **change})
    for word in words:
        assert word in str(error.value)


def test_horizon_must_be_known():
    with pytest.raises(ValueError, match="horizon"):
        phri_control.LinearQuadraticProblem(np.eye(2), np.ones((2, 1)), np.eye(2), np.eye(1))


def test_noise_must_fit():
    problem = phri_control.LinearQuadraticProblem(**random_problem(13))
    for bad in ({}, {"covariance": np.eye(4), "factor": np.eye(4)}, {"covariance": np.eye(3)},
                {"covariance": -np.eye(4)}, {"factor": np.zeros((3, 4, 1))}):
        with pytest.raises(ValueError, match="hand"):
            problem.add_noise("hand", **bad)


def test_no_minimum_is_an_error_naming_the_stage():
    p = random_problem(14)
    p["R"][4] -= 1e6 * np.eye(2)
    with pytest.raises(ArithmeticError, match="stage 4"):
        phri_control.solve(phri_control.LinearQuadraticProblem(**p))


def prediction_of(path, dt=0.02, count=16):
    prediction = phri_core.Prediction()
    prediction.t0, prediction.dt = 0.0, dt
    prediction.desired_state = [phri_core.Gaussian(path(k * dt), 1e-5 * np.eye(4)) for k in range(count)]
    return prediction


def test_assistance_plans_policies():
    assert phri_control.assistance_names() == ["none", "lqr", "mahalanobis", "pd"]
    settings = phri_control.AssistanceSettings()
    settings.law = "preview"
    observation = phri_core.Observation(t=0.0, state=np.zeros(4), human_wrench=np.zeros(2))
    prediction = prediction_of(lambda t: np.array([0.1 * t, 0.0, 0.1, 0.0]))
    for name in phri_control.assistance_names():
        policy = phri_control.make_assistance(name, settings).plan(observation, prediction)
        assert policy.dof == 2 and policy.horizon_end == pytest.approx(0.2)
        xi = np.array([0.001, 0.002, 0.0, 0.1])
        expected = policy.gains[0] @ (xi - policy.references[0]) + policy.feedforward[0]
        np.testing.assert_allclose(policy.act(0.0, xi), expected, rtol=1e-12, atol=1e-12)
        assert policy.expired(0.41) and not policy.act(0.41, xi).any()
    with pytest.raises(ValueError, match="did you mean lqr"):
        phri_control.make_assistance("lqrr")


def test_unusable_prediction_is_none_with_a_reason():
    controller = phri_control.make_assistance("mahalanobis")
    observation = phri_core.Observation(t=0.0, state=np.zeros(4), human_wrench=np.zeros(2))
    assert controller.plan(observation, prediction_of(lambda t: np.full(4, np.nan))) is None
    assert "not finite" in controller.failure


def test_policy_can_be_made_by_hand():
    policy = phri_control.FeedbackPolicy(1.0, 0.001, np.tile([[-5.0, -1.0]], (3, 1, 1)), np.zeros((3, 2)), source=4)
    assert policy.source == 4 and policy.dof == 1
    np.testing.assert_allclose(policy.act(1.0, np.array([1.0, 2.0])), [-7.0])
    with pytest.raises(ValueError, match="expected 1 to 6"):
        phri_control.FeedbackPolicy(0.0, 0.001, np.zeros((1, 7, 2)), np.zeros((1, 2)))


def test_settings_refuse_too_many_axes():
    settings = phri_control.AssistanceSettings()
    with pytest.raises(ValueError, match="expected 1 to 6"):
        settings.mass = np.ones(7)
