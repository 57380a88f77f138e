#!/usr/bin/python3
"""Draws scenes as the stack sees them: above the picture, below the distance to the nearest wall, start, goal and the
comfortable way between them.

usage: show_scenes.py OUT.png SCENE...     a SCENE is a name in config/scenes, a yaml file or a picture
"""

import sys

import matplotlib
import numpy as np
import phri_sim
from PIL import Image

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402 - after the choice of the backend

FAR = 30  # [mm] end of the colour scale


def draw(scene, above, below):
    """The two panels of one scene; axes in mm."""
    height, width = scene.image.shape
    low = scene.origin * 1e3
    high = low + scene.resolution * 1e3 * np.array([width, height])
    extent = [low[0], high[0], low[1], high[1]]
    colored = None if scene.image_path.endswith(".svg") else Image.open(scene.image_path).convert("RGB")
    above.imshow(scene.image if colored is None else colored, extent=extent, cmap="gray", vmin=0, vmax=255)
    distances = scene.distances * 1e3
    field = below.imshow(distances, extent=extent, cmap="RdBu", vmin=-FAR, vmax=FAR)
    below.contour(distances[::-1], [0], extent=extent, colors="black", linewidths=0.8)
    route = np.array(scene.route()) * 1e3
    below.plot(*route.T, color="#d95f02", linewidth=2)
    for axes in (above, below):
        for place, color in ((scene.start, "#00a000"), (scene.goal, "#e00000")):
            axes.plot(*(place * 1e3), "o", color=color, markersize=8, markeredgecolor="black")
    room = min(scene.distance(x) for x in scene.route()) - scene.object_radius
    above.set_title(f"{scene.name}: {len(route) - 1} mm of way,\n{room * 1e3:.1f} mm to the walls at least", fontsize=9)
    below.set_xlabel("x [mm]")
    return field


def main(arguments):
    if len(arguments) < 2:
        print(__doc__.split("\n\n")[1], file=sys.stderr)
        return 64
    try:
        scenes = [phri_sim.load_scene(name) for name in arguments[1:]]
    except ValueError as error:  # PictureError, ParameterError
        print(f"show_scenes: {error}", file=sys.stderr)
        return 65
    figure, axes = pyplot.subplots(
        2, len(scenes), figsize=(3.5 * len(scenes), 6.6), dpi=80, squeeze=False, constrained_layout=True)
    for column, scene in enumerate(scenes):
        field = draw(scene, *axes[:, column])
    for row in axes:
        row[0].set_ylabel("y [mm]")
    figure.colorbar(field, ax=axes[1, :], shrink=0.8).set_label("distance to the nearest wall [mm]")
    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB")
    picture.quantize(256, method=Image.Quantize.MAXCOVERAGE).save(arguments[0], optimize=True)  # a third of the bytes
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
