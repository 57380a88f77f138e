"""Figures 4.4 to 4.10: trajectories and gains per attitude, and what they do in the true cost (section 4.6)."""

import pandas as pd

from phri_analysis.errors import DataError

from . import Page, _scene_findings, _scene_panels, _scene_pictures, finding

IDS = ("4.4", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10")
SEED = 44  # of the roll-outs
SCENES = {"4.8": ("4.8a", "4.8b", "4.8c", "4.8d")}  # all others: one of the same name
SPACING = {"4.10": 0.2}  # [s] between the dots, 0.02 in all others
COLUMNS = {"4.4": 3, "4.5": 3, "4.6": 3, "4.8": 4}
TEXTS = {
    "4.4": ("Point mass tracking an uncertain goal",
            "A point mass follows a passive goal with noise, for nine attitudes to that noise. Seeking lowers the "
            "feedback gains and loosens the tracking, aversion does the opposite; seeking cumulants hardly differ from "
            "the expected cost, their weights being close to the limit of existence."),
    "4.5": ("Point mass among a goal and an uncertain obstacle",
            "The noise of a moving obstacle alone. The seeking risk-sensitive policy lets go of the obstacle gains, "
            "averse ones move the trajectory away from the obstacle, seeking cumulants move it closer."),
    "4.6": ("Uncertain goal and obstacle together",
            "Seeking in the goal, averse in the obstacle: looser tracking makes room for a wider berth than aversion "
            "to the obstacle alone gives in figure 4.5."),
    "4.7": ("Driven goal and obstacle, static uncertain obstacles",
            "With driven movers and two static obstacles the mean-variance policy deviates at the beginning and gives "
            "up the obstacle gains; of two static obstacles the one with the larger variance is felt more."),
    "4.8": ("The same with less and less noise",
            "The mean-variance policy of figure 4.7 for smaller infinitesimal variances approaches the neutral one."),
    "4.9": ("Two-link arm",
            "The setting of the point mass with an arm: aversion to the obstacle drives it from the goal at the "
            "beginning, which seeking in the goal supports; the static obstacle is avoided more."),
    "4.10": ("Car-like robot",
             "A car tracks a car: freedom from the goal allows deviations that avoid the obstacle better."),
}
COMMON = (
    "The captions' gamma are bases of the weights, as in the author's scripts; the weights used stand in the table.",
    "The author's stored scripts have other costs than the text (no 1/2, R = 1e-4 or 1e-5, obstacle weights 0.1 and "
    "0.01, negative curvature projected away): neither alone fixes the settings of the figures. Ours are the text's.",
    "Solutions are fixed points max |l| < 1e-6 in the joint state, with the obstacle's exact, indefinite curvature and "
    "the factor r of (4.36) that (4.37) drops.",
    "Where the weights of a caption have no policy, the picture and all numbers are of the share of them that is given "
    "(negative cumulants' weights or positive thetas; where solutions end without a breakdown, all weights).",
    "Ellipses: image of the unit circle under the gain on the position (singular values along the left singular "
    "vectors), on the goal drawn at the robot, on the obstacle at the obstacle; dashed ones are cut.",
)


def page(id, options) -> Page:
    names = SCENES.get(id, (id,))
    panels = _scene_panels.solved(id, names)
    title, thesis = TEXTS[id]
    pays, sentences = rolled_out(panels, options)
    assumed = tuple(dict.fromkeys(f"Assumed: {text}." for panel in panels for text in panel.assumed))
    gains = () if id != "4.10" else ("Gains are in the data; like the thesis' the picture has trajectories only.",)
    tables = {"status": _scene_panels.statuses(panels), "cumulants": _scene_panels.cumulants(panels)}
    return Page(
        id=id,
        title=title,
        thesis=thesis,
        setting=_setting(panels, options),
        deviations=(*assumed, *COMMON, *gains),
        data=_scene_panels.data(panels),
        figure=_scene_pictures.trajectories(panels, SPACING.get(id, 0.02), COLUMNS.get(id, 2), id != "4.10"),
        findings=(*_scene_findings.of(id, panels), *sentences),
        tables=tables if pays is None else tables | {"rollouts": pays},
    )


def _setting(panels, options) -> dict:
    scenes = {panel.scene.name: panel for panel in panels}
    described = {}
    for name, panel in scenes.items():
        scene = panel.scene
        described[name] = {
            "step": scene.dt,
            "horizon": scene.horizon,
            "start": scene.start.tolist(),
            "control_weight": scene.control_weight.tolist(),
            "noise": {source: (factor @ factor.T).diagonal().tolist() for source, factor in scene.noise.items()},
            "static_obstacles": [
                {"mean": obstacle.mean.tolist(), "covariance": obstacle.covariance.tolist()}
                for obstacle in scene.static_obstacles
            ],
        }
    weights = {panel.letter: _scene_panels.weights(panel.attitude) for panel in panels}
    return {"scenes": described, "weights": weights, "rollouts": options.rollouts, "seed": SEED}


def rolled_out(panels, options):
    """The table of stochastic roll-outs with what it says: does the attitude pay in the true cost? Scene by scene, as
    policies are compared with the neutral one of their scene."""
    from ._rollouts import compare

    tables, sentences = [], []
    for scene in dict.fromkeys(panel.scene.name for panel in panels):
        of_scene = [panel for panel in panels if panel.scene.name == scene]
        reference = _scene_panels.neutral(of_scene[0]).result
        for panel in of_scene:
            letter = panel.letter
            try:
                tables.append(compare(panel.scene, {letter: panel.result}, {letter: panel.attitude},
                                      rollouts=options.rollouts, seed=SEED, reference=reference))
            except DataError as error:
                sentences.append(f"no roll-outs of ({letter}): {error}")
    if not tables:
        return None, sentences
    table = pd.concat(tables).reset_index()
    return table, [*_does_it_pay(table), *sentences]


def _does_it_pay(table):
    asked = table[table["verdict"] != "reference"]

    def letters(column, verdict):
        return ", ".join(asked["panel"][asked[column] == verdict]) or "none"

    for column, what in (("verdict", "its own criterion"), ("verdict_mean", "the mean of the true cost"),
                         ("verdict_variance", "its variance"), ("verdict_collisions", "collisions")):
        yield finding(bool(len(asked)) and bool((asked[column] == "pays").all()),
                      f"in roll-outs, against the neutral policy, the attitude pays in {what}",
                      f"pays: {letters(column, 'pays')}; costs: {letters(column, 'costs')}; "
                      f"no difference: {letters(column, 'no difference')}")
