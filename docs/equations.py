"""Equations of the site as pictures inside the page, drawn by matplotlib: they look the same in every browser and
need no script, no font and no network. The LaTeX is what matplotlib's mathtext knows (no matrices, no environments);
`\\\\` begins a new line of a displayed equation.
"""

import html

import matplotlib
from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath

matplotlib.rcParams["mathtext.fontset"] = "cm"
LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}
TEXT, DISPLAY = 1.1, 1.2  # size relative to the text around
UNIT = 100.0  # path units per font size
MARGIN = 4.0  # around the ink, in path units


def drawn(latex, scale=TEXT):
    """An equation as an SVG element whose baseline is that of the text. Raises ValueError naming the equation."""
    try:
        path = TextPath((0.0, 0.0), f"${' '.join(latex.split())}$", size=UNIT, prop=FontProperties(size=UNIT))
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"equation {latex!r}: {str(error).strip().splitlines()[-1]}") from None
    (left, bottom), (right, top) = path.get_extents().get_points()
    left, bottom, right, top = left - MARGIN, min(bottom, 0.0) - MARGIN, right + MARGIN, top + MARGIN
    strokes = []
    for points, code in path.iter_segments(curves=True, simplify=False):
        numbers = [] if code == Path.CLOSEPOLY else (points.reshape(-1, 2) * [1, -1]).ravel()  # SVG: y points down
        strokes.append(LETTERS[code] + " ".join(f"{value:.1f}" for value in numbers))
    em = scale / UNIT
    width, height = right - left, top - bottom
    style = f"width:{width * em:.3f}em;height:{height * em:.3f}em;vertical-align:{bottom * em:.3f}em"
    return (f'<svg class="equation" role="img" aria-label="{html.escape(latex)}" style="{style}" '
            f'viewBox="{left:.1f} {-top:.1f} {width:.1f} {height:.1f}">'
            f'<path fill="currentColor" d="{"".join(strokes)}"/></svg>')


def visit_math(self, node):
    self.body.append(drawn(node.astext()))
    raise nodes.SkipNode


def visit_math_block(self, node):
    lines = [line for line in node.astext().split("\\\\") if line.strip()]
    self.body.append('<div class="equations">' + "<br>".join(drawn(line, DISPLAY) for line in lines) + "</div>\n")
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("drawn", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
