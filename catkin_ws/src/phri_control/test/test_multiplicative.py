"""Multiplicative noise from Python against simulation of the true system: nothing here shares code with the solver."""
import numpy as np
import phri_control
import pytest

SIGMAS = 4.0  # Monte Carlo: 6e-5 of correct estimates fall outside
RUNS = 100000
DT, HORIZON = 0.05, 20


def reaching(effort=0.3, constant=0.05, horizon=HORIZON):
    """A point mass [m; m/s] whose force is noisy in proportion to its size (fraction `effort`), and a little without
    any; the additive source beside it pushes the velocity."""
    A, B = np.array([[1.0, DT], [0.0, 1.0 - DT]]), np.array([[0.0], [DT]])
    plain = phri_control.LinearQuadraticProblem(
        A=A, B=B, Q=np.zeros((2, 2)), R=np.array([[2e-4]]), terminal_Q=np.diag([20.0, 2.0]), horizon=horizon)
    problem = phri_control.MultiplicativeNoiseProblem(plain)
    problem.add_multiplicative_noise("hand", control=effort * B)
    problem.add_multiplicative_noise("hand", constant=constant * np.array([0.0, 1.0]))
    system = {"A": A, "B": B, "R": np.array([[2e-4]]), "terminal_Q": np.diag([20.0, 2.0])}
    channels = [(np.zeros((2, 2)), effort * B, np.zeros(2)), (np.zeros((2, 2)), np.zeros((2, 1)), [0.0, constant])]
    return problem, system, channels


def costs(system, channels, gains, feedforward, x0, rng, runs=RUNS):
    x, total = np.tile(x0, (runs, 1)), np.zeros(runs)
    for gain, force in zip(gains, feedforward):
        u = x @ gain.T + force
        total += 0.5 * np.einsum("ri,ij,rj->r", u, system["R"], u)
        step = x @ system["A"].T + u @ system["B"].T
        for C, D, e in channels:
            step += (x @ C.T + u @ D.T + e) * rng.normal(size=(runs, 1))
        x = step
    return total + 0.5 * np.einsum("ri,ij,rj->r", x, system["terminal_Q"], x)


def mean_and_error(samples):
    return samples.mean(), samples.std(ddof=1) / np.sqrt(len(samples))


def variance_and_error(samples):
    return mean_and_error((samples - samples.mean()) ** 2)


def about_mean(problem, attitude, x0, passes=40):
    """The fixed point of solving about one's own mean trajectory."""
    solution = phri_control.solve(problem, attitude)
    for _ in range(passes):
        states, controls = solution.mean_trajectory(x0)
        solution = phri_control.solve(problem, attitude, states=states, controls=controls)
    return solution


def test_simulated_mean_and_variance_are_those_of_the_model():
    """Effort noise of 10 %: the cubic and quartic terms that the model leaves out are below the Monte Carlo error."""
    problem, system, channels = reaching(effort=0.1)
    x0 = np.array([-1.0, 0.0])
    solution = about_mean(problem, phri_control.CostCumulants([[0.5]]), x0)
    samples = costs(system, channels, solution.gains, solution.feedforward, x0, np.random.default_rng(1))
    mean, error = mean_and_error(samples)
    assert abs(solution.values(x0)[0] - mean) < SIGMAS * error
    variance, error = variance_and_error(samples)
    assert error < 0.05 * variance
    assert abs(solution.variances(x0)[0] - variance) < SIGMAS * error


def test_mean_is_exact_however_strong_the_noise():
    problem, system, channels = reaching(effort=1.0)
    x0 = np.array([-1.0, 0.5])
    solution = phri_control.solve(problem)
    mean, error = mean_and_error(
        costs(system, channels, solution.gains, solution.feedforward, x0, np.random.default_rng(2)))
    assert error < 0.02 * mean
    assert abs(solution.value(x0) - mean) < SIGMAS * error


def test_risk_seeking_value_over_one_stage_is_the_simulated_one():
    """One stage about its own mean: exact for every theta for which it exists; the average of exp(theta J) has a finite
    variance for theta < 0."""
    problem, system, channels = reaching(effort=1.0, constant=0.5, horizon=1)
    x0, theta = np.array([-0.5, 2.0]), -0.5
    solution = about_mean(problem, phri_control.RiskSensitive([theta]), x0)
    rng = np.random.default_rng(3)
    weights = np.exp(theta * costs(system, channels, solution.gains, solution.feedforward, x0, rng, 10 * RUNS))
    mean, error = mean_and_error(weights)
    assert abs(solution.value(x0) - np.log(mean) / theta) < SIGMAS * error / mean / abs(theta)


def test_mean_variance_pays_where_noise_is_strong():
    """Simulated E J + gamma Var J of three policies, on common random numbers: the model of the noise must beat no
    model of it (additive noise of the same size at the mean trajectory) and not caring about the variance."""
    gamma, x0 = 20.0, np.array([-1.0, 0.0])
    problem, system, channels = reaching(effort=0.5)
    best = about_mean(problem, phri_control.CostCumulants([[gamma]]), x0)
    neutral = phri_control.solve(problem)

    controls = best.mean_trajectory(x0)[1]
    factor = np.zeros((HORIZON, 2, 2))
    factor[:, :, 0] = controls * channels[0][1].T
    factor[:, :, 1] = channels[1][2]
    additive = phri_control.LinearQuadraticProblem(
        A=system["A"], B=system["B"], Q=np.zeros((2, 2)), R=system["R"], terminal_Q=system["terminal_Q"],
        horizon=HORIZON)
    additive.add_noise("hand", factor=factor)
    unaware = phri_control.solve(additive, phri_control.CostCumulants([[gamma]]))

    samples = [costs(system, channels, p.gains, p.feedforward, x0, np.random.default_rng(4))
               for p in (best, neutral, unaware)]

    def influence(j):  # of every sample on the criterion
        return j + gamma * (j - j.mean()) ** 2

    for other in samples[1:]:
        gain, error = mean_and_error(influence(other) - influence(samples[0]))
        assert gain > SIGMAS * error
    assert samples[0].var() < samples[1].var()


def test_evaluate_agrees_with_solve_and_sources_are_averaged():
    problem, system, _ = reaching()
    attitude = phri_control.CostCumulants([[0.1]])
    solution = phri_control.solve(problem, attitude)
    x0 = np.array([-1.0, 0.3])
    same = phri_control.evaluate(problem, attitude, solution.gains, solution.feedforward)
    assert same.value(x0) == pytest.approx(solution.value(x0), rel=1e-12)
    assert solution.value(x0) == pytest.approx(solution.values(x0)[0] + 0.1 * solution.variances(x0)[0], rel=1e-12)

    plain = phri_control.LinearQuadraticProblem(
        A=system["A"], B=system["B"], Q=np.zeros((2, 2)), R=system["R"], terminal_Q=system["terminal_Q"],
        horizon=HORIZON)
    plain.add_noise("floor", covariance=1e-3 * np.eye(2))
    mixed = phri_control.MultiplicativeNoiseProblem(plain)
    mixed.add_multiplicative_noise("hand", control=0.3 * system["B"])
    assert mixed.noise == ["floor", "hand"]
    both = phri_control.solve(mixed, phri_control.RiskSensitive([0.1, 0.1]))
    assert both.value(x0) == pytest.approx(np.mean(both.values(x0)), rel=1e-12)
    assert len(both.values(x0)) == 2 and len(phri_control.solve(mixed).values(x0)) == 1


def test_mean_square_gain_and_its_threshold():
    one = np.eye(1)

    def scalar(noise):
        plain = phri_control.LinearQuadraticProblem(A=1.1 * one, B=one, Q=one, R=one, horizon=1)
        problem = phri_control.MultiplicativeNoiseProblem(plain)
        problem.add_multiplicative_noise("gain", control=noise * one)
        return phri_control.mean_square_gain(problem)

    critical = np.sqrt(1.1 ** 2 / (1.1 ** 2 - 1.0) - 1.0)
    gain = scalar(0.99 * critical)[0, 0]
    assert (1.1 + gain) ** 2 + (0.99 * critical * gain) ** 2 < 1.0
    with pytest.raises(ArithmeticError, match="no gain keeps"):
        scalar(1.01 * critical)


def test_bad_input_is_named():
    problem, system, _ = reaching()
    with pytest.raises(ValueError, match="control"):
        problem.add_multiplicative_noise("hand", control=np.eye(2))
    with pytest.raises(ValueError, match="at least one of"):
        problem.add_multiplicative_noise("hand")
    with pytest.raises(ValueError, match="has 3 matrices, expected 1 or 20"):
        problem.add_multiplicative_noise("hand", state=np.zeros((3, 2, 2)))
    with pytest.raises(ValueError, match="K = 3"):
        phri_control.solve(problem, phri_control.CostCumulants([[0.1, 0.1]]))
    with pytest.raises(ValueError, match="give both or none"):
        phri_control.solve(problem, phri_control.CostCumulants([[0.1]]), states=np.zeros((HORIZON, 2)))
    with pytest.raises(phri_control.RiskBreakdown) as caught:
        phri_control.solve(problem, phri_control.RiskSensitive([1e6]))
    assert caught.value.kind == "expectation" and caught.value.source == 0
