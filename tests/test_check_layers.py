"""Every rule of scripts/check_layers.py is seen to fire on a small fake checkout, at the right line, and to stay quiet
on the nearest thing that is allowed. A rule that never fires would let the layers rot unseen."""

import pathlib
import subprocess
import sys

import pytest
from check_layers import Checkout

ROOT = pathlib.Path(__file__).resolve().parent.parent
CORE, CONTROL, LEARNING, PLANNING, SIM, MSGS = (
    f"catkin_ws/src/phri_{name}" for name in ("core", "control", "learning", "planning", "sim", "msgs"))


def check(root, files):
    """Findings on a checkout of these files (path -> text or bytes), as (file:line, rule) pairs."""
    for path, text in files.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(text if isinstance(text, bytes) else text.encode())
    return [(f"{path}:{line}", rule) for path, line, rule, _ in Checkout(root).check()]


def test_command_prints_one_line_per_finding_and_fails(tmp_path):
    def run():
        return subprocess.run([sys.executable, ROOT / "scripts" / "check_layers.py", tmp_path], capture_output=True,
                              text=True)

    assert check(tmp_path, {"a.py": "x = 1\n"}) == []
    assert (run().returncode, run().stdout) == (0, "")
    check(tmp_path, {"a.py": "import pickle\neval('1')\n"})
    assert run().returncode == 1
    assert [line.split(": ")[:2] for line in run().stdout.splitlines()] == [["a.py:1", "call"], ["a.py:2", "call"]]


def include(name):
    return f"#pragma once\n#include <{name}>\n"


INCLUDES = [
    # file, what it includes, the rule that fires or None
    (f"{CORE}/src/a.cpp", "Eigen/Dense", None),
    (f"{CORE}/src/a.cpp", "vector", None),
    (f"{CORE}/src/a.cpp", "phri_core/check.hpp", None),
    (f"{CORE}/src/a.cpp", "kdl/chain.hpp", "layer"),
    (f"{CORE}/src/a.cpp", "nlohmann/json.hpp", "layer"),
    (f"{CORE}/src/a.cpp", "phri_control/lq_solver.hpp", "layer"),
    (f"{CORE}/src/a.cpp", "unheard_of/thing.hpp", "layer"),
    (f"{CORE}/src/a.cpp", "gtest/gtest.h", "layer"),
    (f"{CORE}/test/test_a.cpp", "gtest/gtest.h", None),
    (f"{CORE}/src/a.cpp", "pybind11/eigen.h", "layer"),
    (f"{CORE}/python/bindings.cpp", "pybind11/eigen.h", None),
    (f"{CONTROL}/src/a.cpp", "kdl/chain.hpp", None),
    (f"{CONTROL}/src/a.cpp", "ompl/base/SpaceInformation.h", "layer"),
    (f"{CONTROL}/src/a.cpp", "phri_learning/time_hmm.hpp", "layer"),
    (f"{CONTROL}/ros/a_node.cpp", "phri_learning/time_hmm.hpp", "layer"),
    (f"{LEARNING}/src/a.cpp", "nlohmann/json.hpp", None),
    (f"{LEARNING}/src/a.cpp", "openssl/evp.h", None),
    (f"{LEARNING}/src/a.cpp", "btBulletDynamicsCommon.h", "layer"),
    (f"{LEARNING}/src/a.cpp", "phri_sim/trial.hpp", "layer"),
    (f"{PLANNING}/src/a.cpp", "ompl/base/SpaceInformation.h", None),
    (f"{PLANNING}/src/a.cpp", "kdl/chain.hpp", "layer"),
    (f"{SIM}/src/a.cpp", "phri_learning/time_hmm.hpp", None),
    (f"{SIM}/src/a.cpp", "bullet/btBulletDynamicsCommon.h", None),
    (f"{SIM}/src/a.cpp", "ros/ros.h", "ros"),
    (f"{SIM}/ros/a_node.cpp", "ros/ros.h", None),
    (f"{SIM}/src/a.cpp", "geometry_msgs/WrenchStamped.h", "ros"),
    (f"{SIM}/test/test_a.cpp", "phri_msgs/Prediction.h", "ros"),
    (f"{SIM}/ros/a_node.cpp", "phri_msgs/Prediction.h", None),
    (f"{SIM}/src/a.cpp", "rosbag/bag.h", "ros"),
    (f"{SIM}/ros/a_node.cpp", "rosbag/bag.h", None),
    (f"{MSGS}/include/phri_msgs/convert.hpp", "geometry_msgs/Wrench.h", None),
    (f"{MSGS}/include/phri_msgs/convert.hpp", "phri_core/spatial.hpp", None),
    (f"{MSGS}/include/phri_msgs/convert.hpp", "ros/ros.h", "ros"),
    (f"{MSGS}/include/phri_msgs/convert.hpp", "phri_control/feedback_policy.hpp", "layer"),
    ("catkin_ws/src/phri_new/src/a.cpp", "vector", "layer"),
]


@pytest.mark.parametrize("path, name, rule", INCLUDES)
def test_include(tmp_path, path, name, rule):
    found = check(tmp_path, {path: include(name)})
    line = 1 if "phri_new" in path else 2
    assert found == ([(f"{path}:{line}", rule)] if rule else [])


def test_relative_include_stays_in_its_package(tmp_path):
    header = {f"{CORE}/src/inner.hpp": "", f"{CONTROL}/src/inner.hpp": ""}
    source = f"{CONTROL}/src/a.cpp"
    assert check(tmp_path, {**header, source: '#include "inner.hpp"\n'}) == []
    assert check(tmp_path, {source: '#include "../../phri_core/src/inner.hpp"\n'}) == [(f"{source}:1", "layer")]


IMPORTS = [
    (f"{CORE}/test/test_a.py", "import phri_core", None),
    (f"{CONTROL}/test/test_a.py", "import phri_learning", "layer"),
    (f"{CONTROL}/test/test_a.py", "from phri_analysis import metrics", "layer"),
    (f"{LEARNING}/nodes/learner_node.py", "import rospy", None),
    (f"{LEARNING}/nodes/learner_node.py", "from phri_msgs.msg import Prediction", None),
    (f"{LEARNING}/nodes/learner_node.py", "import rosbag", "ros"),
    (f"{LEARNING}/nodes/learner_node.py", "import phri_control", "layer"),
    (f"{LEARNING}/test/test_a.py", "import rospy", "ros"),
    (f"{LEARNING}/test/test_a.py", "from std_msgs.msg import Float64", "ros"),
    (f"{SIM}/test/test_a.py", "import phri_learning", None),
    (f"{SIM}/ros/tool.py", "import rosbag", None),
    (f"{MSGS}/python/convert.py", "from geometry_msgs.msg import Wrench", None),
    (f"{MSGS}/python/convert.py", "import rospy", "ros"),
    ("analysis/phri_analysis/bags.py", "import rosbag", None),
    ("analysis/phri_analysis/metrics.py", "import rosbag", "ros"),
    ("analysis/phri_analysis/metrics.py", "from rosbags import highlevel", "ros"),
    ("analysis/phri_analysis/metrics.py", "import rospy", "ros"),
    ("analysis/tests/test_bags.py", "import rosbag", None),
    ("analysis/phri_analysis/simulate.py", "import phri_sim", None),
]


@pytest.mark.parametrize("path, statement, rule", IMPORTS)
def test_import(tmp_path, path, statement, rule):
    found = check(tmp_path, {path: f'"""Text."""\n{statement}\n'})
    assert found == ([(f"{path}:2", rule)] if rule else [])


def test_a_script_that_a_rostest_starts_may_see_ros(tmp_path):
    script = {f"{LEARNING}/test/test_node.py": "import rospy\nimport phri_msgs.msg\n"}
    launch = '<launch><test test-name="a" pkg="phri_learning" type="test_node.py"/></launch>'
    assert check(tmp_path, {**script, f"{LEARNING}/test/node.test": launch}) == []


DEPENDENCIES = [
    (CORE, "depend", "eigen", None),
    (CORE, "depend", "roscpp", "ros"),
    (CORE, "test_depend", "rosunit", None),
    (CONTROL, "depend", "phri_core", None),
    (CONTROL, "depend", "phri_learning", "layer"),
    (CONTROL, "test_depend", "phri_sim", "layer"),
    (CONTROL, "depend", "ompl", "layer"),
    (CONTROL, "exec_depend", "phri_msgs", "ros"),
    (SIM, "depend", "bullet", None),
    (SIM, "depend", "phri_control", None),
    ("catkin_ws/src/phri_new", "depend", "eigen", "layer"),
]


@pytest.mark.parametrize("package, tag, key, rule", DEPENDENCIES)
def test_package_dependency(tmp_path, package, tag, key, rule):
    path = f"{package}/package.xml"
    found = check(tmp_path, {path: f"<package>\n<name>x</name>\n<{tag}>{key}</{tag}>\n</package>\n"})
    line = 1 if "phri_new" in path else 3
    assert found == ([(f"{path}:{line}", rule)] if rule else [])


def test_a_package_with_nodes_may_depend_on_ros(tmp_path):
    xml = "<package><depend>rospy</depend><depend>phri_msgs</depend></package>\n"
    assert check(tmp_path, {f"{LEARNING}/package.xml": xml, f"{LEARNING}/nodes/a.py": ""}) == []


CPP_CALLS = [
    ("auto a = Eigen::VectorXd::Random(3);", True),
    ("Eigen::Matrix<double, 2, 2>::Random();", True),
    ("matrix.setRandom();", True),
    ("int a = std::rand();", True),
    ("srand(1);", True),
    ("std::normal_distribution<double> n;", True),
    ("std::mt19937_64 engine(3);", True),
    ("std::random_device seed;", True),
    ("phri_core::Random random(7);", False),
    ("auto random = phri_core::Random(7);", False),
    ("Random::Random(std::uint64_t seed) {}", False),
    ("auto stream = Random::stream(7, text);", False),
    ("// unlike std::rand() or VectorXd::Random()", False),
    ("/* std::mt19937 */ int operand(int a);", False),
    ('throw Error("std::mt19937 is not used");', False),
]


@pytest.mark.parametrize("code, fires", CPP_CALLS)
def test_forbidden_cpp(tmp_path, code, fires):
    path = f"{CORE}/src/a.cpp"
    assert check(tmp_path, {path: f"\n/* two\nlines */\n{code}\n"}) == ([(f"{path}:4", "call")] if fires else [])


PYTHON_CALLS = [
    ("import yaml\nyaml.load(text)", True),
    ("import yaml\nyaml.load(text, Loader=yaml.Loader)", True),
    ("import yaml as y\ny.full_load(text)", True),
    ("from yaml import load\nload(text)", True),
    ("import yaml\nyaml.load(text, Loader=yaml.CSafeLoader)", False),
    ("import yaml\nyaml.safe_load(text)", False),
    ("#\nimport pickle", True),
    ("import pandas as pd\npd.read_pickle(path)", True),
    ("table = ...\ntable.to_pickle(path)", True),
    ("#\neval('1')", True),
    ("frame = ...\nframe.eval('a + b')", False),
    ("import numpy as np\nnp.load(path, allow_pickle=True)", True),
    ("import numpy as np\nnp.load(path, allow_pickle=False)", False),
    ("import numpy as np\nnp.random.rand(3)", True),
    ("import numpy as np\nnp.random.default_rng()", True),
    ("import numpy as np\nnp.random.default_rng(None)", True),
    ("import numpy as np\nnp.random.default_rng(7).normal()", False),
    ("import random\nrandom.shuffle(order)", True),
    ("import random\nrandom.Random(7).shuffle(order)", False),
    ("random = make()\nrandom.normal()", False),
    ("import rospy\nrospy.Publisher('a', A)", True),
    ("import rospy\nrospy.Publisher('a', A, queue_size=None)", True),
    ("import rospy\nrospy.Publisher('a', A, queue_size=0)", True),
    ("from rospy import Publisher\nPublisher('a', A, latch=True)", True),
    ("import rospy\nrospy.Publisher('a', A, queue_size=10)", False),
    ("#\ndef f(:", True),
]


@pytest.mark.parametrize("code, fires", PYTHON_CALLS)
def test_forbidden_python(tmp_path, code, fires):
    path = f"{SIM}/nodes/a.py"
    assert check(tmp_path, {path: code + "\n"}) == ([(f"{path}:2", "call")] if fires else [])


def test_python_without_suffix_is_checked(tmp_path):
    tool = "analysis/bin/tool"
    assert check(tmp_path, {tool: "#!/usr/bin/python3\neval('1')\n"}) == [(f"{tool}:2", "call")]


@pytest.mark.parametrize("lines, fires", [(400, False), (401, True)])
def test_file_length(tmp_path, lines, fires):
    path = f"{CORE}/src/a.cpp"
    found = check(tmp_path, {path: "\n" * lines, "docs/a.md": "\n" * 500})
    assert found == ([(f"{path}:401", "size")] if fires else [])


# put together here, so that this file is not a finding itself
WORK, HOME = "/".join(["", "work", ""]), "/".join(["", "home", "me"])


@pytest.mark.parametrize("text, fires", [(WORK + "main", True), (HOME, True), ("net/work_space/home", False)])
def test_machine_path(tmp_path, text, fires):
    assert check(tmp_path, {"a.yaml": f"a: 1\nb: {text}\n"}) == ([("a.yaml:2", "path")] if fires else [])


def test_link(tmp_path):
    page = ("# Title\n[a](../README.md#x) [b](other.md) ![c](figures/none.png)\n[d](https://x.org/y) [e](#here)\n"
            "[f]: gone.md\n")
    files = {"README.md": "[docs](docs)\n", "docs/a.md": page, "docs/other.md": "```\n[g](no.md)\n```\n"}
    assert check(tmp_path, files) == [("docs/a.md:2", "link"), ("docs/a.md:4", "link")]


def test_what_builds_leave_is_not_looked_at(tmp_path):
    bad = "import pickle\n"
    folders = ["catkin_ws/build_asan", "catkin_ws/devel", "results/tests", "x/__pycache__", ".git"]
    picture = {"picture.png": b"\x89PNG\xff\xfe" + HOME.encode()}
    assert check(tmp_path, {**{f"{folder}/a.py": bad for folder in folders}, **picture}) == []
    assert check(tmp_path, {".ci/a.py": bad}) == [(".ci/a.py:1", "call")]
