"""Stationary gains of the mass-damper of section 4.6.1, by the C++ library.

x+ = [[1, Delta], [0, 1 - Delta d/m]] x + [0, Delta/m] u + eps, m = 1 kg, d = 1 Ns/m, cost J = 1/2 sum x'Qx + u'Ru with
R = 1, every source of noise with covariance (Sigma^1/2)^2 I. Shown is -L of u = L x: L_x [N/m], L_v [Ns/m]. Where no
policy exists the gains are NaN and the status says why: a number there would not be one.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
import phri_control

MASS, DAMPING, CONTROL_WEIGHT = 1.0, 1.0, 1.0
STEP = ("The step Δ = 5 ms and Q = diag(1, 0), those of the author's stored script of figure 4.3, are used because "
        "they give the 0.998 N/m that the text states for E[J]; the printed Δ = 1 ms and Q = I give 0.9995 N/m and are "
        "shown beside it.")
HALF = ("J has the factors 1/2 of (4.17); the sum (4.44) is printed without them, which would mean twice the theta and "
        "2^(r-1) times the weight of the r-th cumulant.")
CONTROL = ("R is a number, because there is one control; the printed R = I2 is for the script's two controls, of which "
           "one does nothing.")
NO_R = ("The cumulants are weighted without the factor r, as in (4.37) and in the author's code; the optimum of "
        "(4.36) has it.")
# Cumulant control has no stationary form in the library: the horizon is doubled until the gain of its first stage is
# that of its middle to this share. The difference falls geometrically, so the error left is about its square.
SETTLED = 1e-7
FIRST_HORIZON, LONGEST_HORIZON = 25.0, 100.0  # [s]; the closed loops settle within some seconds
OK, BREAKDOWN, UNSETTLED = "ok", "breakdown", "not settled"


@dataclass(frozen=True)
class Setting:
    name: str
    step: float  # Delta [s]
    state_weights: tuple  # diagonal of Q

    @property
    def label(self) -> str:
        first, second = self.state_weights
        weights = "I" if first == second == 1.0 else f"diag({first:g}, {second:g})"
        return f"Δ = {self.step * 1e3:g} ms, Q = {weights}"

    def matrices(self) -> tuple:
        A = np.array([[1.0, self.step], [0.0, 1.0 - self.step * DAMPING / MASS]])
        return A, np.array([[0.0], [self.step / MASS]]), np.diag(self.state_weights), np.array([[CONTROL_WEIGHT]])

    def record(self) -> dict:
        return {"step_s": self.step, "Q_diagonal": list(self.state_weights), "R": CONTROL_WEIGHT, "mass_kg": MASS,
                "damping_Ns_per_m": DAMPING}


@dataclass(frozen=True)
class Gain:
    position: float  # [N/m]
    velocity: float  # [Ns/m]
    status: str

    @staticmethod
    def of(gain) -> "Gain":
        return Gain(float(-gain[0, 0]), float(-gain[0, 1]), OK)


NO_POLICY, NOT_SETTLED = Gain(np.nan, np.nan, BREAKDOWN), Gain(np.nan, np.nan, UNSETTLED)
STORED = Setting("stored script", 5e-3, (1.0, 0.0))
STORED_ONE = Setting("stored script, one source", 5e-3, (1.0, 1.0))
PRINTED = Setting("printed", 1e-3, (1.0, 1.0))
EDGE = 1.2e-2  # Sigma^1/2 at the right end of the thesis' axes
ORDERS = (2, 3, 4)
SAME = 1e-9  # gains that are equal but for rounding, relative


def neutral(setting: Setting) -> Gain:
    return Gain.of(phri_control.stationary_gain(*setting.matrices()))


def risk_sensitive(setting: Setting, roots, theta) -> Gain:
    """`roots` Sigma^1/2 and `theta` [1/J] per source of noise."""
    factors = [root * np.eye(2) for root in roots]
    try:
        return Gain.of(phri_control.stationary_gain(*setting.matrices(), factors, phri_control.RiskSensitive(theta)))
    except phri_control.RiskBreakdown:
        return NO_POLICY
    except ArithmeticError:
        return NOT_SETTLED


def problem(setting: Setting, roots, stages: int):
    lq = phri_control.LinearQuadraticProblem(*setting.matrices(), horizon=stages)
    for source, root in enumerate(roots):
        lq.add_noise(f"source {source + 1}", factor=root * np.eye(2))
    return lq


def cumulants(setting: Setting, roots, order: int, weights, printed: bool) -> Gain:
    """Expected cost plus `weights` (one per source) times the cumulant of one order; `printed`: the weighting of (4.37)
    without the factor r."""
    gamma = np.zeros((len(roots), order - 1))
    gamma[:, -1] = weights
    horizon = FIRST_HORIZON
    while horizon <= LONGEST_HORIZON:
        stages = round(horizon / setting.step)
        try:
            gains = phri_control.solve(problem(setting, roots, stages), phri_control.CostCumulants(gamma),
                                       printed=printed).gains
        except phri_control.RiskBreakdown:
            return NO_POLICY
        if np.abs(gains[0] - gains[stages // 2]).max() < SETTLED * np.abs(gains[0]).max():
            return Gain.of(gains[0])
        horizon *= 2.0
    return NOT_SETTLED


def breakdown_roots(setting: Setting, thetas) -> list:
    """Sigma^1/2 from which on the attitudes theta > 0 to one source have no policy, relative error 1e-5: the limit of
    theta Sigma, on which alone the breakdown depends, is that of a horizon many times longer than the loop settles."""
    unit = 1e-2
    limit = phri_control.theta_max(problem(setting, [unit], round(FIRST_HORIZON / setting.step))) * unit**2
    return [float(np.sqrt(limit / theta)) for theta in thetas]


def apply(function, cases, jobs: int) -> list:
    """[function(*case) for case in cases], by as many processes."""
    if jobs == 1:
        return [function(*case) for case in cases]
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(function, *zip(*cases)))


def row(gain: Gain, **keys) -> dict:
    """A line of data.csv."""
    return {**keys, "gain_position": gain.position, "gain_velocity": gain.velocity, "status": gain.status}


def monotone(table, rising: bool) -> bool:
    """Whether the gain rises (falls) from line to line where there are policies, two at least."""
    steps = np.diff(table["gain_position"].dropna())
    return len(steps) > 0 and bool((steps > 0).all() if rising else (steps < 0).all())
