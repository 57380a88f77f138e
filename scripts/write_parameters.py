#!/usr/bin/python3
"""Prints docs/parameters.md anew from the schemas of the built workspace (source scripts/env.sh first)."""

import pathlib

import phri_sim

HEAD = """# Parameters

Printed from the schemas by `scripts/write_parameters.py`; a test keeps it true. Keys are paths in the YAML files:
`limits/velocity` is `limits: {velocity: ...}`. ROS parameters under `~overrides/` of the experiment node, `--set` of
`phri-analysis simulate` and the argument `overrides` of `phri_sim.Experiment` take the same keys;
`override/robots/...`, `override/safety/...` and `override/participants/...` reach into the files named.

"""

if __name__ == "__main__":
    page = pathlib.Path(__file__).resolve().parent.parent / "docs" / "parameters.md"
    page.write_text(HEAD + phri_sim.parameter_reference())
