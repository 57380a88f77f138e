"""Random linear-quadratic problems with every field in use, for the tests of the Python surface."""
import numpy as np


def random_arguments(rng, n, m, horizon, keep=1.0, spread=0.3, linear=1.0, drift=1.0):
    """Arguments of a time-varying affine problem, all stacked over the stages: A = keep I + spread N(0, 1); q and r of
    size `linear`."""

    def definite(size):
        root = rng.normal(size=(horizon, size, size))
        return root @ root.transpose(0, 2, 1) / size + 0.1 * np.eye(size)

    return {
        "A": keep * np.eye(n) + spread * rng.normal(size=(horizon, n, n)),
        "B": rng.normal(size=(horizon, n, m)),
        "Q": definite(n),
        "R": definite(m),
        "q": linear * rng.normal(size=(horizon, n)),
        "r": linear * rng.normal(size=(horizon, m)),
        "terminal_Q": definite(n)[0],
        "terminal_q": rng.normal(size=n),
        "drift": drift * rng.normal(size=(horizon, n)),
    }
