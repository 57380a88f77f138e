"""What the thesis says of figures 4.4 to 4.10, held against our numbers."""

import numpy as np

from . import _scene_panels, finding

LITTLE = 0.1  # "little difference", "almost": a tenth
STRONG = 0.5  # "dramatically": less than half
START = 0.25  # share of the horizon that is "the beginning"


def of(figure: str, panels: list) -> list:
    by_letter = {panel.letter: panel for panel in panels}
    found = list({"4.4": _goal, "4.5": _obstacle, "4.6": _both, "4.7": _static, "4.8": _noise,
                  "4.9": _plant, "4.10": _plant}[figure](by_letter))
    if figure == "4.9":
        found += _plant_static(by_letter)
    return [*found, *_exists(panels), *_valid(panels)]


def _list(names, values, unit=""):
    return ", ".join(f"{name}: {value:.4g}" for name, value in zip(names, values)) + unit


def _compare(panels, letters, measure, unit):
    return _list(letters, [measure(panels[letter]) for letter in letters], f" {unit}" if unit else "")


def _gain(body):
    return lambda panel: panel.strength(body)


def _all(panels, letters, measure, more: bool) -> bool:
    reference = measure(panels["a"])
    return all((measure(panels[letter]) > reference) == more for letter in letters)


def _goal(panels):
    gain, tracking = _gain("goal"), _scene_panels.Panel.tracking
    yield finding(_all(panels, "e", gain, False), "risk-seeking (e) has lower goal gains than the neutral policy",
                  _compare(panels, "ae", gain, "N/m"))
    yield finding(_all(panels, "e", tracking, True), "(e) tracks the position less accurately",
                  _compare(panels, "ae", tracking, "m RMS"))
    yield finding(_all(panels, "i", gain, True), "the risk-averse policy (i) has higher goal gains",
                  _compare(panels, "ai", gain, "N/m"))
    yield finding(_all(panels, "fgh", gain, True), "averse cumulants (f, g, h) have higher goal gains",
                  _compare(panels, "afgh", gain, "N/m"))
    yield finding(_all(panels, "fghi", tracking, False), "averse policies (f to i) track more accurately",
                  _compare(panels, "afghi", tracking, "m RMS"))
    change = [abs(gain(panels[letter]) / gain(panels["a"]) - 1.0) for letter in "bcd"]
    yield finding(max(change) < LITTLE, "seeking cumulants (b, c, d) differ little from the neutral policy",
                  "change of the goal gain " + _list("bcd", change))


def _obstacle(panels):
    goal, obstacle, nearest = _gain("goal"), _gain("obstacle"), _scene_panels.Panel.nearest
    ratio = obstacle(panels["e"]) / obstacle(panels["a"])
    yield finding(ratio < STRONG, "seeking (e) lowers the obstacle gains dramatically",
                  _compare(panels, "ae", obstacle, "N/m"))
    yield finding(_all(panels, "e", goal, True), "(e) raises the goal gains", _compare(panels, "ae", goal, "N/m"))
    yield finding(_all(panels, "i", nearest, True), "averse (i) keeps farther from the obstacle",
                  _compare(panels, "ai", nearest, "m"))
    yield finding(_all(panels, "fgh", nearest, True), "averse cumulants (f, g, h) keep farther from the obstacle",
                  _compare(panels, "afgh", nearest, "m"))
    yield finding(nearest(panels["h"]) == max(nearest(panels[letter]) for letter in "fgh"),
                  "of these the fourth cumulant (h) keeps farthest", _compare(panels, "fgh", nearest, "m"))
    yield finding(_all(panels, "bcd", nearest, False), "seeking cumulants (b, c, d) come closer to the obstacle",
                  _compare(panels, "abcd", nearest, "m"))
    yield finding(nearest(panels["d"]) == min(nearest(panels[letter]) for letter in "bcd"),
                  "of these the fourth cumulant (d) comes closest", _compare(panels, "bcd", nearest, "m"))


def _deviation(panel, other, until=1.0):
    count = max(2, round(until * len(panel.result.states)))
    return float(np.linalg.norm(panel.places("robot") - other.places("robot"), axis=1)[:count].max())


def _both(panels):
    tracking, nearest = _scene_panels.Panel.tracking, _scene_panels.Panel.nearest
    other = {panel.letter: panel for panel in _scene_panels.solved("4.5", ("4.5",)) if panel.letter in "fi"}
    apart = _deviation(panels["b"], panels["a"])
    yield finding(apart > LITTLE * panels["a"].distance("goal")[0],
                  "the mean-variance trajectory (b) clearly differs from the neutral one",
                  f"largest distance {apart:.4g} m")
    for letter, alone in (("b", "f"), ("c", "i")):
        yield finding(nearest(panels[letter]) > nearest(other[alone]),
                      f"seeking in the goal, ({letter}) avoids the obstacle more than 4.5({alone})",
                      f"{nearest(panels[letter]):.4g} against {nearest(other[alone]):.4g} m")
    yield finding(tracking(panels["b"]) > tracking(other["f"]), "(b) tracks the goal less accurately than 4.5(f)",
                  f"{tracking(panels['b']):.4g} against {tracking(other['f']):.4g} m RMS")
    near = nearest(panels["b"]) - nearest(other["f"]), nearest(panels["c"]) - nearest(other["i"])
    yield finding(near[1] < near[0], "the effect in (c) is less remarkable than in (b)",
                  f"{near[1]:.3g} against {near[0]:.3g} m of distance")


def _static(panels):
    obstacle, tracking = _gain("obstacle"), _scene_panels.Panel.tracking
    early, whole = (_deviation(panels["b"], panels["a"], until) for until in (START, 1.0))
    yield finding(early > STRONG * whole, "(b) deviates most at the beginning, where the obstacle is near",
                  f"{early:.4g} m in the first quarter, {whole:.4g} m in all")
    yield finding(obstacle(panels["b"]) < LITTLE * obstacle(panels["a"]), "(b) almost nullifies the obstacle gains",
                  _compare(panels, "ab", obstacle, "N/m"))
    yield finding(_all(panels, "b", tracking, True), "(b) tracks the goal less accurately",
                  _compare(panels, "ab", tracking, "m RMS"))
    places = panels["a"].places("robot")
    pushes = []
    for belief in panels["a"].scene.static_obstacles:
        bump = belief.expected()
        pushes.append(float(np.mean([np.linalg.norm(bump.expand(place)[1]) for place in places])))
    yield finding(pushes[0] < pushes[1], "the static obstacle of low variance pushes the robot less than the other",
                  _list(("variance 0.1", "variance 0.5"), pushes, " 1/m, mean slope of the expected cost along (a)"))


def _noise(panels):
    apart = {letter: _deviation(panel, _scene_panels.neutral(panel)) for letter, panel in panels.items()}
    values = list(apart.values())
    yield finding(all(a > b for a, b in zip(values, values[1:])), "less noise brings the policy to the neutral one",
                  _list(apart, values, " m from it at most"))
    yield finding(values[-1] < LITTLE * values[0], "(d) is almost the neutral policy", f"{values[-1]:.3g} m")


def _plant(panels):
    nearest = _scene_panels.Panel.nearest

    def early(panel):
        away = panel.distance("goal")
        return float(np.sqrt(np.mean(away[: max(2, round(START * len(away)))] ** 2)))

    yield finding(_all(panels, "b", early, True), "(b) is driven away from the goal at the beginning",
                  _compare(panels, "ab", early, "m RMS in the first quarter"))
    yield finding(_all(panels, "b", nearest, True), "(b) keeps farther from the moving obstacle",
                  _compare(panels, "ab", nearest, "m"))


def _plant_static(panels):
    static = _scene_panels.Panel.static_distance
    yield finding(_all(panels, "b", static, True), "(b) keeps farther from the static obstacle",
                  _compare(panels, "ab", static, "m"))


def _exists(panels):
    less = [panel for panel in panels if panel.reduced]
    yield finding(not less, "every panel has a policy with the weights of the caption",
                  "; ".join(f"({panel.letter}) {panel.result.message}" for panel in less) or "all converged")


def _valid(panels):
    scenes = {panel.scene.name: panel for panel in panels}
    spreads = {panel.letter: value for panel in scenes.values() for value in panel.scene.obstacle_spread}
    if not spreads:
        return
    name = "spread over width" if len(spreads) == 1 else "spread over width by panel"
    evidence = f"{next(iter(spreads.values())):.3g}" if len(spreads) == 1 else _list(spreads, spreads.values())
    yield finding(all(value <= 1.0 for value in spreads.values()),
                  "the obstacle spreads less than its cost's width, so that the quadratic model means something",
                  f"{name} {evidence}")
