"""roll_out in Python: against a simulation written here, and what it refuses."""
from types import SimpleNamespace

import numpy as np
import phri_control as pc
import pytest

ERRORS = 4.0  # standard errors between two estimates of one mean; the seeds are fixed
SUMS = 1e-12  # two ways to add the same numbers
RUNS = 4000


@pytest.fixture(scope="module")
def scene():
    scene = pc.thesis_scene("4.7").scene
    scene.horizon = 30
    return scene


@pytest.fixture(scope="module")
def policy(scene):
    return scene.solve()


def simulated(scene, policy, rng):
    """One run by the scene's own step, cost and noise."""
    x, cost, nearest = scene.start, 0.0, np.inf
    goal, obstacle = scene.movers["goal"], scene.movers["obstacle"]
    assert (goal, obstacle) == (4, 8)
    for state, control, gain in zip(policy.states, policy.controls, policy.gains):
        nearest = min(nearest, np.sqrt(200.0) * np.linalg.norm(x[:2] - x[obstacle : obstacle + 2]))
        u = control + gain @ (x - state)
        cost += scene.cost(x, u)
        x = scene.step(x, u)
        for factor in scene.noise.values():
            x = x + factor @ rng.standard_normal(factor.shape[1])
    nearest = min(nearest, np.sqrt(200.0) * np.linalg.norm(x[:2] - x[obstacle : obstacle + 2]))
    return cost + scene.cost(x), nearest


def test_moments_are_those_of_a_simulation_in_python(scene, policy):
    runs = pc.roll_out(scene, policy, RUNS, seed=3)
    rng = np.random.default_rng(4)
    ours = np.array([simulated(scene, policy, rng) for _ in range(500)]).T
    for theirs, sample in zip((runs.model_costs, runs.distances[:, 0]), ours):
        for moment in (lambda v: v, lambda v: (v - v.mean()) ** 2):
            a, b = moment(theirs), moment(sample)
            error = np.sqrt(a.var() / len(a) + b.var() / len(b))
            assert abs(a.mean() - b.mean()) < ERRORS * error
    assert runs.model_costs.std() > 0.01


def test_without_noise_it_is_the_nominal():
    scene = pc.thesis_scene("4.5").scene
    scene.set_diffusion(1, np.zeros((4, 0)))
    policy = scene.solve()
    runs = pc.roll_out(scene, policy, 3)
    np.testing.assert_allclose(runs.costs, policy.cost, rtol=SUMS)
    np.testing.assert_array_equal(runs.costs, runs.model_costs)


def test_streams_sources_and_shapes(scene, policy):
    few, many = (pc.roll_out(scene, policy, count, seed=7) for count in (10, 20))
    np.testing.assert_array_equal(few.costs, many.costs[:10])
    assert many.costs.shape == many.model_costs.shape == many.collided.shape == many.clearance.shape == (20,)
    assert many.distances.shape == (20, 3) and many.collided.dtype == bool
    np.testing.assert_array_equal(many.clearance, many.distances.min(axis=1))
    np.testing.assert_array_equal(many.collided, many.clearance < 1.0)
    assert 0 < many.collided.sum() < 20
    by_name, by_index = (pc.roll_out(scene, policy, 10, seed=7, source=s) for s in ("obstacle", 1))
    np.testing.assert_array_equal(by_name.costs, by_index.costs)
    assert not np.any(by_name.model_costs == few.model_costs)
    # static things are at the same places whatever acts
    np.testing.assert_array_equal(pc.roll_out(scene, policy, 10, seed=7, source="goal").costs.shape, (10,))
    arrays = SimpleNamespace(states=policy.states, controls=policy.controls, gains=policy.gains)
    np.testing.assert_array_equal(pc.roll_out(scene, arrays, 10, seed=7).costs, few.costs)


def test_no_obstacles_no_collisions():
    scene = pc.thesis_scene("4.4").scene
    runs = pc.roll_out(scene, scene.solve(), 5)
    assert runs.distances.shape == (5, 0) and np.all(np.isinf(runs.clearance)) and not runs.collided.any()


@pytest.mark.parametrize("figure", ["4.4", "4.9", "4.10"])
def test_plants_of_every_size(figure):
    scene = pc.thesis_scene(figure).scene
    scene.horizon = 20
    policy = scene.solve()
    runs = pc.roll_out(scene, policy, 50)
    assert np.isfinite(runs.costs).all() and len(np.unique(runs.costs)) == 50


def test_errors_name_the_cause(scene, policy):
    with pytest.raises(ValueError, match="expected one of goal, obstacle"):
        pc.roll_out(scene, policy, 10, source="wind")
    with pytest.raises(ValueError, match="source = 2, expected below 2"):
        pc.roll_out(scene, policy, 10, source=2)
    with pytest.raises(ValueError, match="source = -1"):
        pc.roll_out(scene, policy, 10, source=-1)
    with pytest.raises(ValueError, match="count = 0"):
        pc.roll_out(scene, policy, 0)
    with pytest.raises(TypeError, match="has no states"):
        pc.roll_out(scene, object(), 10)
    with pytest.raises(ValueError, match="31"):
        pc.roll_out(pc.thesis_scene("4.7").scene, policy, 10)  # its horizon is 200
    passive = pc.thesis_scene("4.6").scene
    with pytest.raises(ValueError, match="8 elements per stage, expected 12"):
        pc.roll_out(passive, passive.solve(error_state=True), 10)
