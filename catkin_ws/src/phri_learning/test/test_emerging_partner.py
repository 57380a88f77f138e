"""The emerging partner from Python: the same class, options by name, knowledge across threads and files."""

import threading

import numpy as np
import phri_core
import phri_learning
import pytest

DT = 0.05  # [s]


def flower(repetitions, seed, petals=5, turn=0.0):
    """(T, 6) [x; xdot; u_h] along r = a (1 + b cos(petals phi)) at about 0.05 m/s, with noise of radius and pace."""
    random = np.random.default_rng(seed)
    points, phi, size, pace = [], 0.0, 0.0, 0.0
    while phi < 2 * np.pi * repetitions:
        size += 0.02 * (-size + 0.03 * random.normal())
        pace += 0.05 * (-pace + 0.2 * random.normal())
        r = 0.06 * (1 + 0.5 * np.cos(petals * phi)) * (1 + size)
        points.append([r * np.cos(phi + turn), r * np.sin(phi + turn)])
        phi += 0.05 * (1 + pace) / np.hypot(r, 0.03 * petals * np.sin(petals * phi)) * DT
    x = np.array(points)
    v = np.gradient(x, DT, axis=0)
    return np.hstack([x, v, 40 * np.gradient(v, DT, axis=0) + 90 * v])


def observe(partner, k, sample):
    partner.observe(phri_core.Observation(k * DT, sample[:4], sample[4:]))


def test_learns_beside_a_thread_and_predicts():
    options = phri_learning.EmergingOptions()
    assert (options.reference, options.time, options.recognition, options.progress) == \
        ("path", "regressed", "motion", "position")
    partner, learner = phri_learning.EmergingPartner(options), phri_learning.PrimitiveLearner(options)
    samples = flower(5, 1)
    repetition = len(samples) // 5
    errors, straight, before = [], [], 0

    def learn(segments):
        for segment in segments:
            learner.add(segment)

    for k, sample in enumerate(samples[:-6]):
        observe(partner, k, sample)
        prediction = partner.predict(0.3, DT)
        before += prediction is not None and k < 2 * repetition
        if prediction is not None and k > 4 * repetition:
            errors.append(np.linalg.norm(prediction.desired_state[-1].mean[:2] - samples[k + 6, :2]))
            straight.append(np.linalg.norm(sample[:2] + 0.3 * sample[2:4] - samples[k + 6, :2]))
        if k % 40 == 0:
            thread = threading.Thread(target=learn, args=(partner.take_segments(),))
            thread.start()
            thread.join()
            partner.adopt(learner.snapshot)
    assert before == 0
    assert len(errors) > 0.9 * repetition
    assert np.mean(errors) < np.mean(straight)
    assert partner.lost_segments == 0
    known = learner.snapshot
    assert partner.primitive in known.nodes
    assert known.library.segment_count > 30
    assert set(known.successors) <= set(known.nodes) | {-1}


def test_knowledge_survives_a_file_and_recognises(tmp_path):
    options = phri_learning.EmergingOptions()
    options.reference = "displacement"
    options.queue = 100
    partner, learner = phri_learning.EmergingPartner(options), phri_learning.PrimitiveLearner(options)
    samples = flower(4, 2)
    for k, sample in enumerate(samples):
        observe(partner, k, sample)
    partner.reset()
    for segment in partner.take_segments():
        learner.add(segment)
    learner.to_json(str(tmp_path / "primitives.json"))
    again = phri_learning.PrimitiveLearner.from_json(options, str(tmp_path / "primitives.json"))
    assert again.snapshot.nodes == learner.snapshot.nodes
    library = again.snapshot.library
    recogniser = phri_learning.PrimitiveRecogniser(library)
    node = library.node(library.upper_nodes[0])
    for sample in node.samples()[-1]:
        entries = recogniser.filter(sample)
    assert recogniser.winner == 0
    assert len(entries) == len(library.upper_nodes)
    assert entries[0].log_likelihood == max(entry.log_likelihood for entry in entries)
    assert entries[0].progress > 0.8


def test_names_the_choices():
    options = phri_learning.EmergingOptions()
    with pytest.raises(ValueError, match="displacement"):
        options.reference = "nowhere"
    options.dof = 0
    with pytest.raises(ValueError, match="dof"):
        phri_learning.EmergingPartner(options)
