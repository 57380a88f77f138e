#!/usr/bin/python3
"""Draws maze.png: a room with two moving obstacles on the right, a narrow curved channel on the left (figure 5.17)."""

import pathlib

import numpy as np
from PIL import Image
from scipy.interpolate import CubicSpline

RESOLUTION = 0.0005  # [m/pixel]
HALF = 0.15  # [m] half width of the workspace
CHANNEL = 0.011  # [m] half width of the channel
ROOM = (-0.028, 0.142, -0.14, 0.14)  # [m] x from, x to, y from, y to
# centre line of the channel, from the room's lower left corner to the goal in the upper left [m]
LINE = np.array([[-0.01, -0.118], [-0.045, -0.12], [-0.085, -0.118], [-0.118, -0.095], [-0.112, -0.058],
                 [-0.076, -0.034], [-0.06, 0.0], [-0.085, 0.03], [-0.118, 0.052], [-0.118, 0.088],
                 [-0.09, 0.112], [-0.06, 0.125]])


def main():
    size = round(2 * HALF / RESOLUTION)
    axis = (np.arange(size) + 0.5) * RESOLUTION - HALF
    x, y = np.meshgrid(axis, axis[::-1])
    free = (x > ROOM[0]) & (x < ROOM[1]) & (y > ROOM[2]) & (y < ROOM[3])
    spline = CubicSpline(np.arange(len(LINE)), LINE)
    for point in spline(np.linspace(0, len(LINE) - 1, 1500)):
        free |= (x - point[0]) ** 2 + (y - point[1]) ** 2 < CHANNEL**2
    Image.fromarray(np.where(free, 255, 0).astype(np.uint8)).save(pathlib.Path(__file__).with_name("maze.png"))


if __name__ == "__main__":
    main()
