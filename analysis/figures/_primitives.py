"""What the figures of section 3.1.3 compute: how a partner that learns predicts the flower, with and without window
HMM. All learning, recognition and prediction is that of the C++ library; times are in samples of 20 Hz."""

import numpy as np
import phri_core
import phri_learning

from phri_analysis.errors import DataError

from . import _flower

DT, HORIZON, STATES, MEMBERS, WINDOW, WINDOW_STATES = 0.05, 0.3, 10, 3, 30, 20  # of the thesis
STEPS = round(HORIZON / DT)


def options(reference: str = "path", blend: int | None = None):
    """The thesis' setting; everything else is the library's default."""
    result = phri_learning.EmergingOptions()
    result.dt, result.horizon, result.states, result.members = DT, HORIZON, STATES, MEMBERS
    result.window, result.window_states, result.reference = WINDOW, WINDOW_STATES, reference
    if blend is not None:
        result.blend = blend
    return result


def observation(run: _flower.Run, i: int):
    sample = run.samples[i]
    return phri_core.Observation(run.dt * i, sample[:4], sample[4:])


def place(prediction) -> np.ndarray:
    """Predicted place at the horizon; NaN where nothing is predicted."""
    return np.full(2, np.nan) if prediction is None else np.asarray(prediction.desired_state[-1].mean)[:2]


def online(seed: int, repetitions: int, reference: str = "path") -> dict:
    """Person `seed`, with a learner that begins with nothing: `error` (T,) at the horizon, where the place is held
    while nothing is predicted, `predicted` (T,), `repetition` (T,), `velocity_error` (T,) of constant velocity;
    `primitives` per repetition known at its end, `segments`."""
    run = _flower.person(seed, repetitions, DT)
    chosen = options(reference)
    partner, learner = phri_learning.EmergingPartner(chosen), phri_learning.PrimitiveLearner(chosen)
    places = np.full((len(run.samples), 2), np.nan)
    known = np.zeros(len(run.samples), dtype=int)
    for i in range(len(run.samples)):
        partner.observe(observation(run, i))
        if partner.waiting_segments:
            partner.learn(learner)
        places[i] = place(partner.predict(HORIZON, DT))
        known[i] = len(learner.snapshot.nodes)
    x = run.samples[:, :2]
    now, ahead = x[:-STEPS], x[STEPS:]
    predicted = np.isfinite(places[:-STEPS]).all(axis=1)
    error = np.linalg.norm(np.where(predicted[:, None], places[:-STEPS], now) - ahead, axis=1)
    straight = now + HORIZON * run.samples[:-STEPS, 2:4]
    ends = [np.flatnonzero(run.repetition == k)[-1] for k in range(1, repetitions + 1)]
    return {
        "person": seed, "error": error, "predicted": predicted, "repetition": run.repetition[:-STEPS],
        "velocity_error": np.linalg.norm(straight - ahead, axis=1), "primitives": known[ends],
        "segments": learner.snapshot.library.segment_count,
    }  # fmt: skip


def taught(run: _flower.Run, last: int):
    """A learner that was given all parts of the first `last` repetitions, cut where they are."""
    learner = phri_learning.PrimitiveLearner(options(blend=0))
    for k in range(1, last + 1):
        for part in range(len(_flower.PARTS)):
            piece = run.samples[(run.repetition == k) & (run.part == part)]
            learner.add(phri_learning.CommittedSegment(piece, k > 1 or part > 0))
    return learner


def followed(learner, run: _flower.Run, repetition: int) -> dict:
    """One repetition predicted: `window` and `own` (T, 2) are places at the horizon by the window HMM and by the
    likeliest node's own model; `x` (T, 2) the present ones, `ahead` (T, 2) the true ones."""
    snapshot = learner.snapshot
    library = snapshot.library
    nodes = list(library.upper_nodes)
    if not nodes:
        raise DataError("no primitive was learned from the parts of the flower")
    models = [phri_learning.TimeHmm(STATES, dt=DT).fit(_branch(library, node)) for node in nodes]
    recogniser = phri_learning.PrimitiveRecogniser(library, window=WINDOW)
    partner = phri_learning.EmergingPartner(options(blend=0))
    partner.adopt(snapshot)
    mine = np.flatnonzero(run.repetition == repetition)
    begin, end = mine[0] - WINDOW, min(mine[-1] + 1, len(run.samples) - STEPS)
    window, own, likeliest = [], [], []
    for i in range(begin, end):
        partner.observe(observation(run, i))
        best = int(np.argmax([entry.log_likelihood for entry in recogniser.filter(run.samples[i])]))
        if i < mine[0]:
            continue
        recent = run.samples[i - WINDOW + 1 : i + 1]
        mean, _ = models[best].predict(recent, HORIZON, reference="path", time="entry_corrected")
        window.append(place(partner.predict(HORIZON, DT)))
        own.append(mean[:2])
        likeliest.append(nodes[best])
    span = np.arange(mine[0], end)
    return {
        "t": DT * (span - span[0]), "x": run.samples[span, :2], "ahead": run.samples[span + STEPS, :2],
        "part": run.part[span], "window": np.array(window), "own": np.array(own), "node": np.array(likeliest),
    }  # fmt: skip


def _branch(library, node):
    """Samples of the segments that a node and what is below it remember."""
    entry = library.node(node)
    return [*entry.samples(), *(piece for child in entry.children for piece in _branch(library, child))]
