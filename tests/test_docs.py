#!/usr/bin/python3
"""The pages that are printed from the code are those that the code prints."""

import pathlib
import re
import sys

import pytest
import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "scripts"))

import write_faults  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"


def test_parameter_reference_is_current():
    phri_sim = pytest.importorskip("phri_sim")
    page = (DOCS / "parameters.md").read_text()
    assert page.endswith(phri_sim.parameter_reference()), "docs/parameters.md is old: run scripts/write_parameters.py"


MARK = "\x00"


class Anything(dict):
    """Has a value for every field."""

    def __contains__(self, _):
        return True

    def get(self, *_):
        return MARK


def test_fault_page_is_what_its_source_says():
    """But for what was measured, which belongs to the last run of the tests."""
    description = yaml.safe_load((DOCS / "faults.yaml").read_text())
    text, missing = write_faults.page(description, Anything())
    assert not missing
    pattern = "[^|]+".join(map(re.escape, text.split(MARK)))
    assert re.fullmatch(pattern, (DOCS / "faults.md").read_text()), "run scripts/write_faults.py"


def test_every_fault_has_a_test_that_exists():
    description = yaml.safe_load((DOCS / "faults.yaml").read_text())
    files = [path for folder in ("catkin_ws/src", "analysis/tests", "tests") for path in (ROOT / folder).rglob("*test*")
             if path.is_file() and path.suffix in (".cpp", ".py", ".test")]
    sources = "\n".join(path.read_text() for path in files)
    cases = {f"{suite}.{name}" for suite, name in re.findall(r"TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\)", sources)}
    known = cases | {path.name for path in files} | set(re.findall(r"^\s*def (test_\w+)", sources, re.MULTILINE))
    for group in description["groups"]:
        for row in group["rows"]:
            assert row.get("test"), row["what breaks"]
            for name in re.split(r",\s*", row["test"]):
                assert name in known, f"{row['what breaks']}: no test {name}"


def test_a_field_without_a_measurement_is_an_error(tmp_path):
    (tmp_path / "a.xml").write_text("""<testsuites><testsuite name="S"><testcase name="T" classname="S"><properties>
        <property name="ms" value="21"/></properties></testcase></testsuite></testsuites>""")
    values = write_faults.properties(tmp_path)
    missing = []
    assert write_faults.fill("after {S.T:ms} ms", values, missing) == "after 21 ms" and not missing
    write_faults.fill("after {S.T:s} s", values, missing)
    assert missing == ["{S.T:s}"]
