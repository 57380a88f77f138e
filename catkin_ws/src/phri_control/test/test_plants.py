"""Plants, uncertain costs and scenes in Python, against SciPy."""
import numpy as np
import phri_control as pc
import pytest
from scipy.integrate import dblquad, solve_ivp
from scipy.optimize import approx_fprime

ODE_TOLERANCE = 1e-8  # solve_ivp runs at 1e-10; 1000 Runge-Kutta steps of 1 ms add less
QUADRATURE_TOLERANCE = 1e-7  # dblquad's own is 1.5e-8
DIFFERENCE_TOLERANCE = 1e-5  # forward differences with step 1e-7 of curvatures up to 20


def plants():
    return [
        pc.PointMass(mass=[1.3, 0.7], damping=[0.4, 2.0], drive=2.0),
        pc.TwoLinkArm(),
        pc.TwoLinkArm(input="workspace_force"),
        pc.CarLikeRobot(),
    ]


@pytest.mark.parametrize("plant", plants())
def test_runge_kutta_follows_the_differential_equation(plant):
    random = np.random.default_rng(1)
    start = random.uniform(-1.0, 1.0, plant.state_size)
    u = np.array([0.3, -0.2])
    exact = solve_ivp(lambda _, x: plant.rate(x, u), (0.0, 1.0), start, rtol=1e-10, atol=1e-12).y[:, -1]
    x = start
    for _ in range(1000):
        x = plant.step(x, u, 1e-3, integrator="runge_kutta")
    np.testing.assert_allclose(x, exact, atol=ODE_TOLERANCE)


def test_shapes_and_what_does_not_fit():
    car = pc.CarLikeRobot()
    A, B = car.linearise(np.zeros(5), np.zeros(2), 0.01)
    assert A.shape == (5, 5) and B.shape == (5, 2)
    assert car.motion_jacobian(np.zeros(5)).shape == (4, 5)
    with pytest.raises(ValueError, match="x"):
        car.step(np.zeros(4), np.zeros(2), 0.01)
    with pytest.raises(ValueError, match="integrator"):
        car.step(np.zeros(5), np.zeros(2), 0.01, integrator="heun")
    with pytest.raises(ValueError, match="input"):
        pc.TwoLinkArm(input="voltage")
    with pytest.raises(ValueError, match="shoulder"):
        pc.TwoLinkArm().state_at([1.0, 1.0, 0.0, 0.0])


def test_expected_obstacle_is_an_integral():
    mean, covariance = np.array([0.1, -0.2]), np.array([[0.3, 0.1], [0.1, 0.2]])
    weight, amplitude, y = np.array([[3.0, -0.5], [-0.5, 1.0]]), 0.7, np.array([0.5, 0.3])
    obstacle = pc.UncertainObstacle(mean, covariance, weight, amplitude)
    precision = np.linalg.inv(covariance)
    scale = 1.0 / (2.0 * np.pi * np.sqrt(np.linalg.det(covariance)))

    def moment(p):
        def integrand(b, a):
            x = np.array([a, b])
            cost = amplitude * np.exp(-0.5 * (y - x) @ weight @ (y - x))
            return cost**p * scale * np.exp(-0.5 * (x - mean) @ precision @ (x - mean))

        return dblquad(integrand, -4.0, 4.0, -4.0, 4.0)[0]

    first, second = moment(1), moment(2)
    assert obstacle.expected().value(y) == pytest.approx(first, abs=QUADRATURE_TOLERANCE)
    variance = sum(bump.value(y) for bump in obstacle.cumulant(2))
    assert variance == pytest.approx(second - first**2, abs=QUADRATURE_TOLERANCE)


def test_goal_breaks_down_at_its_limit():
    goal = pc.UncertainGoal([0.0, 0.0], np.diag([0.5, 3.0]), np.diag([4.0, 1.0]))
    assert goal.theta_limit == pytest.approx(1.0 / 3.0)
    value, gradient, hessian = goal.risk_sensitive(0.3).expand([1.0, 2.0])
    np.testing.assert_allclose(np.diag(hessian), [4.0 / 0.4, 1.0 / 0.1])
    np.testing.assert_allclose(gradient, hessian @ [1.0, 2.0])
    with pytest.raises(pc.RiskBreakdown, match="below 0.333"):
        goal.risk_sensitive(0.34)


@pytest.mark.parametrize("figure", pc.thesis_scene_names())
def test_scene_has_the_derivatives_of_its_cost(figure):
    thesis = pc.thesis_scene(figure)
    scene = thesis.scene
    z, u = scene.start + 0.05, np.array([0.4, -0.3])
    value, q, Q, r, R = scene.expand(z, u)
    assert value == scene.cost(z, u)
    np.testing.assert_allclose(q, approx_fprime(z, lambda p: scene.cost(p, u), 1e-7), atol=DIFFERENCE_TOLERANCE)
    np.testing.assert_allclose(r, approx_fprime(u, lambda v: scene.cost(z, v), 1e-7), atol=DIFFERENCE_TOLERANCE)
    np.testing.assert_allclose(R, scene.dt * scene.control_weight)
    assert scene.expand(z)[0] == scene.cost(z)
    A, B = scene.linearise(z, u)
    np.testing.assert_allclose(scene.step(z, u + [1.0, 0.0]) - scene.step(z, u), B[:, 0], atol=1e-12)  # affine in u
    assert A.shape == Q.shape == (scene.state_size, scene.state_size)
    assert thesis.assumed and thesis.panels
    with pytest.raises(ValueError, match="z"):
        scene.cost(z[1:], u)


def test_scene_solves_in_both_states():
    # the risk-neutral solution of figure 4.5 costs what four independent solvers reach
    scene = pc.thesis_scene("4.5").scene
    joint, error = scene.solve(), scene.solve(error_state=True)
    assert joint.status == error.status == "Converged"
    assert joint.cost == pytest.approx(0.0491451919, abs=1e-10)
    assert error.cost == pytest.approx(joint.cost, abs=1e-12)
    np.testing.assert_allclose(joint.gains[:, :, 4:], error.gains, atol=1e-6)
    averse = scene.solve(pc.RiskSensitive([4.0]))
    assert averse.converged and averse.cost > joint.cost  # what it pays for is less variability
    assert list(scene.noise) == ["obstacle"] and scene.noise["obstacle"].shape == (12, 4)


def test_unknown_figure_names_the_known_ones():
    with pytest.raises(ValueError, match="4.8a"):
        pc.thesis_scene("4.8")
