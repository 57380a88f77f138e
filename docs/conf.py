"""Settings of the documentation site. scripts/docs.sh stages the pages and runs sphinx-build with this file."""

import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from site_pages import plain  # noqa: E402

project = "phri"
author = "the phri authors"
copyright = "the phri authors, BSD-3-Clause"  # noqa: A001  the name is sphinx's
version = release = os.environ.get("PHRI_GIT_REVISION", "")

QUICK = os.environ.get("PHRI_DOCS_QUICK") == "1"  # without the API pages: neither doxygen nor a built workspace needed
extensions = ["myst_parser", "equations"]
if not QUICK:
    extensions += ["breathe", "sphinx.ext.autodoc"]
    breathe_projects = {"phri": os.path.join(os.environ["PHRI_DOCS"], "xml")}
    breathe_default_project = "phri"
    breathe_default_members = ("members",)
    autodoc_default_options = {"members": True, "undoc-members": True, "member-order": "bysource"}
    autodoc_docstring_signature = True

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
highlight_language = "none"
primary_domain = None
html_theme = "sphinx_rtd_theme"
html_static_path = ["_static"]
html_css_files = ["phri.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {"navigation_depth": 3, "style_external_links": True}
html_math_renderer = "drawn"
exclude_patterns = ["conf.py"]


def plain_docstring(app, what, name, obj, options, lines):
    """The docstrings of the Python modules are plain text, not reStructuredText."""
    lines[:] = [plain(line) for line in lines]


def shorter_signature(app, what, name, obj, options, signature, returned):
    """Signatures of pybind11 without what says nothing to a reader."""
    def short(text):
        text = re.sub(r"self: [\w.]+(, )?", "", text)
        text = re.sub(r"<([\w.]+) object at 0x[0-9a-f]+>", r"\1()", text)
        return re.sub(r"numpy\.ndarray\[numpy\.float64(\[[^\]]*\])?\]", "numpy.ndarray", text)
    return short(signature or "") or signature, short(returned or "") or returned


def setup(app):
    if not QUICK:
        app.connect("autodoc-process-docstring", plain_docstring)
        app.connect("autodoc-process-signature", shorter_signature)
