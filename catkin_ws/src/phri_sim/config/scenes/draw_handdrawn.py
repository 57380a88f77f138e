#!/usr/bin/python3
"""Draws handdrawn.jpg: what a telephone makes of a maze on a whiteboard, with wobbly strokes, uneven light, blur, noise
and JPEG at quality 75. Seeded; the longer side becomes 0.3 m, so 1 pixel is 0.3 mm."""

import pathlib

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

WIDTH, HEIGHT = 1000, 760  # [pixel]
SEED = 4
STROKES = [  # corners of the strokes of a pen [pixel]
    [(40, 50), (960, 35), (970, 715), (30, 725), (40, 50)],
    [(270, 40), (265, 520)],
    [(500, 720), (495, 240)],
    [(735, 45), (740, 510)],
]
GREEN, RED = ((150, 140), (20, 150, 60)), ((860, 130), (205, 40, 45))  # centre [pixel], colour
PEN = 13  # [pixel] width of a stroke


def wobbly(corners, random):
    """Points along a stroke, each leg off its line by a smooth, small amount."""
    points = []
    for a, b in zip(corners[:-1], corners[1:]):
        a, b = np.array(a, float), np.array(b, float)
        s = np.linspace(0, 1, round(np.linalg.norm(b - a) / 3))
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        waves = sum(random.normal(0, 9 / k) * np.sin(np.pi * k * s) for k in range(1, 6))
        points += [tuple(p) for p in a + np.outer(s, b - a) + np.outer(waves, normal)]
    return points


def main():
    random = np.random.default_rng(SEED)
    board = Image.new("RGB", (WIDTH, HEIGHT), (250, 250, 248))
    draw = ImageDraw.Draw(board)
    for stroke in STROKES:
        for x, y in wobbly(stroke, random):
            radius = PEN / 2 + random.uniform(-0.7, 0.7)
            draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=(38, 36, 48))
    for (x, y), color in (GREEN, RED):
        outline = [(x + (30 + random.uniform(-2, 2)) * np.cos(a), y + (30 + random.uniform(-2, 2)) * np.sin(a))
                   for a in np.linspace(0, 2 * np.pi, 20)]
        draw.polygon(outline, fill=color)
    photo = np.asarray(board.filter(ImageFilter.GaussianBlur(1.2)), dtype=float)
    # a lamp at the upper left, slightly warm; the far corner gets little more than half of the light
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    light = 1.0 - 0.42 * np.clip(np.hypot(x / WIDTH - 0.2, y / HEIGHT - 0.1), 0, 1)
    photo = photo * light[..., None] * np.array([1.0, 0.98, 0.93]) + random.normal(0, 4, photo.shape)
    picture = Image.fromarray(np.clip(photo, 0, 255).astype(np.uint8))
    picture.save(pathlib.Path(__file__).with_name("handdrawn.jpg"), quality=75)


if __name__ == "__main__":
    main()
