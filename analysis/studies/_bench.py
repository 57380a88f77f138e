"""Test stands for one simulated participant: an empty room, a bend, a hand that holds still."""

import functools
import tempfile
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from phri_analysis.errors import DataError

from . import _people

RESOLUTION = 0.001  # [m/pixel]
SIZE = 300  # [pixel] 0.3 m, the workspace of the haptic device
ORIGIN = -0.15  # [m] of the lower left corner, both axes
DT = 0.001  # [s]


def free_room() -> np.ndarray:
    """Picture without a wall."""
    return np.full((SIZE, SIZE), 255, np.uint8)


def wave_room(width: float, amplitude: float, period: float) -> np.ndarray:
    """Picture of a channel [m] wide along y = amplitude sin(2 pi x / period)."""
    centres = ORIGIN + RESOLUTION * (np.arange(SIZE) + 0.5)
    x, y = np.meshgrid(centres, centres[::-1])
    line = np.linspace(ORIGIN, -ORIGIN, 1200)
    points = np.column_stack([line, amplitude * np.sin(2 * np.pi * line / period)])
    distance = np.full(x.shape, np.inf)
    for px, py in points:
        np.minimum(distance, np.hypot(x - px, y - py), out=distance)
    return np.where(distance < width / 2, 255, 0).astype(np.uint8)


def experiment(picture, start, goal, mass: float, damping: float, goal_radius: float = 0.006, timeout: float = 20.0):
    """Condition (a) in a picture without moving obstacles; a load of mass [kg] and damping [Ns/m]."""
    with tempfile.TemporaryDirectory() as folder:
        Image.fromarray(picture).save(Path(folder) / "room.png")
        scene = {
            "image": "room.png", "resolution": RESOLUTION, "origin": [ORIGIN, ORIGIN, 0.0], "occupied_thresh": 0.65,
            "free_thresh": 0.2, "negate": 0, "start": list(start), "goal": list(goal), "goal_radius": goal_radius,
            "object_radius": 0.003, "turning_x": ORIGIN,
        }  # fmt: skip
        path = Path(folder) / "room.yaml"
        path.write_text(yaml.safe_dump(scene))
        try:
            return _people.simulation().Experiment(_people.EXPERIMENT, {
                "controllers": ["none"], "scene": str(path), "timeout": timeout,
                "override/robots/admittance/mass": [mass, mass],
                "override/robots/admittance/damping": [damping, damping],
            })  # fmt: skip
        except (ValueError, RuntimeError) as error:
            raise DataError(" ".join(str(error).split())) from None


def move(loaded, person: int, seed: int):
    """One movement from start to goal: the trial's table."""
    return _people.simulation().run_alone(loaded, _people.simulation().TrialSpec(person, "none", 3, 3, 2, seed))


@functools.lru_cache(maxsize=1)
def _still():
    return experiment(free_room(), (0.0, 0.0), (0.1, 0.0), 90.0, 200.0)


def median_person(quiet: bool = True):
    """The person of all medians; quiet: without motor noise."""
    person = _people.simulation().Participant()
    for trait in _people.experiment().traits:
        setattr(person, trait.key, trait.median)
    if quiet:
        person.force_variation = person.force_noise = person.tremor = person.wander = 0.0
    return person


def partner(person, mass: float, damping: float, seed: int = 1):
    """The person alone, holding the middle of an empty room for as long as t = 0 is passed."""
    return _people.simulation().HumanPartner(_still(), person, 100, mass, damping, seed)


def pushed(person, mass: float, damping: float, push: float, by_robot: bool, seconds: float = 0.3):
    """A person holds an object still; from t = 0 a constant force [N] along y pushes it. Returns arrays along y per
    millisecond: velocity [m/s] at the end of each, force [N] by the person."""
    import phri_core

    human = partner(person, mass, damping)
    load = phri_core.Admittance(np.full(2, mass), np.full(2, damping), DT)
    load.reset(human.intended_position, np.zeros(2))
    force, silent = np.array([0.0, push]), np.zeros(2)
    velocities, forces = [], []
    for _ in range(round(seconds / DT)):
        hand = human.step(0.0, load.position, load.velocity, force if by_robot else silent)
        load.step(hand + force)
        velocities.append(load.velocity[1])
        forces.append(hand[1])
    return np.array(velocities), np.array(forces)


def settles(person, mass: float, damping: float, seconds: float = 20.0) -> bool:
    """Whether a person who holds still brings an object back that was put 20 mm aside: within 2 mm and 1 mm/s."""
    import phri_core

    human = partner(person, mass, damping)
    home = np.array(human.intended_position)
    load = phri_core.Admittance(np.full(2, mass), np.full(2, damping), DT)
    load.reset(home + 0.02, np.zeros(2))
    for _ in range(round(seconds / DT)):
        load.step(human.step(0.0, load.position, load.velocity))
    return bool(np.linalg.norm(load.position - home) < 0.002 and np.linalg.norm(load.velocity) < 0.001)


def hold_force(person, offset: float, seconds: float, seed: int) -> np.ndarray:
    """[N] along y of a person whose hand is held `offset` [m] away from where he or she wants it; the first second,
    in which muscles and reflexes rise, is left out."""
    human = partner(person, 90.0, 200.0, seed)
    away, still = np.array(human.intended_position) + [0.0, -offset], np.zeros(2)
    return np.array([human.step(0.0, away, still)[1] for _ in range(round((1.0 + seconds) / DT))])[round(1.0 / DT):]
