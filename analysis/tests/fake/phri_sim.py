"""Stands in for the C++ module phri_sim where a test is about how work is spread, not about simulation."""

from types import SimpleNamespace

import synthetic

CONTROLLERS = ("none", "lqr", "mahalanobis")


class Experiment:
    def __init__(self, name, overrides):
        if "model/state" in overrides:
            raise ValueError(f"{name}: 1 error\n  model/state = 5: unknown key; did you mean model/states?")
        if name == "absent":
            raise ValueError('experiment "absent": no such file, and no share/config/experiments/absent.yaml')
        if name.endswith(".yaml"):
            raise ValueError(
                f"{name}: 2 errors\n  learner/states = 0, expected 1 to 500\n  sedd: unknown key, did you mean seed?"
            )
        self.name = name
        self.seed = 7


def schedule(experiment, participants, trials, seed):
    return [
        SimpleNamespace(participant=participant, controller=controller, seed=seed, trials=trials or 3)
        for participant in range(1, (participants or 2) + 1)
        for controller in CONTROLLERS
    ]


def run_block(experiment, block):
    if experiment.name == "breaks":
        raise RuntimeError("the tick faulted:\nnot finite")
    tables = []
    for trial in range(1, block.trials + 1):
        table = synthetic.plausible_trial(block.participant, block.controller, trial, block.seed).iloc[:3000]
        table.attrs["evaluated"] = trial == block.trials
        tables.append(table)
    return tables
