#!/usr/bin/python3
"""crocoddyl on the same linear-quadratic problems: one ActionModelLQR per stage, SolverDDP, one thread.

plan_*: computeDirection, that is the derivatives of all stages and one backward pass. lq_solve: the backward pass
alone. For a linear-quadratic problem one backward pass is the whole solution. Building the models is not timed.
"""

import crocoddyl
import numpy as np
import peer


class Solver:
    def __init__(self, problem):
        a, b, r = (np.array(problem[key]) for key in "ABR")
        n, m = b.shape
        models = [
            crocoddyl.ActionModelLQR(a, b, np.array(q), r, np.zeros((n, m)), np.zeros(n), np.zeros(n), np.zeros(m))
            for q in problem["Q"]
        ]
        self.shooting = crocoddyl.ShootingProblem(np.zeros(n), models[:-1], models[-1])
        self.shooting.nthreads = 1
        states, controls = [np.zeros(n)] * len(models), [np.zeros(m)] * (len(models) - 1)
        self.solver = crocoddyl.SolverDDP(self.shooting)
        self.solver.setCandidate(states, controls, False)
        self.shooting.calc(states, controls)
        self.plan()
        self.gain = -np.array(self.solver.K[0])  # crocoddyl's u = -K x

    def plan(self):
        self.solver.computeDirection(True)

    def backward(self):
        self.solver.backwardPass()


def main():
    problems = peer.read_case()["lq"]
    lqr, mahalanobis = Solver(problems["lqr"]), Solver(problems["mahalanobis"])
    same_mahalanobis = peer.difference(mahalanobis.gain, problems["mahalanobis"]["gain"])
    checks = {
        "plan_lqr": peer.difference(lqr.gain, problems["lqr"]["gain"]),
        "plan_mahalanobis": same_mahalanobis,
        "lq_solve": same_mahalanobis,
    }

    def measure(seconds):
        return {
            "plan_lqr": peer.mean_time(lqr.plan, seconds),
            "plan_mahalanobis": peer.mean_time(mahalanobis.plan, seconds),
            "lq_solve": peer.mean_time(mahalanobis.backward, seconds),
        }

    peer.serve(f"crocoddyl {crocoddyl.__version__}", checks, measure)


if __name__ == "__main__":
    main()
