#!/usr/bin/python3
"""Writes flower.yaml: a path in the spirit of figure 3.3. From the dot at the bottom of the centre around four petals,
counter-clockwise, then once around the centre: five parts, the end where it began."""

import pathlib

import numpy as np

CENTRE, PETAL = 0.035, 0.085  # [m] radius of the centre, length of a petal
POINTS = 96, 24  # of the petals, of the centre

HEAD = """\
# The path of figure 3.3, as drawn by draw_flower.py: four petals, counter-clockwise, then the centre. No walls.
size: [0.3, 0.3]          # [m] the workspace
resolution: 0.005         # [m/pixel] nothing to be seen
object_radius: 0.003      # [m]
goal_radius: 0.006        # [m]
path:                     # [m]
"""


def rows(values):
    lines = [", ".join(f"{value:.4f}" for value in values[k : k + 12]) for k in range(0, len(values), 12)]
    return "[" + ",\n      ".join(lines) + "]"


def main():
    petals, centre = (np.linspace(0, 2 * np.pi, n, endpoint=False) for n in POINTS)
    angle = np.r_[petals, centre, 0.0] - np.pi / 2
    radius = np.r_[CENTRE + PETAL * np.sin(2 * petals) ** 2, np.full(len(centre) + 1, CENTRE)]
    text = HEAD + f"  x: {rows(radius * np.cos(angle) + 0.0)}\n  y: {rows(radius * np.sin(angle) + 0.0)}\n"
    pathlib.Path(__file__).with_name("flower.yaml").write_text(text)


if __name__ == "__main__":
    main()
