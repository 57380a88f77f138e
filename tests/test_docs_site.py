"""The documentation site: it builds without a warning, leads nowhere that is not there, and what its pages tell a
reader to type, to read or to add exists in this checkout."""

import html.parser
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import urllib.parse
import xml.etree.ElementTree as ET

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PACKAGES = ROOT / "catkin_ws" / "src"
PAGES = sorted(DOCS.glob("*.md"))
# programs of Debian and of the shell that a page may name as they are
PLAIN = {"pip", "unzip", "apt-get", "cd", "cp", "export", "docker", "sudo", "ls", "cat", "rosnode", "rosparam",
         "xvfb-run", "mkdir", "source", "which", "unset", "df", "glxinfo", "usermod", "ulimit", "python3", "less",
         "xdg-open"}
OTHERS_NODES = [["dynamic_reconfigure", "dynparam"]]

sys.path.insert(0, str(DOCS))
import doxygen_filter  # noqa: E402
import site_pages  # noqa: E402


def fenced(text, language):
    """The code blocks of a page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def page(name):
    return (DOCS / name).read_text()


# --- the site -------------------------------------------------------------------------------------------------------

class Links(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.targets, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.targets.append(value)
            elif name == "id":
                self.ids.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site without the pages of the C++ and Python interfaces, which need doxygen and the built workspace."""
    pytest.importorskip("myst_parser")
    folder = tmp_path_factory.mktemp("docs")
    done = subprocess.run([ROOT / "scripts" / "docs.sh", "--quick"], env={**os.environ, "PHRI_DOCS": str(folder)},
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "html"


def broken_links(site):
    pages = {path: Links(path.read_text()) for path in site.rglob("*.html")}
    for path, links in pages.items():
        for target in links.targets:
            url = urllib.parse.urlsplit(target)
            if url.scheme:
                yield from [f"{path.name}: {target} is not in the site"] * (tag_loads(target))
                continue
            file = (path.parent / urllib.parse.unquote(url.path)).resolve() if url.path else path
            if not file.is_file():
                yield f"{path.name}: {target} is not there"
            elif url.fragment and file in pages and urllib.parse.unquote(url.fragment) not in pages[file].ids | {""}:
                yield f"{path.name}: {target} has no such heading"


def tag_loads(target):
    """Whether a browser would fetch this from the network to show the page."""
    return target.endswith((".js", ".css", ".woff", ".woff2", ".png", ".svg"))


def test_every_link_and_picture_of_the_site_is_there(site):
    assert (site / "index.html").is_file()
    assert list(broken_links(site)) == []


def test_equations_need_no_script(site):
    text = (site / "controllers.html").read_text()
    assert text.count('<svg class="equation"') > 20 and "mathjax.js" not in text.lower()


def test_a_broken_link_is_found(site, tmp_path):
    shutil.copytree(site, tmp_path / "site")
    index = tmp_path / "site" / "index.html"
    index.write_text(index.read_text() + '<a href="nowhere.html">x</a><img src="figures/gone.svg">')
    assert len(list(broken_links(tmp_path / "site"))) == 2


def test_a_dangling_reference_stops_the_build(tmp_path):
    """-W is in force: a page that leads to a page that does not exist makes no site."""
    pytest.importorskip("myst_parser")
    source = tmp_path / "source"
    source.mkdir()
    (source / "index.md").write_text("# x\n\n```{toctree}\nnowhere\n```\n")
    done = subprocess.run(["sphinx-build", "-q", "-W", "--keep-going", "-c", DOCS, source, tmp_path / "html"],
                          env={**os.environ, "PHRI_DOCS_QUICK": "1"}, capture_output=True, text=True)
    assert done.returncode != 0 and "nonexisting document 'nowhere'" in done.stderr


# --- what pages tell a reader to type -------------------------------------------------------------------------------

def launch_arguments(name):
    files = list(PACKAGES.glob(f"*/launch/{name}"))
    return {arg.get("name") for file in files for arg in ET.parse(file).getroot().findall("arg")} if files else None


def make_targets():
    return set(re.findall(r"^([a-z_-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def make_variables():
    return set(re.findall(r"\$\(([A-Z]+)\)|\b([A-Z]+)=", (ROOT / "Makefile").read_text()))


def analysis_commands():
    import phri_analysis.cli
    return {name: {option for parameter in command.params for option in parameter.opts}
            for name, command in phri_analysis.cli.cli.commands.items()}


def fault_of(command):
    """What is wrong with one command line of a page; empty if all that it names is there."""
    words = shlex.split(command, comments=True)
    while words and re.match(r"[A-Z_]+=", words[0]):
        words = words[1:]
    if not words:
        return ""
    program, rest = words[0], words[1:]
    if program == "make":
        unknown = [word for word in rest if "=" not in word and word not in make_targets()]
        known = {name for pair in make_variables() for name in pair}
        unknown += [word for word in rest if "=" in word and word.partition("=")[0] not in known]
        return f"make knows no {unknown[0]}" if unknown else ""
    if program == "roslaunch":
        rest = [word for word in rest if not word.startswith("-")]
        if len(rest) < 2 or not (PACKAGES / rest[0]).is_dir():
            return "roslaunch wants a package of ours and a launch file"
        arguments = launch_arguments(rest[1])
        if arguments is None:
            return f"there is no {rest[1]}"
        unknown = [word for word in rest[2:] if word.partition(":=")[0] not in arguments]
        return f"{rest[1]} has no argument {unknown[0]}" if unknown else ""
    if program == "phri-analysis":
        commands = analysis_commands()
        if not rest or rest[0] not in commands:
            return f"phri-analysis has no command {rest[:1]}"
        unknown = [word for word in rest[1:] if word.startswith("--") and word not in commands[rest[0]] | {"--help"}]
        return f"phri-analysis {rest[0]} has no option {unknown[0]}" if unknown else ""
    if program == "rosrun":
        found = rest[:2] in OTHERS_NODES or len(rest) > 1 and any((PACKAGES / rest[0]).rglob(f"{rest[1]}*"))
        return "" if found else f"there is no program {' '.join(rest[:2])}"
    if program == "rosservice":
        name = rest[1].rpartition("/")[2] if len(rest) > 1 else ""
        return "" if re.search(rf'"~?{name}"', sources()) else f"nobody offers {rest[1:2]}"
    if program in ("rostopic", "rosbag", *PLAIN):
        missing = [word for word in rest if word.startswith(("scripts/", "catkin_ws/")) and "*" not in word
                   and not (ROOT / word).exists() and not (ROOT / word).parent.is_dir()]
        return f"there is no {missing[0]}" if missing else ""
    if "/" in program:
        return "" if (ROOT / program).is_file() else f"there is no {program}"
    return f"unknown program {program}"


def test_commands_of_the_pages_exist():
    faults = [f"{path.name}: {line}: {fault}" for path in [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
              for block in fenced(path.read_text(), "bash")
              for line in block.replace("\\\n", " ").splitlines() if (fault := fault_of(line))]
    assert faults == []


@pytest.mark.parametrize("command, part", [
    ("make demos", "knows no demos"),
    ("make test KK=x", "knows no KK"),
    ("roslaunch phri_sim experiment.launch participants:=3", "no argument participants"),
    ("roslaunch phri_sim demo.launch", "no demo.launch"),
    ("phri-analysis reports x", "no command"),
    ("phri-analysis report --bags x", "no option --bags"),
    ("scripts/doc.sh", "no scripts/doc.sh"),
    ("rosservice call /phri/experiment_node/commence", "nobody offers"),
    ("roscor", "unknown program"),
])
def test_a_command_that_does_not_exist_is_found(command, part):
    assert part in fault_of(command)


def test_files_named_in_the_pages_exist():
    """Code spans that look like a path of the checkout."""
    tops = "|".join(["analysis", "catkin_ws", "docker", "docs", "scripts", "tests"])
    missing = [f"{path.name}: {name}" for path in PAGES
               for name in re.findall(rf"`((?:{tops})/[\w./-]+)`", path.read_text())
               if not (ROOT / name).exists() and not name.startswith("catkin_ws/logs")]
    assert missing == []


# --- what pages say that the software says --------------------------------------------------------------------------

def sources():
    """All source text with adjacent string literals joined, so that a message stands in one piece."""
    folders = ("catkin_ws/src", "analysis", "scripts", "docker")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*")
             if path.suffix in (".cpp", ".hpp", ".py", ".sh") and "test" not in path.name + path.parent.name]
    text = "\n".join(path.read_text() for path in files)
    text = re.sub(r'"\s*\n\s*(?:f?)"', "", text)
    return re.sub(r"\s+", " ", text.replace('\\"', '"'))


def test_messages_in_the_troubleshooting_page_are_real():
    """First column of the tables under "Messages of this software": every code span, with <...> for what varies."""
    section = page("troubleshooting.md").partition("## Messages of this software")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([^|]*) \|", section, re.MULTILINE)
    spans = [span for row in rows for span in re.findall(r"`([^`]+)`", row)]
    assert len(spans) > 15
    text = sources()
    absent = [f"{part.strip()!r} of {span!r}" for span in spans for part in re.split(r"<[^>]*>", span)
              if part.strip() and part.strip() not in text]
    assert absent == []


def test_every_coded_message_is_explained():
    """Messages that begin with E_ are there to be searched for: the page has each of them."""
    coded = set(re.findall(r'"(E_[A-Z_]{3,})', sources()))
    assert len(coded) > 5 and coded <= set(re.findall(r"`(E_[A-Z_]+)", page("troubleshooting.md")))


def test_exit_codes_of_the_page_are_those_of_the_software():
    table = page("troubleshooting.md").partition("## Exit codes")[2]
    documented = {int(code) for code in re.findall(r"^\| (\d+) \|", table, re.MULTILINE)}
    text = sources()
    used = {int(code) for code in re.findall(r"\bk\w+ = (6[4-9]|7[0-8])\b", text)}
    used |= {int(code) for code in re.findall(r"exit_code = (\d+)", text)}
    used |= {int(code) for code in re.findall(r"\bexit (6[4-9]|7[0-8])\b", text)}
    assert used and used <= documented, used - documented


# --- pages with numbers and recipes ---------------------------------------------------------------------------------

def test_stiffness_table_is_what_the_controllers_do():
    phri_core, phri_control = pytest.importorskip("phri_core"), pytest.importorskip("phri_control")
    import numpy as np
    pattern = r"^\| `(\w+)` \| ([\d.]+|any) \| (\d+) \| (\d+) \| ([\d.]+) \|$"
    rows = re.findall(pattern, page("controllers.md"), re.MULTILINE)
    assert len(rows) == 5
    for name, deviation, stiffness, damping, force in rows:
        variance = {"any": 1e-5, "1": 1e-6, "3.2": 1e-5, "10": 1e-4}[deviation]
        prediction = phri_core.Prediction()
        prediction.t0, prediction.dt = 0.0, 0.02
        covariance = np.diag([variance, variance, variance / 10, variance / 10])
        prediction.desired_state = [phri_core.Gaussian(np.zeros(4), covariance)] * 11
        observation = phri_core.Observation(0.0, np.array([0.005, 0.0, 0.0, 0.0]), np.zeros(2))
        settings = phri_control.AssistanceSettings()
        settings.q_scale = 1e-3
        policy = phri_control.make_assistance(name, settings).plan(observation, prediction)
        assert [f"{-policy.gains[0][0][i]:.0f}" for i in (0, 2)] == [stiffness, damping], name
        assert f"{-policy.act(0.0, observation.state)[0]:.1f}" == force, name


def test_the_check_of_plus_x_reads_plus_x():
    pytest.importorskip("phri_core")
    code, = fenced(page("notation.md"), "python")
    checked = code + "\nassert handle.velocity[0] > 0 and handle.velocity[1] == 0, handle.velocity\n"
    done = subprocess.run([sys.executable, "-c", checked], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_controllers_page_has_every_controller_and_setting():
    phri_control = pytest.importorskip("phri_control")
    text = page("controllers.md")
    assert re.findall(r"^## `(\w+)`", text, re.MULTILINE) == phri_control.assistance_names()
    named = set(re.findall(r"`([a-z_]+/[a-z_]+)`", text))
    parameters = page("parameters.md")
    assert [name for name in named if name not in ("model/gate",) and f"| `{name}` |" not in parameters] == []
    group = parameters.partition("### `assistance/`")[2].partition("\n## ")[0]
    own = {key for key in re.findall(r"^\| `([a-z_]+/[a-z_]+)`", group, re.MULTILINE)}
    assert own <= named, own - named


def test_table_of_the_spring_is_that_of_the_source():
    """Key, default, unit and range of a spring hand stand in the page as in its schema."""
    package = PACKAGES / "phri_sim"
    defaults = dict(re.findall(r"double (\w+) = ([\d.]+);", (package / "include/phri_sim/spring_hand.hpp").read_text()))
    schema = re.findall(r'number\("hand/(\w+)", &s\.\w+, "([^"]*)", ([\d.]+), ([\d.]+)',
                        (package / "src/spring_hand.cpp").read_text())
    rows = [f"| `hand/{name}` | {float(defaults[name]):g} | {unit} | {float(low):g} to {float(high):g} |"
            for name, unit, low, high in schema]
    assert len(rows) == 5 and [row for row in rows if row not in page("hands.md")] == []


def test_files_of_the_quickstart_are_accepted(tmp_path):
    """Both YAML files, as they stand in the page, with a picture of the name that the scene has."""
    phri_sim = pytest.importorskip("phri_sim")
    experiment, scene = fenced(page("quickstart.md"), "yaml")
    (tmp_path / "experiment.yaml").write_text(experiment)
    (tmp_path / "scene.yaml").write_text(scene)
    shutil.copy(PACKAGES / "phri_sim" / "config" / "scenes" / "maze.png", tmp_path / "my_maze.png")
    loaded = phri_sim.Experiment(str(tmp_path / "experiment.yaml"), {"scene": str(tmp_path / "scene.yaml")})
    assert (loaded.controllers, loaded.participants, loaded.seed) == (["none", "pd", "mahalanobis"], 4, 1)


def test_recipe_for_a_controller_works(tmp_path):
    """The page's two C++ pieces put into a copy of the source, its test into a copy of the test; built and run."""
    devel = pathlib.Path(os.environ.get("PHRI_DEVEL", ROOT / "catkin_ws" / "devel"))
    if not (devel / "lib" / "libphri_control.so").exists():
        pytest.skip("the workspace is not built")
    text = page("own_controller.md")
    (klass, entry, test), (lines,) = fenced(text, "cpp"), fenced(text, "yaml")
    package = PACKAGES / "phri_control"
    source = (package / "src" / "assistance.cpp").read_text()
    assert source.count("using Factory") == 1
    catalogue = re.search(r"entries = \{(.*?)\n  \};", source, re.DOTALL)
    source = source[:catalogue.end(1)] + "\n" + entry + source[catalogue.end(1):]
    (tmp_path / "assistance.cpp").write_text(source.replace("using Factory", klass + "\nusing Factory"))
    head = (package / "test" / "test_assistance.cpp").read_text().partition("\nTEST(")[0]
    (tmp_path / "test.cpp").write_text(head + "\n" + test)
    compiler = ["ccache", "g++"] if shutil.which("ccache") else ["g++"]
    flags = ["-std=c++17", "-O0", "-I/usr/include/eigen3", f"-I{package}/include", f"-I{PACKAGES}/phri_core/include"]
    for name in ("assistance", "test"):
        built = subprocess.run([*compiler, *flags, "-c", f"{name}.cpp", "-o", f"{name}.o"], cwd=tmp_path,
                               capture_output=True, text=True)
        assert built.returncode == 0, built.stderr[-3000:]
    linked = subprocess.run(["g++", "test.o", "assistance.o", f"-L{devel}/lib", f"-Wl,-rpath,{devel}/lib",
                             "-lphri_control", "-lphri_core", "-lgtest", "-lgtest_main", "-lpthread", "-o", "recipe"],
                            cwd=tmp_path, capture_output=True, text=True)
    assert linked.returncode == 0, linked.stderr[-3000:]
    ran = subprocess.run(["./recipe", "--gtest_filter=Pace.*"], cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0 and "[  PASSED  ] 1 test." in ran.stdout, ran.stdout
    assert "pace" in lines


# --- the machinery --------------------------------------------------------------------------------------------------

def test_filter_keeps_the_lines_of_an_equation_and_gives_the_lead_to_the_file():
    text = ("#pragma once\n/// Lesson:\n///\n///   a = b\n///     + c\n/// and so on.\n\n#include <x>\n\n"
            "/// Of f.\nvoid f();\n")
    out = doxygen_filter.filtered(text, "x.hpp")
    assert "@file x.hpp\nLesson:\n" in out
    assert "@verbatim\n  a = b\n    + c\n@endverbatim\nand so on." in out
    assert out.count("@file") == 1 and "/**\nOf f.\n*/\nvoid f();" in out


def test_links_out_of_the_site_become_paths():
    text = "[a](architecture.md) [b](../README.md#x) [c](../scripts/env.sh)\n```\n[f](../g)\n```\n[h](https://x.y/z)"
    out = site_pages.rewritten(text, "docs")
    assert "[a](architecture.md) [b](readme.md#x) c (`scripts/env.sh`)" in out
    assert "[f](../g)" in out and "[h](https://x.y/z)" in out


def test_every_public_header_has_its_place(tmp_path):
    """A header that is added later appears without anybody listing it."""
    pages = {package.name: site_pages.cpp_page(package.name, {}) for package in PACKAGES.iterdir()
             if site_pages.headers(package.name)}
    headers = [header for header in PACKAGES.glob("*/include/*/*.hpp")]
    assert headers
    assert all(f"{header.parent.name}/{header.name}\n---" in pages[header.parent.name] for header in headers)
