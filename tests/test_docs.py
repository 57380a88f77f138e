#!/usr/bin/python3
"""The pages that are printed from the code are those that the code prints."""

import pathlib

import pytest

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"


def test_parameter_reference_is_current():
    phri_sim = pytest.importorskip("phri_sim")
    page = (DOCS / "parameters.md").read_text()
    assert page.endswith(phri_sim.parameter_reference()), "docs/parameters.md is old: run scripts/write_parameters.py"
