#!/usr/bin/python3
"""Doxygen's input filter: prints a header with its `///` comments made fit for doxygen.

Lines of a comment that are indented by two spaces or more are equations or tables: they become code blocks, which keep
their lines. The comment that stands at the top of a header, before the includes, becomes the documentation of the file
(doxygen would give it to whatever is declared next). The number of lines may change; nobody reads line numbers here.
"""

import pathlib
import re
import sys

COMMENT = re.compile(r"^(\s*)///(?!<) ?(.*)$")


def filtered(text, name):
    lines = text.splitlines()
    blocks, position = [], 0
    while position < len(lines):
        end = position
        while end < len(lines) and COMMENT.match(lines[end]):
            end += 1
        if end == position:
            blocks.append(lines[position])
            position += 1
            continue
        following = next((line for line in lines[end:] if line.strip()), "")
        detached = end < len(lines) and not lines[end].strip()
        blocks += comment(lines[position:end], f"@file {name}" if lead(lines[:position], following, detached) else "")
        position = end
    return "\n".join(blocks) + "\n"


def lead(before, following, detached):
    """Whether a comment speaks of the whole header: nothing but the guard and includes stand before it, and it is not
    the comment of a declaration."""
    top = all(not line.strip() or line.startswith("#") for line in before)
    return top and (detached or following.startswith(("#include", "namespace")))


def comment(lines, command):
    """The lines of one comment, with `command` first if it is not empty."""
    indent = COMMENT.match(lines[0])[1]
    out, literal = ([command] if command else []), False
    for line in (COMMENT.match(line)[2] for line in lines):
        indented = line.startswith("  ") and not re.match(r" +(-|\d\.) ", line)
        if indented != literal and (line.strip() or literal):
            out.append("@verbatim" if indented else "@endverbatim")
            literal = indented
        out.append(line)
    if literal:
        out.append("@endverbatim")
    # not as ///: doxygen leaves the slashes of a verbatim block in
    return [f"{indent}/**", *out, f"{indent}*/"]


if __name__ == "__main__":
    path = pathlib.Path(sys.argv[1])
    sys.stdout.write(filtered(path.read_text(), path.name))
