"""Pictures of primitive libraries: the layout, and that what is shown is what the library says."""

from types import SimpleNamespace

import numpy as np

from phri_analysis import primitive_plots


class Library:
    """Root with two primitives, the first with a child; 1 -> 2 -> 1."""

    upper_nodes = [1, 2]

    def node(self, i):
        parents, children, counts = {0: -1, 1: 0, 2: 0, 3: 1}, {0: [1, 2], 1: [3], 2: [], 3: []}, [9, 5, 3, 4]
        return SimpleNamespace(id=i, parent=parents[i], children=children[i], count=counts[i], segments=[1], length=1.5)

    def successions(self):
        return [1, 2], np.array([[0, 3], [2, 1]]), np.array([[0.0, 1.0], [0.67, 0.33]])


class Empty:
    upper_nodes = []

    def node(self, i):
        return SimpleNamespace(id=0, parent=-1, children=[], count=0, segments=[], length=0.0)

    def successions(self):
        return [], np.zeros((0, 0)), np.zeros((0, 0))


def test_leaves_stand_apart_and_parents_above_them():
    places = primitive_plots.layout(Library())
    assert places[3] == (0.0, 2) and places[2] == (1.0, 1)
    assert places[1] == (0.0, 1) and places[0] == (0.5, 0)


def test_the_picture_shows_counts_and_probabilities(tmp_path):
    figure = primitive_plots.picture(Library())
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    for shown in ("1: 5×\n1.5 s", "3: 4×\n1.5 s", "1.00", "0.67", "0.33"):
        assert shown in texts
    assert "0.00" not in texts
    assert primitive_plots.colour(Library(), 3) == primitive_plots.colour(Library(), 1)
    figure.savefig(tmp_path / "tree.png")


def test_an_empty_library_says_so(tmp_path):
    figure = primitive_plots.picture(Empty())
    assert any(text.get_text() == "no primitive yet" for text in figure.axes[1].texts)
    figure.savefig(tmp_path / "tree.png")
