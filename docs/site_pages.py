#!/usr/bin/python3
"""Stages the sources of the documentation site: `site_pages.py stage FOLDER [XML]` copies docs/ and the pages at the
top of the checkout into FOLDER and writes the pages of the interface from what the packages hold; `site_pages.py
undocumented XML` lists public members without a comment, from doxygen's XML.
"""

import pathlib
import re
import shutil
import sys
import xml.etree.ElementTree as ET

from doxygen_filter import filtered

ROOT = pathlib.Path(__file__).resolve().parent.parent
PACKAGES = ROOT / "catkin_ws" / "src"
TOP_PAGES = {"README.md": "readme.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
MODULES = ("phri_core", "phri_control", "phri_learning", "phri_sim")  # pybind11
ANALYSIS = ("bags", "metrics", "trial_table", "simulate", "report")  # the modules of phri_analysis that others call
LINK = re.compile(r"(!?\[(?:[^\]\[]|\[[^\]]*\])*\])\(([^)\s]+)\)")


def rewritten(text, folder):
    """Markdown of a page in `folder` of the checkout as a page of the flat site: links to pages of the site stay links;
    a link to another file of the checkout, which a reader of the site does not have, becomes the file's path."""
    def one(match):
        label, target = match[1], match[2]
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        path, _, anchor = target.partition("#")
        file = (ROOT / folder / path).resolve()
        anchor = "#" + anchor if anchor else ""
        if file.is_relative_to(ROOT / "docs"):
            return f"{label}({file.relative_to(ROOT / 'docs')}{anchor})"
        name = str(file.relative_to(ROOT))
        if name in TOP_PAGES:
            return f"{label}({TOP_PAGES[name]}{anchor})"
        return label[1:-1] if label.strip("[]`").endswith(file.name) else f"{label[1:-1]} (`{name}`)"
    parts = re.split(r"(```.*?```)", text, flags=re.DOTALL)
    return "".join(part if part.startswith("```") else LINK.sub(one, part) for part in parts)


def underlined(title, mark):
    return f"{title}\n{mark * len(title)}\n\n"


def headers(package):
    return sorted((PACKAGES / package / "include" / package).glob("*.hpp"))


def entities(xml):
    """What each header declares in a namespace, in its order: {file: [(line, directive)]}, from doxygen's XML."""
    found = {}

    def add(location, directive):
        header = location.get("file").partition("/include/")[2]
        found.setdefault(header, []).append((int(location.get("line")), directive))

    for file in sorted(xml.glob("*.xml")):
        for definition in ET.parse(file).iter("compounddef"):
            kind, name = definition.get("kind"), definition.findtext("compoundname")
            if kind in ("class", "struct") and name.count("::") == 1:  # nested ones come with what they stand in
                add(definition.find("location"), f".. doxygen{kind}:: {name}\n   :members:\n   :undoc-members:\n")
            elif kind == "namespace":
                for member in definition.iter("memberdef"):
                    what, full = member.get("kind"), f"{name}::{member.findtext('name')}"
                    if what == "function":
                        full += member.findtext("argsstring").replace(" noexcept", "")
                    add(member.find("location"), f".. doxygen{what}:: {full}\n")
    return {file: sorted(entries) for file, entries in found.items()}


def cpp_page(package, found):
    page = underlined(f"{package} (C++)", "=")
    page += "Names are in the namespace of the package; a header is included by the name that stands here.\n\n"
    for header in headers(package):
        name = f"{package}/{header.name}"
        page += underlined(name, "-") + lesson(header) + "\n".join(text for _, text in found.get(name, [])) + "\n"
    return page


def lesson(header):
    """The comment at the top of a header, which speaks of all of it, as reStructuredText."""
    text = filtered(header.read_text(), header.name)
    match = re.search(r"/\*\*\n@file [^\n]*\n(.*?)\*/", text, re.DOTALL)
    if not match:
        return ""
    out, literal = [], False
    for line in match[1].splitlines():
        if line.strip() in ("@verbatim", "@endverbatim"):
            literal = line.strip() == "@verbatim"
            out += ["", "::", ""] if literal else [""]
        else:
            out.append("   " + line if literal else plain(line))
    return "\n".join(out) + "\n\n"


def plain(line):
    """Text in which only `x` is markup, as reStructuredText."""
    parts = re.split(r"(``?[^`]+``?)", line)
    return "".join(f"``{part.strip('`')}``" if part.startswith("`") else re.sub(r"([\\*|_`])", r"\\\1", part)
                   for part in parts)


def python_page(module):
    return underlined(f"{module} (Python)", "=") + f".. automodule:: {module}\n\n"


def analysis_page():
    page = underlined("phri_analysis (Python)", "=")
    for module in ANALYSIS:
        page += underlined(f"phri_analysis.{module}", "-") + f".. automodule:: phri_analysis.{module}\n\n"
    return page


def messages_page():
    page = underlined("Messages and services", "=")
    page += ("Package ``phri_msgs``. Every wrench is exerted **BY** the named agent **ON** the object, expressed in "
             "and taken about the origin of ``header.frame_id``.\n\n")
    for kind in ("msg", "srv"):
        for file in sorted((PACKAGES / "phri_msgs" / kind).glob(f"*.{kind}")):
            page += underlined(f"phri_msgs/{file.stem}", "-") + ".. code-block:: none\n\n"
            page += "".join(f"   {line}".rstrip() + "\n" for line in file.read_text().splitlines()) + "\n"
    return page


def stage(folder, xml):
    """Without doxygen's XML: without the pages of the C++ and Python interfaces."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs", folder, ignore=shutil.ignore_patterns("*.py", "Doxyfile", "__pycache__"))
    for page in folder.rglob("*.md"):
        page.write_text(rewritten(page.read_text(), "docs"))
    for name, page in TOP_PAGES.items():
        (folder / page).write_text(rewritten((ROOT / name).read_text(), "."))
    pages = {"messages": messages_page()}
    if xml:
        found = entities(xml)
        packages = sorted(path.name for path in PACKAGES.iterdir() if headers(path.name))
        pages.update({package: cpp_page(package, found) for package in packages})
        pages.update({f"python_{module}": python_page(module) for module in MODULES})
        pages["python_phri_analysis"] = analysis_page()
    (folder / "api").mkdir()
    for name, text in pages.items():
        (folder / "api" / f"{name}.rst").write_text(text)
    index = folder / "index.md"
    listed = set(re.findall(r"^(?:.*<)?([a-z_]+)>?$", index.read_text(), re.MULTILINE))
    others = sorted({page.stem for page in folder.glob("*.md")} - listed - {"index"})
    more = toctree("More", others) + toctree("Interfaces", [f"api/{name}" for name in pages])
    index.write_text(index.read_text() + more)


def toctree(caption, pages):
    if not pages:
        return ""
    return f"\n```{{toctree}}\n:caption: {caption}\n:maxdepth: 1\n" + "\n".join(pages) + "\n```\n"


def undocumented(folder):
    """`file: member` of every public thing without a comment."""
    for file in sorted(folder.glob("*.xml")):
        for definition in ET.parse(file).iter("compounddef"):
            kind = definition.get("kind")
            if kind not in ("class", "struct", "namespace"):
                continue
            entries = [member for member in definition.iter("memberdef") if member.get("prot") == "public"]
            for entry in entries if kind == "namespace" else [definition, *entries]:
                comments = (entry.find("briefdescription"), entry.find("detaileddescription"))
                if not any("".join(part.itertext()).strip() for part in comments if part is not None):
                    yield f"{entry.find('location').get('file')}: {title(entry)}"


def title(entry):
    name = entry.findtext("definition") or entry.findtext("compoundname") or f"enum {entry.findtext('name')}"
    return " ".join((name + (entry.findtext("argsstring") or "")).split())


def main(arguments):
    if len(arguments) in (2, 3) and arguments[0] == "stage":
        stage(pathlib.Path(arguments[1]), pathlib.Path(arguments[2]) if len(arguments) == 3 else None)
    elif len(arguments) == 2 and arguments[0] == "undocumented":
        print("\n".join(sorted(undocumented(pathlib.Path(arguments[1])))))
    else:
        sys.exit("usage: site_pages.py stage FOLDER [XML] | site_pages.py undocumented XML")


if __name__ == "__main__":
    main(sys.argv[1:])
