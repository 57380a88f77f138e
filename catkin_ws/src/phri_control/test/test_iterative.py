"""solve_iterative over Python functions: against the exact solver, with and without derivatives, and in its errors."""
import pathlib
import subprocess
import sys

import numpy as np
import phri_control
import pytest
from phri_control import CostCumulants, RiskSensitive, solve_iterative

# Second differences are good to 1e-8 of a cost of order 1, over curvatures of 0.05 and 15 stages.
NUMERICAL = 1e-5
A, B = np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([[0.0], [0.1]])
Q, R, S = np.diag([1.0, 0.1]), np.array([[0.05]]), np.array([[0.02, 0.01]])
FACTOR = np.array([[0.0], [0.1]])
X0 = np.array([0.5, 0.2])
HORIZON = 15


def step(_k, x, u):
    return A @ x + B @ u


def cost(_k, x, u):
    return 0.5 * x @ Q @ x + 0.5 * u @ R @ u + u @ S @ x


def terminal(x):
    return 0.5 * x @ Q @ x


EXACT = {
    "dynamics_derivatives": lambda k, x, u: (A, B),
    "cost_derivatives": lambda k, x, u: (Q @ x + S.T @ u, Q, R @ u + S @ x, R, S),
    "terminal_derivatives": lambda x: (Q @ x, Q),
}


def solve(**options):
    arguments = {"controls": 1, "terminal_cost": terminal, "noise": {"force": FACTOR}, **options}
    return solve_iterative(step, cost, X0, HORIZON, **arguments)


def exact_solution(attitude):
    """The mixed term removed by u = v - R^-1 S x."""
    mixed = np.linalg.solve(R, S)
    problem = phri_control.LinearQuadraticProblem(A - B @ mixed, B, Q - S.T @ mixed, R, terminal_Q=Q, horizon=HORIZON)
    problem.add_noise("force", factor=FACTOR)
    solution = phri_control.solve(problem, attitude)
    return solution.gains - mixed, solution.value(X0)


@pytest.mark.parametrize("attitude", [RiskSensitive([0.5]), RiskSensitive([-0.5]), CostCumulants([[0.3]])])
def test_linear_quadratic_problem_is_solved_exactly(attitude):
    gains, value = exact_solution(attitude)
    result = solve(attitude=attitude, **EXACT)
    assert result.status == "Converged" and result.converged
    np.testing.assert_allclose(result.gains, gains, atol=1e-10)
    assert result.criterion == pytest.approx(value, rel=1e-10)
    numerical = solve(attitude=attitude)
    np.testing.assert_allclose(numerical.gains, gains, atol=NUMERICAL * np.abs(gains).max())
    np.testing.assert_allclose(numerical.controls, result.controls, atol=NUMERICAL)


def test_breakdown_raises_only_when_asked():
    beyond = RiskSensitive([1e6])
    result = solve(attitude=beyond, **EXACT)
    assert (result.status, result.fallback) == ("Breakdown", "reduced")
    assert 0.0 < result.share < 1.0 and result.usable and "theta = 1e+06" in result.message
    assert solve(attitude=beyond, reduce=False, **EXACT).fallback == "risk neutral"
    with pytest.raises(phri_control.RiskBreakdown):
        solve(attitude=beyond, raise_on_breakdown=True, **EXACT)


def test_limits_noise_functions_start_trace_and_cumulants():
    free = solve(**EXACT)
    limit = 0.5 * np.abs(free.controls).max()
    held = solve(lower=[-limit], upper=[limit], **EXACT)
    assert np.abs(held.controls).max() == limit and held.cost > free.cost
    assert np.abs(held.multipliers).max() > 0.0
    as_function = solve(noise={"force": lambda k, x, u: FACTOR}, attitude=RiskSensitive([0.5]), **EXACT)
    np.testing.assert_array_equal(as_function.gains, solve(attitude=RiskSensitive([0.5]), **EXACT).gains)
    again = solve(start=free.controls, cumulants=2, **EXACT)
    assert again.iterations == 0 and again.trace[0]["step"] == 0.0
    assert again.cumulants.shape == (1, 2)
    assert again.cumulants[0, 0] == pytest.approx(exact_solution(RiskSensitive([0.0]))[1], rel=1e-8)


def test_errors_name_the_cause_and_exceptions_pass():
    with pytest.raises(ValueError, match="line_search"):
        solve(line_search="newton")
    with pytest.raises(ValueError, match="theta"):
        solve(attitude=RiskSensitive([0.0, 1.0]))
    with pytest.raises(ValueError, match=r"dynamics\(k, x, u\)"):
        solve_iterative(lambda k, x, u: np.zeros(3), cost, X0, HORIZON, controls=1)
    with pytest.raises(ZeroDivisionError):
        solve_iterative(lambda k, x, u: 1 // 0, cost, X0, HORIZON, controls=1)
    broken = solve_iterative(lambda k, x, u: x * np.nan, cost, X0, HORIZON, controls=1)
    assert broken.status == "NotFinite" and not broken.usable


def test_tutorial_prints_what_its_twin_prints():
    folder = pathlib.Path(__file__).resolve().parent.parent / "tutorials"
    printed = subprocess.run([sys.executable, folder / "risk_averse.py"], capture_output=True, text=True, check=True)
    assert printed.stdout == (folder / "risk_averse.txt").read_text(encoding="utf-8")
