#!/usr/bin/python3
"""hmmlearn on the same model and the same windows.

viterbi: GaussianHMM.decode of 30 samples, 40 states, six dimensions, full covariances, any state first.
prediction: decode over the two dimensions that tell the place, then the time in the movement and Gaussian mixture
regression over the horizon in numpy, with the same formulas as TimeHmmModel (entry-corrected time, mean (3.5), five
Gauss-Hermite nodes for the uncertain time). What does not depend on the window is computed beforehand, as in ours.
viterbi_S: decode of 30 samples in six dimensions with S states. baum_welch_S: one iteration of fit over 12
demonstrations of 500 samples in seven dimensions, no priors, implementation "scaling" (the faster one), from the same
parameters.
"""

import itertools
import json
import pathlib
import sys

import hmmlearn
import numpy as np
import peer
from hmmlearn.hmm import GaussianHMM


def gaussian_hmm(hmm, dimensions):
    means = np.array(hmm["mean_s"])[:, :dimensions]
    model = GaussianHMM(n_components=len(means), covariance_type="full")
    model.startprob_ = np.full(len(means), 1.0 / len(means))
    model.transmat_ = np.array(hmm["transition"])
    model.means_ = means
    model.covars_ = np.array(hmm["ss"])[:, :dimensions, :dimensions]
    return model


class Predictor:
    def __init__(self, case):
        hmm = case["hmm"]
        self.recogniser = gaussian_hmm(hmm, case["recognised"])
        self.dt, self.length = hmm["dt"], hmm["length"]
        self.mean, self.time, self.tt, ts = (np.array(hmm[key]) for key in ("mean_s", "mean_t", "tt", "ts"))
        self.durations, scale = np.array(hmm["durations"]), np.array(hmm["scale"])
        self.slope = ts / self.tt[:, None]
        self.conditional = np.array(hmm["ss"]) - ts[:, :, None] * ts[:, None, :] / self.tt[:, None, None]
        units = np.outer(scale, scale)
        for c, covariance in enumerate(self.conditional):
            values, vectors = np.linalg.eigh(covariance / units)
            values = np.maximum(values, hmm["covariance_floor"])
            self.conditional[c] = (vectors * values) @ vectors.T * units
        self.repeat = np.diag(hmm["repeat_variance"] * scale**2)
        self.pace_variance = hmm["pace_variance"]
        nodes, weights = np.polynomial.hermite_e.hermegauss(5)
        self.nodes, self.node_weights = nodes, weights / weights.sum()
        self.ahead = case["prediction_dt"] * np.arange(len(case["prediction"]["mean"]))

    def weights(self, times):
        """(..., S) of the states at times (...)."""
        log = -0.5 * (times[..., None] - self.time) ** 2 / self.tt - 0.5 * np.log(self.tt)
        h = np.exp(log - log.max(axis=-1, keepdims=True))
        return h / h.sum(axis=-1, keepdims=True)

    def lines(self, times):
        return self.mean + self.slope * (times[..., None] - self.time)[..., None]

    def predict(self, window):
        """Means (N, d) and covariances (N, d, d) of the samples expected from now on."""
        path = self.recogniser.decode(window)[1]
        state = path[-1]
        entered = np.flatnonzero(path != state)
        held = len(path) - 1 - (entered[-1] + 1 if len(entered) else 0)
        successor = min(state + 1, len(self.time) - 1)
        now = min(self.time[state] + self.dt * (held - 0.5 * (self.durations[state] - 1)),
                  self.time[successor] + 0.5 * self.dt * (self.durations[successor] - 1))
        variance = self.dt**2 * max(1.0, self.durations[state] ** 2) / 12 + self.pace_variance * self.ahead**2
        then = np.clip(now + self.ahead, 0.0, self.length)
        means = np.einsum("ns,nsd->nd", self.weights(then), self.lines(then))
        times = then[:, None] + np.sqrt(variance)[:, None] * self.nodes
        h = self.weights(times) * self.node_weights[:, None]
        deviation = self.lines(times) - means[:, None, None, :]
        covariances = np.einsum("nks,sde->nde", h, self.conditional)
        covariances += np.einsum("nksd,nkse->nde", h[..., None] * deviation, deviation) + self.repeat
        return means, covariances


class Training:
    """An iteration of Baum-Welch from the parameters of the case."""

    def __init__(self, before, demonstrations):
        self.before = {key: np.array(before[key]) for key in ("initial", "transition", "mean_s", "ss")}
        self.samples = np.concatenate(demonstrations)
        self.lengths = [len(x) for x in demonstrations]

    def iterate(self):
        model = GaussianHMM(n_components=len(self.before["mean_s"]), covariance_type="full", n_iter=1, init_params="",
                            implementation="scaling", covars_prior=0.0)
        model.startprob_, model.transmat_ = self.before["initial"][0], self.before["transition"]
        model.means_, model.covars_ = self.before["mean_s"], self.before["ss"]
        return model.fit(self.samples, self.lengths)

    def difference(self, case):
        model, after = self.iterate(), case["after"]
        return max(
            peer.difference(model.monitor_.history, [case["log_likelihood"]]),
            peer.difference(model.startprob_, after["initial"][0]),
            peer.difference(model.transmat_, after["transition"]),
            peer.difference(model.means_, after["mean_s"]),
            peer.difference(model.covars_, after["ss"]),
        )


def learning_calls(cases):
    """Calls and checks of the rows viterbi_S and baum_welch_S."""
    calls, checks = {}, {}
    demonstrations = [np.array(x) for x in cases.pop("demonstrations")]
    for states, case in cases.items():
        windows = [np.array(window) for window in case["windows"]]
        decoder, following = gaussian_hmm(case["tracked"], windows[0].shape[1]), itertools.cycle(windows)
        training = Training(case["before"], demonstrations)
        checks[f"viterbi_{states}"] = peer.difference(
            [decoder.decode(window)[1] for window in windows], np.array(case["paths"])[:, 0])
        checks[f"baum_welch_{states}"] = training.difference(case)
        calls[f"viterbi_{states}"] = lambda decode=decoder.decode, following=following: decode(next(following))
        calls[f"baum_welch_{states}"] = training.iterate
    return calls, checks


def main():
    np.seterr(divide="ignore")  # log of the forbidden transitions
    case = peer.read_case()
    windows = [np.array(window) for window in case["windows"]]
    decoder, predictor = gaussian_hmm(case["hmm"], windows[0].shape[1]), Predictor(case)
    place = windows[0][:, :case["recognised"]].copy()
    means, covariances = predictor.predict(place)
    paths = [decoder.decode(window)[1] for window in windows]
    states = np.array(case["prediction"]["mean"]).shape[1]
    checks = {
        "viterbi": peer.difference(paths, case["paths"]),
        "prediction": max(
            peer.difference(means[:, :states], case["prediction"]["mean"]),
            peer.difference(covariances[:, :states, :states], case["prediction"]["covariance"]),
        ),
    }
    following = itertools.cycle(windows)
    learning = json.loads(pathlib.Path(sys.argv[1]).with_name("hmm.json").read_text(encoding="utf-8"))
    calls, learning_checks = learning_calls(learning)
    checks.update(learning_checks)

    def measure(seconds):
        return {
            "viterbi": peer.mean_time(lambda: decoder.decode(next(following)), seconds),
            "prediction": peer.mean_time(lambda: predictor.predict(place), seconds),
            **{row: peer.mean_time(call, seconds) for row, call in calls.items()},
        }

    peer.serve(f"hmmlearn {hmmlearn.__version__}", checks, measure)


if __name__ == "__main__":
    main()
