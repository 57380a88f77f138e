#!/usr/bin/python3
"""Writes docs/faults.md from docs/faults.yaml and what the last `make test` measured.

A `measured` text holds fields {Suite.Test:property}, or {suite:property} for those of a whole suite: values that a test
left as JUnit properties (gtest RecordProperty, pytest record_property) under results/tests/. A field without a value
there is an error: nothing is written.

usage: write_faults.py [--results FOLDER] [--out FILE]
"""

import argparse
import pathlib
import re
import sys
import xml.etree.ElementTree as ET

import yaml

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIELD = re.compile(r"\{([\w.\[\]-]+):(\w+)\}")
COLUMNS = ("what breaks", "what happens", "message", "exit", "measured", "test")


def properties(results):
    """{(test, property): value} of every JUnit file under `results`; a test is Suite.Name (gtest) or a pytest name."""
    found = {}
    for path in pathlib.Path(results).rglob("*.xml"):
        try:
            tree = ET.parse(path)
        except ET.ParseError:
            continue
        for node in tree.iterfind(".//testsuite/properties/property"):
            found["suite", node.get("name")] = node.get("value")
        for case in tree.iter("testcase"):
            suite = case.get("classname", "").split(".")[-1]
            names = {case.get("name"), f"{suite}.{case.get('name')}"}
            for node in case.iter("property"):
                for name in names:
                    found[name, node.get("name")] = node.get("value")
    return found


def fill(text, values, missing):
    def value(match):
        key = (match[1], match[2])
        if key not in values:
            missing.append(match[0])
        return str(values.get(key, match[0]))
    return FIELD.sub(value, text)


def page(description, values):
    """The Markdown page, and the fields that have no value."""
    missing, out = [], [description["head"].rstrip()]
    for group in description["groups"]:
        out += ["", f"## {group['name']}", ""]
        columns = [name for name in COLUMNS if any(row.get(name) not in (None, "") for row in group["rows"])]
        out += ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
        for row in group["rows"]:
            cells = [str(row.get(name) if row.get(name) is not None else "") for name in columns]
            cells = [" ".join(fill(cell, values, missing).split()).replace("|", "\\|") for cell in cells]
            out.append("| " + " | ".join(cells) + " |")
    return "\n".join([*out, "", description["foot"].rstrip(), ""]), missing


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", default=ROOT / "results/tests")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "docs/faults.md")
    arguments = parser.parse_args()
    description = yaml.safe_load((ROOT / "docs/faults.yaml").read_text())
    text, missing = page(description, properties(arguments.results))
    if missing:
        print(f"write_faults: no value for {', '.join(sorted(set(missing)))}: run make test first", file=sys.stderr)
        return 66
    arguments.out.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
