#!/usr/bin/python3
"""From LQR to risk-averse obstacle avoidance, in four steps. Its twin is risk_averse.cpp, line for line."""
import numpy as np
from phri_control import CostCumulants, RiskSensitive, solve_iterative

HORIZON = 40
DT = 0.05  # [s]
GOAL, OBSTACLE = np.array([1.0, 0.0]), np.array([0.5, 0.1])
bump_height = 0.0


# 1. A mass of 1 kg with 1 Ns/m of damping in the plane: x = [position; velocity], u = force [N].
def mass(_k, x, u):
    return np.concatenate([x[:2] + DT * x[2:], x[2:] + DT * (u - x[2:])])


# 2. It walks to the goal and pays for coming near the obstacle. Derivatives are not given: central differences.
def running(_k, x, u):
    bump = bump_height * np.exp(-0.5 * np.sum((x[:2] - OBSTACLE) ** 2) / 0.09)
    return DT * (0.5 * np.sum((x[:2] - GOAL) ** 2) + 0.005 * np.sum(u ** 2) + bump)


def terminal(x):
    return 2.0 * np.sum((x[:2] - GOAL) ** 2) + 0.2 * np.sum(x[2:] ** 2)


def show(name, result):
    nearest = min(np.linalg.norm(x[:2] - OBSTACLE) for x in result.states)
    print(f"{name:12s} {result.status:10s} share {result.share:.2f}  cost {result.cost:.4f}  "
          f"criterion {result.criterion:.4f}  nearest {nearest:.4f} m  gain {result.gains[0, 0, 0]:.2f} N/m")


def main():
    global bump_height

    # 3. Every step moves the position by 2 cm (standard deviation) at random.
    def solve(attitude):
        return solve_iterative(mass, running, np.zeros(4), HORIZON, controls=2, terminal_cost=terminal,
                               noise={"position": 0.02 * np.eye(4, 2)}, attitude=attitude)

    # 4. Without the obstacle this is LQR. With it, theta > 0 makes the walker averse to a spread of the cost, theta < 0
    #    fond of it. Past a limit there is no policy: the solver says so and falls back to what exists.
    show("LQR", solve(RiskSensitive([0.0])))
    bump_height = 0.3
    show("neutral", solve(RiskSensitive([0.0])))
    show("averse", solve(RiskSensitive([100.0])))
    show("seeking", solve(RiskSensitive([-50.0])))
    show("mean-var.", solve(CostCumulants([[50.0]])))
    show("too averse", solve(RiskSensitive([1000.0])))


if __name__ == "__main__":
    main()
