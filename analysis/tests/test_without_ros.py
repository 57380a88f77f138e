"""Bags are read where there is no ROS: in a virtual environment with the package `rosbags` as pyproject.toml pins it,
every ROS module refused. The environment is kept in results/ and made once; making it needs a network, without which
these tests fail."""

import json
import subprocess
import tomllib
from pathlib import Path

import pytest

import bag_writer
import synthetic
from phri_analysis import bag_check, bags
from phri_analysis.bag_files import BagFile

ROOT = Path(__file__).resolve().parents[2]
VENV = ROOT / "results" / "venv_noros"
BLOCK = """
import importlib.abc, sys
class NoRos(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        root = name.split(".")[0]
        if root in ("rosbag", "genpy", "genmsg", "roslz4", "rospy", "rospkg", "catkin") or root.endswith("_msgs"):
            raise ModuleNotFoundError(f"{name}: there is no ROS here", name=name)
sys.meta_path.insert(0, NoRos())
sys.path.insert(0, sys.argv[1])
"""
READ = """
import hashlib, json
from phri_analysis import bags
table = bags.read_trial(sys.argv[2])
columns = {name: hashlib.sha256(table[name].to_numpy().tobytes()).hexdigest() for name in table.columns}
print(json.dumps({"columns": columns, "types": [str(kind) for kind in table.dtypes], "attrs": table.attrs}))
"""
LIBRARY = """
import json
from pathlib import Path
from rosbags.rosbag1 import Reader
with Reader(Path(sys.argv[2])) as reader:
    print(json.dumps([(connection.topic, time, data.hex()) for connection, time, data in reader.messages()]))
"""


def run(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(map(str, command[:4]))}\n{done.stdout[-1000:]}{done.stderr[-3000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def python():
    """The environment's interpreter; made anew when another version is wanted."""
    project = tomllib.loads((ROOT / "analysis" / "pyproject.toml").read_text())["project"]
    wanted = project["optional-dependencies"]["noros"]
    made = VENV / "made.json"
    if not made.is_file() or json.loads(made.read_text()) != wanted:
        run("/usr/bin/python3", "-m", "venv", "--clear", "--system-site-packages", VENV)
        run(VENV / "bin" / "pip", "install", "--quiet", "--disable-pip-version-check", *wanted)
        made.write_text(json.dumps(wanted))
    return VENV / "bin" / "python"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    trial = synthetic.plausible_trial(grid=synthetic.maze_grid(30))
    table = trial.iloc[:300].reset_index(drop=True)
    table.attrs = {**trial.attrs, "clock": "realtime"}
    table["lateness"] = table["t"] * 1e-3
    return bag_writer.write_bag(table, tmp_path_factory.mktemp("noros") / "a.bag", chunk=4096, digest_every=100)


def test_the_table_is_the_same_without_ros(python, bag):
    with_ros, without = (json.loads(run(*command)) for command in (
        ["/usr/bin/python3", "-c", "import sys; sys.path.insert(0, sys.argv[1])" + READ, ROOT / "analysis", bag],
        [python, "-c", BLOCK + READ, ROOT / "analysis", bag],
    ))
    assert without == with_ros
    assert without["attrs"] == bags.read_trial(bag).attrs and "lateness" in without["columns"]


def test_the_fallback_is_what_read_it(python, bag):
    said = run(python, "-c", BLOCK + READ + "print(bags.generate_dynamic, 'rosbags' in sys.modules)", ROOT / "analysis",
               bag)
    assert said.splitlines()[-1] == "None True"


def test_recorded_and_recovered_bags_are_bags_to_the_library(python, bag, tmp_path):
    """To whoever uses `rosbags` itself, without this package."""
    cut = tmp_path / "cut.bag"
    cut.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    for path in (bag, bag_check.recover(cut)[0]):
        messages = [[m.connection.topic, m.time, m.data.hex()] for m in BagFile(path.read_bytes()).messages()]
        assert sorted(json.loads(run(python, "-c", BLOCK + LIBRARY, ROOT / "analysis", path))) == sorted(messages)


def test_without_either_the_error_says_what_to_install(bag):
    hidden = BLOCK.replace('"rosbag",', '"rosbag", "rosbags",')
    done = subprocess.run(
        ["/usr/bin/python3", "-c", hidden + "from phri_analysis.cli import main; main(['report', sys.argv[2]])",
         ROOT / "analysis", bag],
        capture_output=True, text=True)
    assert done.returncode == 66 and "pip install phri-analysis[noros]" in done.stderr, done.stderr
