#!/usr/bin/python3
"""The Riccati recursion as one writes it in plain Python with numpy: the same problems, all gains, no feedforward."""

import numpy as np
import peer


class Riccati:
    def __init__(self, problem):
        self.a, self.b, self.r = (np.array(problem[key]) for key in "ABR")
        self.q = [np.array(weight) for weight in problem["Q"]]

    def solve(self):
        a, b = self.a, self.b
        value, gains = self.q[-1], []
        for weight in reversed(self.q[:-1]):
            gain = -np.linalg.solve(self.r + b.T @ value @ b, b.T @ value @ a)
            value = weight + a.T @ value @ (a + b @ gain)
            gains.append(gain)
        return gains[::-1]


def main():
    problems = peer.read_case()["lq"]
    lqr, mahalanobis = Riccati(problems["lqr"]), Riccati(problems["mahalanobis"])
    same_lqr = peer.difference(lqr.solve()[0], problems["lqr"]["gain"])
    same_mahalanobis = peer.difference(mahalanobis.solve()[0], problems["mahalanobis"]["gain"])
    checks = {"plan_lqr": same_lqr, "plan_mahalanobis": same_mahalanobis, "lq_solve": same_mahalanobis}

    def measure(seconds):
        varying = peer.mean_time(mahalanobis.solve, seconds)
        return {"plan_lqr": peer.mean_time(lqr.solve, seconds), "plan_mahalanobis": varying, "lq_solve": varying}

    peer.serve(f"numpy {np.__version__}", checks, measure)


if __name__ == "__main__":
    main()
