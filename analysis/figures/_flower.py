"""Seeded synthetic people who trace the flower of figure 3.3 again and again, for the figures of section 3.1.3.

The path is that of the scene `flower` (four petals counter-clockwise, then once around the centre): r = CENTRE + PETAL
sin^2(2 phi), then a circle. A person goes along it slower where it bends (two-thirds power law), with an own pace, size
and place, and in every repetition a little differently: all deviations are sums of a few slow sines with seeded
amplitudes and phases, so motions are smooth and may be differentiated exactly. The force is the one that the object
needs, u_h = M xddot + D xdot with the thesis' M = 40 kg, D = 90 Ns/m.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

CENTRE, PETAL = 0.035, 0.085  # [m] as draw_flower.py of the scene has it
MASS, DAMPING = 40.0, 90.0
PARTS = ("petal 1", "petal 2", "petal 3", "petal 4", "centre")
ROUGH = 0.002  # [s] of the splines
WANDER = 0.003  # [m] standard deviation of the place about the path
PACE = 0.06  # relative, of the duration of a repetition
OWN_SIZE, OWN_PACE, SECONDS = 0.05, 0.15, 25.0


@dataclass(frozen=True)
class Run:
    """Repetitions without a pause, every `dt` [s]: `samples` (T, 6) = [p; v; f], `repetition` (T,) 1.., `part` (T,)
    index of PARTS."""

    dt: float
    samples: np.ndarray
    repetition: np.ndarray
    part: np.ndarray

    def pieces(self, part: int) -> list:
        """The samples of every traversal of a part, in order."""
        return [self.samples[(self.part == part) & (self.repetition == k)] for k in np.unique(self.repetition)]


def _path():
    """(arc length, points (N, 2), part, pace-setting speed) along one repetition."""
    phi = np.linspace(0.0, 4.0 * np.pi, 8001)
    petals = phi < 2.0 * np.pi
    radius = np.where(petals, CENTRE + PETAL * np.sin(2.0 * phi) ** 2, CENTRE)
    points = radius[:, None] * np.stack([np.cos(phi - np.pi / 2), np.sin(phi - np.pi / 2)], axis=1)
    d1, d2 = np.gradient(points, phi, axis=0), np.gradient(np.gradient(points, phi, axis=0), phi, axis=0)
    curvature = np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.linalg.norm(d1, axis=1) ** 3
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    part = np.where(petals, np.minimum((phi / (np.pi / 2)).astype(int), 3), 4)
    return arc, points, part, (curvature + 5.0) ** (-1.0 / 3.0)


def _slow(rng, t, deviation, periods=(3.0, 30.0), count=8):
    """A sum of sines of random period, amplitude and phase with the standard deviation."""
    period = np.exp(rng.uniform(*np.log(periods), size=count))
    amplitude = rng.normal(size=count)
    amplitude *= deviation * np.sqrt(2.0 / np.sum(amplitude**2))
    return np.sin(2.0 * np.pi * t[:, None] / period + rng.uniform(0.0, 2.0 * np.pi, size=count)) @ amplitude


def person(seed: int, repetitions: int, dt: float = 0.05) -> Run:
    """All that a person does."""
    rng = np.random.default_rng([31, seed])
    arc, points, part, speed = _path()
    arrival = np.concatenate([[0.0], np.cumsum(np.diff(arc) * 2.0 / (speed[1:] + speed[:-1]))])
    arrival /= arrival[-1]
    size, seconds = np.exp(OWN_SIZE * rng.normal()), SECONDS * np.exp(OWN_PACE * rng.normal())
    lengths = seconds * np.exp(PACE * rng.normal(size=repetitions))
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    t = np.arange(0.0, knots[-1], ROUGH)
    phase = np.interp(t, knots, np.arange(repetitions + 1.0))
    turn = np.minimum(phase.astype(int), repetitions - 1)
    within = phase - turn
    x = size * np.stack([np.interp(within, arrival, column) for column in points.T], axis=1)
    x += np.stack([_slow(rng, t, WANDER) for _ in range(2)], axis=1)
    # knots far apart: the spline smooths corners of path and pace, and has two derivatives
    coarse = slice(None, None, 100)
    spline = CubicSpline(t[coarse], x[coarse])
    at = np.arange(t[coarse][0], t[coarse][-1], dt)
    p, v, a = spline(at), spline(at, 1), spline(at, 2)
    index = np.minimum(np.searchsorted(t, at), len(t) - 1)
    parts = part[np.minimum(np.searchsorted(arrival, within[index]), len(part) - 1)]
    return Run(dt, np.hstack([p, v, MASS * a + DAMPING * v]), turn[index] + 1, parts)
