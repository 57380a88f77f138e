"""Pictures of a library of movement primitives: its tree with counts, which primitive follows which, its segments.

`library` is a phri_learning.PrimitiveLibrary; only its attributes are used, so this module needs no ROS.
"""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

# Okabe-Ito palette, as everywhere; a primitive keeps its colour in both pictures
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_GREY = "#6b6b6b"
_PANELS = 30  # primitives with a panel of their own
_SHOWN_FROM = 0.01  # probability of an arrow


def colour(library, node: int) -> str:
    """Of the upper node that `node` belongs to; grey for the root."""
    while node != 0 and library.node(node).parent != 0:
        node = library.node(node).parent
    upper = list(library.upper_nodes)
    return _COLOURS[upper.index(node) % len(_COLOURS)] if node in upper else _GREY


def layout(library) -> dict:
    """{node: (x, depth)}: leaves side by side, a parent above the middle of its children."""
    places, leaves = {}, iter(range(1_000_000))

    def place(node, depth):
        children = library.node(node).children
        below = [place(child, depth + 1) for child in children]
        x = float(next(leaves)) if not below else 0.5 * (below[0] + below[-1])
        places[node] = (x, depth)
        return x

    place(0, 0)
    return places


def draw_tree(axes, library) -> None:
    """Nodes with number, count and length; a line is as wide as its share of all segments."""
    places = layout(library)
    total = max(library.node(0).count, 1)
    for node, (x, depth) in places.items():
        entry = library.node(node)
        if entry.parent >= 0:
            above = places[entry.parent]
            axes.plot([above[0], x], [-above[1], -depth], color=colour(library, node), zorder=1,
                      linewidth=1.0 + 7.0 * entry.count / total, solid_capstyle="round")  # fmt: skip
    for node, (x, depth) in places.items():
        entry = library.node(node)
        waiting = f"\n{len(entry.segments)} in no primitive" if node == 0 else f"\n{entry.length:.1f} s"
        text = ("all" if node == 0 else f"{node}") + f": {entry.count}×" + waiting
        axes.text(x, -depth, text, ha="center", va="center", fontsize=9, color="white", zorder=2,
                  bbox={"boxstyle": "round,pad=0.4", "facecolor": colour(library, node),
                        "edgecolor": "none"})  # fmt: skip
    xs = [place[0] for place in places.values()]
    deepest = max(place[1] for place in places.values())
    axes.set_xlim(min(xs) - 0.7, max(xs) + 0.7)
    axes.set_ylim(-deepest - 0.5, 0.5)
    axes.axis("off")
    axes.set_title("Primitives: number, times seen, length")


def draw_successions(axes, library) -> None:
    """Primitives in a circle; an arrow for every succession seen, with its probability near its tail."""
    nodes, counts, probability = library.successions()
    axes.set_title("Which follows which: probability")
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_xlim(-1.6, 1.6)
    axes.set_ylim(-1.6, 1.6)
    if not nodes:
        axes.text(0.0, 0.0, "no primitive yet", ha="center", va="center", color=_GREY)
        return
    angles = math.pi / 2 - 2.0 * math.pi * np.arange(len(nodes)) / len(nodes)
    places = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for i, j in zip(*np.nonzero(np.asarray(counts))):
        share = probability[i, j]
        if share < _SHOWN_FROM:
            continue
        shade = colour(library, nodes[i])
        if i == j:
            start, end = places[i] * 1.14 + _turned(places[i]) * 0.13, places[i] * 1.14 - _turned(places[i]) * 0.13
            bend, where = 1.6, places[i] * 1.5
        else:
            along = (places[j] - places[i]) / np.linalg.norm(places[j] - places[i])
            start, end, bend = places[i] + 0.2 * along, places[j] - 0.2 * along, 0.15
            # beside the arrow, on the side to which it is bent, so that the two directions do not meet
            where = 0.62 * start + 0.38 * end - _turned(along) * (0.07 * np.linalg.norm(end - start) + 0.09)
        axes.add_patch(FancyArrowPatch(start, end, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", color=shade,
                                       mutation_scale=14, linewidth=0.8 + 3.0 * share))  # fmt: skip
        axes.text(*where, f"{share:.2f}", ha="center", va="center", fontsize=8, color=shade,
                  bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none"})  # fmt: skip
    for node, place in zip(nodes, places):
        axes.text(*place, f"{node}", ha="center", va="center", fontsize=11, color="white", zorder=3,
                  bbox={"boxstyle": "circle,pad=0.5", "facecolor": colour(library, node),
                        "edgecolor": "none"})  # fmt: skip


def _turned(vector):
    """By a quarter turn to the left."""
    return np.array([-vector[1], vector[0]])


def picture(library) -> Figure:
    """Tree and successions side by side."""
    leaves = 1 + max(x for x, _ in layout(library).values())
    figure = Figure(figsize=(max(6.0, 1.5 * leaves) + 5.0, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[max(6.0, 1.5 * leaves), 5.0])
    draw_tree(left, library)
    draw_successions(right, library)
    return figure


def segments(library, places: list) -> Figure:
    """A panel for all segments and one per primitive: `places` are pairs of positions (T, d) [m] and the upper node, or
    -1. Of three axes the two that move most are shown. Dashed: the primitive's own motion."""
    upper = list(library.upper_nodes)
    reach = np.max([np.ptp(x, axis=0) for x, _ in places], axis=0)
    shown = sorted(np.argsort(-reach, kind="stable")[:2])
    panels = [None, *upper[:_PANELS]] + ([-1] if any(node < 0 for _, node in places) else [])
    columns = min(len(panels), 4)
    figure = Figure(figsize=(3.4 * columns, 3.2 * math.ceil(len(panels) / columns)), layout="constrained")
    grid = figure.subplots(math.ceil(len(panels) / columns), columns, squeeze=False).ravel()
    for axes, panel in zip(grid, panels):
        count = 0
        for x, node in places:
            if panel is None or node == panel:
                _path(axes, x, shown, _GREY if node < 0 else colour(library, node), 0.9, 0.55)
                count += 1
        if panel in upper:
            _path(axes, np.asarray(library.node(panel).output), shown, "black", 1.4, 1.0, linestyle="--")
        text = {None: "all", -1: "in no primitive"}.get(panel, f"primitive {panel}")
        more = f", {len(upper) - _PANELS} primitives not shown" if panel is None and len(upper) > _PANELS else ""
        axes.set_title(f"{text}: {count}×{more}", fontsize=9)
        axes.set_aspect("equal" if len(shown) == 2 else "auto", adjustable="datalim")
        axes.tick_params(labelsize=7)
        axes.set_xlabel("xyz"[shown[0]] + " [m]" if len(shown) == 2 else "sample", fontsize=8)
        axes.set_ylabel(("xyz" + "???")[shown[-1]] + " [m]", fontsize=8)
    for axes in grid[len(panels):]:
        axes.axis("off")
    return figure


def _path(axes, x, shown, colour_, width, alpha, linestyle="-"):
    data = x[:, shown] if len(shown) == 2 else np.column_stack([np.arange(len(x)), x[:, shown]])
    axes.plot(*data.T, color=colour_, linewidth=width, alpha=alpha, linestyle=linestyle)
    axes.plot(*data[0], "o", color=colour_, markersize=3, alpha=alpha)
