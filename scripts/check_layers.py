#!/usr/bin/python3
"""Check the rules of the house that no compiler checks; one finding per line, `file:line: rule: text`.

  layer     who may see whom: C++ includes, Python imports, package.xml dependencies (tables SEES and LIBRARIES below)
  ros       ROS and phri_msgs only in ros/ and nodes/ folders, in programs that a .test file starts and in phri_rviz;
            rosbag only in ros/ folders, such programs, analysis/phri_analysis/bag*.py and analysis/tests
  call      calls that are unsafe, or that draw random numbers anywhere but from phri_core::Random
  size      no source file past 400 lines
  path      no path of one particular machine
  link      relative links in Markdown lead to a file of the checkout

usage: check_layers.py [ROOT]   (default: the checkout this script is in). Exit status 1 when there is a finding.
"""

import ast
import os
import pathlib
import re
import sys
import xml.etree.ElementTree as ET

# What the core of each package (all but its ros/ and nodes/ folders) may see besides itself and the standard library.
PEERS = {"phri_core", "phri_control", "phri_learning", "phri_planning"}
SEES = {
    "phri_core": {"eigen"},
    "phri_msgs": {"eigen", "phri_core", "messages"},
    "phri_control": {"eigen", "phri_core", "kdl"},
    "phri_learning": {"eigen", "phri_core", "nlohmann", "openssl"},
    "phri_planning": {"eigen", "phri_core", "ompl"},
    "phri_sim": {"eigen", "bullet", "kdl", "yaml", "pixbuf", "tinyxml2", "zlib", "nlohmann"} | PEERS,
    "phri_rviz": {"qt", "ros", "messages", "phri_msgs"},  # a plugin of rviz: no core of its own
}
ROS_ZONE = {"ros", "messages", "phri_msgs"}
NODE_FOLDERS = ("ros", "nodes")

# Library of an include, by its path; the first match counts. What matches nothing is a finding: add it here on purpose.
LIBRARIES = [(re.compile(pattern), library) for pattern, library in (
    (r"(phri_\w+)/", None),  # one of ours: its own name
    (r"(unsupported/)?Eigen/", "eigen"),
    (r"(kdl|kdl_parser|urdf|urdf_model|urdf_parser)/", "kdl"),
    (r"tinyxml2\.h$", "tinyxml2"),
    (r"ompl/", "ompl"),
    (r"nlohmann/", "nlohmann"),
    (r"openssl/", "openssl"),
    (r"yaml-cpp/", "yaml"),
    (r"gdk-pixbuf/", "pixbuf"),
    (r"zlib\.h$", "zlib"),
    (r"Qt?[A-Z]\w*(/Q\w+)?$|qwt_\w+\.h$", "qt"),
    (r"benchmark/", "benchmark"),
    (r"bullet/|Bullet\w+/|LinearMath/|bt\w+\.h$", "bullet"),
    (r"pybind11/", "pybind11"),
    (r"g(test|mock)/", "gtest"),
    (r"rosbag/", "rosbag"),
    (r"\w+_msgs/|std_srvs/|ros/(time|duration|header|message\w*|serialization)\.h$", "messages"),
    (r"(ros|tf2\w*|roslib|actionlib|diagnostic_updater|dynamic_reconfigure|interactive_markers|message_filters|nodelet"
     r"|pluginlib|rviz|xmlrpcpp|rosgraph\w*|topic_tools)/|XmlRpc\w*\.h$", "ros"),
    (r"[a-z_0-9]+$|(sys|linux)/|(assert|dlfcn|errno|fcntl|float|limits|math|poll|pthread|sched|semaphore|signal|spawn"
     r"|std\w+|string|time|unistd|[exp]mmintrin)\.h$", "std"),
)]
# The same by the keys of package.xml
KEYS = {"eigen": "eigen", "orocos_kdl": "kdl", "liborocos-kdl-dev": "kdl", "liborocos-kdl": "kdl", "kdl_parser": "kdl",
        "urdfdom": "kdl", "tinyxml2": "tinyxml2",
        "urdf": "kdl", "ompl": "ompl", "libompl-dev": "ompl", "nlohmann-json-dev": "nlohmann", "libssl-dev": "openssl",
        "openssl": "openssl", "libopenssl-dev": "openssl", "yaml-cpp": "yaml", "zlib": "zlib",
        "bullet": "bullet", "libbullet-dev": "bullet", "std_srvs": "messages", "message_generation": "messages",
        "message_runtime": "messages", "genpy": "messages", "roscpp": "ros", "rospy": "ros", "tf2_ros": "ros",
        "diagnostic_updater": "ros", "rosbag": "ros", "rosbag_storage": "ros", "dynamic_reconfigure": "ros"}
ROS_MODULES = {"rospy", "roslib", "roslaunch", "rosgraph", "rosnode", "rostopic", "rosparam", "rosservice", "rosmsg",
               "rospkg", "rostest", "rosunit", "actionlib", "tf2_ros", "tf2_py", "tf2_geometry_msgs", "message_filters",
               "dynamic_reconfigure", "diagnostic_updater", "interactive_markers"}

FORBIDDEN_CPP = [(re.compile(pattern), text) for pattern, text in (
    (r"(?:\b(?!Random\b)[A-Z]\w*|>)\s*::\s*Random\s*\(|\bsetRandom\s*\(",
     "Eigen's random numbers: use a seeded phri_core::Random"),
    (r"\bs?rand\s*\(", "rand: use a seeded phri_core::Random"),
    (r"\bstd::(?:\w+_distribution|mt19937(?:_64)?|random_device|default_random_engine|minstd_rand0?|ranlux\w+)\b",
     "<random> differs between standard libraries: use a seeded phri_core::Random"),
)]
PICKLES = {"pickle", "_pickle", "cPickle", "cloudpickle", "dill", "shelve", "joblib", "marshal"}
UNPICKLING = "unpickling runs what the file says; use JSON or npz"
SEEDED = {"default_rng", "Generator", "SeedSequence", "PCG64", "Philox", "BitGenerator"}  # of numpy.random

SOURCE_SUFFIXES = {".cpp", ".hpp", ".h", ".py", ".sh", ".cmake", ".js", ".css", ".j2", ".launch", ".test"}
LONGEST = 400
# the paths of developers' and CI machines
MACHINE_PATH = re.compile(r"/(?:work|farm)/|(?<!\w)/(?:home|Users)/\w")
COMMENT_OR_STRING = re.compile(
    r'R"(\w*)\(.*?\)\1"|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|//[^\n]*|/\*.*?\*/', re.DOTALL)
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*([<"])([^>"\n]+)[>"]', re.MULTILINE)
LINK = re.compile(r"\[[^\]\n]*\]\(\s*<?([^)\s>]+)[^)\n]*\)|^\s*\[[^\]\n]+\]:\s+(\S+)", re.MULTILINE)
# folders that builds and runs leave behind
LEFT_BEHIND = re.compile(
    r"(^|/)(__pycache__|\.(?!ci$|github$)[^/]+)$|^results$|^catkin_ws/(build|devel|logs|install)[^/]*$")


def line_of(text, position):
    return text.count("\n", 0, position) + 1


class Checkout:
    def __init__(self, root):
        self.root = pathlib.Path(root).resolve()
        self.findings = []
        self.files = []  # relative to the root
        for folder, names, files in os.walk(self.root):
            here = pathlib.Path(folder).relative_to(self.root)
            names[:] = sorted(name for name in names if not LEFT_BEHIND.search((here / name).as_posix()))
            self.files += [here / name for name in sorted(files)]
        # a C++ program has the name of its source, and of what it includes beside it
        started = {path.parent / node.get("type", "") for path in self.files if path.suffix == ".test"
                   for tag in ("test", "node") for node in ET.parse(self.root / path).iter(tag)}
        self.rostest_scripts = started | {program.with_suffix(".cpp") for program in started}

    def add(self, path, line, rule, text):
        self.findings.append((path.as_posix(), line, rule, text))

    def package_of(self, path):
        """(package, folder inside it), or (None, None) outside catkin_ws/src."""
        parts = path.parts
        return (parts[2], parts[3]) if len(parts) > 3 and parts[:2] == ("catkin_ws", "src") else (None, None)

    def allowed(self, path):
        """What a source file of a package may see, or None when the package has no row in the table."""
        package, folder = self.package_of(path)
        if package not in SEES:
            return None
        seen = {package, "std"} | SEES[package]
        # a test of something in ros/ is named after it
        tests_ros = folder == "test" and path.parent.parent / "ros" / path.name.removeprefix("test_") in self.files
        if folder in NODE_FOLDERS or path in self.rostest_scripts or tests_ros:
            seen |= ROS_ZONE
        if folder == "ros" or path in self.rostest_scripts or tests_ros:
            seen |= {"rosbag"}
        if folder == "python":
            seen |= {"pybind11"}
        if folder == "test":
            seen |= {"gtest"}
        if folder == "bench":
            seen |= {"benchmark"}
        return seen

    def refuse(self, path, line, library, what):
        rule = "ros" if library in ROS_ZONE | {"rosbag"} else "layer"
        package, folder = self.package_of(path)
        self.add(path, line, rule, f"{package}/{folder} must not see {library} ({what})")

    def check_cpp(self, path, text):
        seen = self.allowed(path)
        package = self.package_of(path)[0]
        if seen is None:
            return self.add(path, 1, "layer", f"package {package} has no row in the table of scripts/check_layers.py")
        for match in INCLUDE.finditer(text):
            quoted, name = match[1] == '"', match[2]
            line = line_of(text, match.start())
            if quoted and (self.root / path.parent / name).exists():
                inside = (self.root / "catkin_ws/src" / package).resolve()
                if inside not in (self.root / path.parent / name).resolve().parents:
                    self.add(path, line, "layer", f"includes {name}, a file of another package, by relative path")
                continue
            if quoted and any(file.name == name and self.package_of(file)[0] == package for file in self.files):
                continue  # of the same package, by an include path
            found = next(((match, library) for regex, library in LIBRARIES if (match := regex.match(name))), None)
            if found is None:
                self.add(path, line, "layer", f"include {name} belongs to no library of scripts/check_layers.py")
            elif (library := found[1] or found[0][1]) not in seen:
                self.refuse(path, line, library, f"include {name}")
        code = COMMENT_OR_STRING.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)
        for regex, reason in FORBIDDEN_CPP:
            for match in regex.finditer(code):
                self.add(path, line_of(code, match.start()), "call", f"{match[0].strip()}: {reason}")

    def check_import(self, path, line, module):
        root = module.split(".")[0]
        if root in PICKLES:
            self.add(path, line, "call", f"import {module}: {UNPICKLING}")
        library = ("rosbag" if root in ("rosbag", "rosbags") else "ros" if root in ROS_MODULES
                   else root if root.startswith("phri_")
                   else "messages" if root.endswith("_msgs") or root in ("std_srvs", "genpy") else None)
        if library is None:
            return
        if path.parts[0] == "catkin_ws":
            seen = self.allowed(path)
            if seen is not None and library not in seen:
                self.refuse(path, line, library, f"import {module}")
        elif path.parts[0] == "analysis" and not (path.parts[1] == "tests" or re.fullmatch(r"bag\w*\.py", path.name)):
            if library in ROS_ZONE | {"rosbag"}:
                self.add(path, line, "ros", f"analysis reads bags in bag*.py only (import {module})")

    def check_call(self, path, node, name):
        """`name` is the called function with import aliases resolved, such as numpy.random.rand."""
        keywords = {keyword.arg: keyword.value for keyword in node.keywords}
        arguments = [*node.args, *keywords.values()]

        def constant(value, *wanted):
            return isinstance(value, ast.Constant) and any(value.value is one for one in wanted)

        text = None
        if name in ("eval", "exec"):
            text = "runs text as code"
        elif re.fullmatch(r"yaml\.(full_load|unsafe_load)(_all)?", name):
            text = "use yaml.safe_load"
        elif name in ("yaml.load", "yaml.load_all") and "Safe" not in "".join(map(ast.unparse, arguments[1:])):
            text = "use yaml.safe_load"
        elif re.search(r"\.(read|to)_pickle$", name):
            text = UNPICKLING
        elif "allow_pickle" in keywords and not constant(keywords["allow_pickle"], False):
            text = "allow_pickle must stay False"
        elif name == "rospy.Publisher":
            size = keywords.get("queue_size")
            if size is None or constant(size, None) or (isinstance(size, ast.Constant) and size.value == 0):
                text = "needs queue_size >= 1 (none: blocks; 0: grows without bound)"
        elif match := re.fullmatch(r"numpy\.random\.(\w+)", name):
            if match[1] not in SEEDED:
                text = "global random state: use numpy.random.default_rng(seed)"
            elif match[1] == "default_rng" and (not arguments or constant(arguments[0], None)):
                text = "needs a seed"
        elif re.fullmatch(r"random\.[a-z]\w*", name):
            text = "global random state: use numpy.random.default_rng(seed)"
        if text:
            self.add(path, node.lineno, "call", f"{name}: {text}")

    def check_python(self, path, text):
        try:
            tree = ast.parse(text)
        except SyntaxError as error:
            return self.add(path, error.lineno or 1, "call", f"not Python: {error.msg}")
        origin = {}  # local name -> dotted name that it was imported as
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    self.check_import(path, node.lineno, alias.name)
                    root = alias.name.split(".")[0]
                    origin[alias.asname or root] = alias.name if alias.asname else root
            elif isinstance(node, ast.ImportFrom) and not node.level:
                self.check_import(path, node.lineno, node.module)
                origin.update({alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names})
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                first, dot, rest = ast.unparse(node.func).partition(".")
                # a method of something that was not imported must not look like a module's function
                self.check_call(path, node, origin.get(first, "object" if dot else first) + dot + rest)

    def check_package_xml(self, path, text):
        package = path.parts[2]
        if package not in SEES:
            return self.add(path, 1, "layer", f"package {package} has no row in the table of scripts/check_layers.py")
        has_nodes = any((self.root / path.parent / folder).is_dir() for folder in NODE_FOLDERS)
        seen = SEES[package] | (ROS_ZONE if has_nodes else set())
        if package == "phri_msgs":
            seen = seen | {"ros"} if "dynamic_reconfigure" in text else seen
        for match in re.finditer(r"<(\w*depend)\b[^>]*>\s*([^<\s]+)\s*<", text):
            key = match[2]
            library = key if key.startswith("phri_") else KEYS.get(key, "messages" if key.endswith("_msgs") else None)
            if (match[1], library) == ("exec_depend", "phri_rviz"):
                continue  # a launch file starts rviz with it
            if library is not None and library not in seen:
                if not (match[1] == "test_depend" and library in ("ros", "messages")):
                    self.refuse(path, line_of(text, match.start()), library, f"{match[1]} {key}")

    def check_links(self, path, text):
        text = re.sub(r"^(```|~~~).*?^\1", lambda m: "\n" * m[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)
        known = set(self.files) | {parent for file in self.files for parent in file.parents}
        for match in LINK.finditer(text):
            target = (match[1] or match[2]).split("#")[0]
            if not target or re.match(r"[a-z]+:", target):
                continue
            full = pathlib.Path(os.path.normpath(path.parent / target))
            if full not in known:
                self.add(path, line_of(text, match.start()), "link", f"{target} is not in the checkout")

    def check(self):
        for path in self.files:
            try:
                text = (self.root / path).read_text(encoding="utf-8")
            except UnicodeDecodeError:  # a picture, a model, a bag
                continue
            for match in MACHINE_PATH.finditer(text):
                self.add(path, line_of(text, match.start()), "path", f"names a path of one machine: {match[0]}")
            lines = text.count("\n")
            if lines > LONGEST and path.suffix in SOURCE_SUFFIXES:
                self.add(path, LONGEST + 1, "size", f"{lines} lines, at most {LONGEST}")
            if path.suffix in (".cpp", ".hpp", ".h") and path.parts[0] == "catkin_ws":
                self.check_cpp(path, text)
            elif path.suffix == ".py" or re.match(r"#!.*python", text):
                self.check_python(path, text)
            elif path.name == "package.xml" and path.parts[:2] == ("catkin_ws", "src"):
                self.check_package_xml(path, text)
            elif path.suffix == ".md":
                self.check_links(path, text)
        return sorted(self.findings)


def main():
    root = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parent.parent
    findings = Checkout(root).check()
    for path, line, rule, text in findings:
        print(f"{path}:{line}: {rule}: {text}")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
