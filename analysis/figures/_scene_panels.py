"""The panels of figures 4.4 to 4.10 solved, their trajectories and gains as tables, and what findings measure."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import phri_control

MAX_ITERATIONS = 200  # of both phases; the followed panel (4.5e) needs most
CUMULANTS = 4


@dataclass(frozen=True)
class Panel:
    """One panel of a figure: its scene, what was asked for and the result."""

    letter: str
    name: str
    attitude: object
    scene: object
    result: object
    assumed: tuple

    @property
    def reduced(self) -> bool:
        return self.result.share < 1.0

    def places(self, body: str) -> np.ndarray:
        """(T + 1, 2) positions [m] of the nominal."""
        states = self.result.states
        if body != "robot":
            begin = self.scene.movers[body]
            return states[:, begin : begin + 2]
        robot = self.scene.robot
        own = states[:, : robot.state_size]
        if hasattr(robot, "end_effector"):  # the arm's state is its joints
            return np.array([robot.end_effector(q) for q in own[:, :2]])
        return own[:, :2]

    def gains(self, body: str) -> np.ndarray:
        """(T, 2, 2) gains on the position of a mover [N/m], the L_x of the thesis."""
        begin = self.scene.movers[body]
        return self.result.gains[:, :, begin : begin + 2]

    def strength(self, body: str) -> float:
        """Gain on a mover: the root of the time mean of |L|^2 (Frobenius) [N/m]."""
        return float(np.sqrt(np.mean(np.sum(self.gains(body) ** 2, axis=(1, 2)))))

    def distance(self, body: str) -> np.ndarray:
        """(T + 1,) from the robot [m]."""
        return np.linalg.norm(self.places("robot") - self.places(body), axis=1)

    def static_distance(self) -> float:
        """Smallest distance to the mean of a static obstacle [m]."""
        robot = self.places("robot")
        return min(np.linalg.norm(robot - obstacle.mean, axis=1).min() for obstacle in self.scene.static_obstacles)

    def tracking(self) -> float:
        """Root mean square distance to the goal [m]."""
        return float(np.sqrt(np.mean(self.distance("goal") ** 2)))

    def nearest(self) -> float:
        """Smallest distance to the moving obstacle [m]."""
        return float(self.distance("obstacle").min())


def solved(figure: str, names: tuple) -> list:
    """The panels of the scenes `names` of a figure, in order."""
    panels = []
    for name in names:
        thesis = phri_control.thesis_scene(name)
        for panel in thesis.panels:
            result = thesis.scene.solve(panel.attitude, max_iterations=MAX_ITERATIONS, cumulants=CUMULANTS)
            panels.append(
                Panel(panel.panel, panel.name, panel.attitude, thesis.scene, result, tuple(thesis.assumed))
            )
    return panels


def neutral(panel: Panel) -> Panel:
    """The risk-neutral solution of a panel's scene."""
    result = panel.scene.solve(max_iterations=MAX_ITERATIONS, cumulants=CUMULANTS)
    attitude = phri_control.RiskSensitive([0.0] * len(panel.scene.noise))
    return Panel("0", "expected cost", attitude, panel.scene, result, panel.assumed)


def data(panels) -> pd.DataFrame:
    """One row per panel and sample: time [s], positions [m], controls and the gains on the movers' positions."""
    tables = []
    for panel in panels:
        count = len(panel.result.states)
        table = {"panel": panel.letter, "sample": np.arange(count), "time": panel.scene.dt * np.arange(count)}
        for body in ("robot", *panel.scene.movers):
            places = panel.places(body)
            table |= {f"{body}_x": places[:, 0], f"{body}_y": places[:, 1]}
        last = np.full((1, 2), np.nan)  # there is no control at the last sample
        controls = np.vstack([panel.result.controls, last])
        table |= {"u_1": controls[:, 0], "u_2": controls[:, 1]}
        for body in panel.scene.movers:
            gains = np.vstack([panel.gains(body).reshape(-1, 4), np.full((1, 4), np.nan)])
            table |= {f"gain_{body}_{i}{j}": gains[:, 2 * i + j - 3] for i in (1, 2) for j in (1, 2)}
        tables.append(pd.DataFrame(table))
    return pd.concat(tables, ignore_index=True)


def weights(attitude) -> str:
    """An attitude in symbols."""
    thetas = getattr(attitude, "theta", None)
    if thetas is not None:
        return "theta = " + ", ".join(f"{theta:g}" for theta in thetas)
    rows = [
        " ".join(f"{weight:+.4g} k{order}" for order, weight in enumerate(row, 2) if weight)
        for row in np.atleast_2d(attitude.gamma)
    ]
    return "; ".join(row or "k1" for row in rows)


def statuses(panels) -> pd.DataFrame:
    """How the solver ended, one row per panel. `trials`: backward passes, one for each trial step and each check."""
    rows = []
    for panel in panels:
        result = panel.result
        rows.append(
            {
                "panel": panel.letter,
                "attitude": panel.name,
                "weights": weights(panel.attitude),
                "status": result.status,
                "share": result.share,
                "iterations": result.iterations,
                "trials": result.passes,
                "max_l": result.max_feedforward,
                "criterion": result.criterion,
                "cost": result.cost,
                "message": result.message,
            }
        )
    return pd.DataFrame(rows)


def cumulants(panels) -> pd.DataFrame:
    """Of J in the quadratic model at the nominal, source by source."""
    rows = []
    for panel in panels:
        for source, kappa in zip(panel.scene.noise, panel.result.cumulants):
            row = {"panel": panel.letter, "source": source}
            rows.append(row | {f"kappa_{order}": value for order, value in enumerate(kappa, 1)})
    return pd.DataFrame(rows)
