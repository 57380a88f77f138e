#!/usr/bin/python3
"""crocoddyl in C++ on the scenes of chapter 4: compiles peer_crocoddyl_cpp.cpp against the wheel of this interpreter,
then becomes that program, which speaks the protocol of peer.py.

It needs g++, Eigen and nlohmann-json of the distribution, and our built library: PHRI_BENCH_BUILD is the build space of
the workspace. No -march=native: the wheel is built for the baseline, and code with wider registers in the same process
aligns Eigen's memory differently. Hidden visibility: with the same Eigen templates in both, the wheel's own
instantiations would otherwise be replaced by ours.
"""

import importlib.util
import os
import pathlib
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
SOURCES = HERE.parent.parent / "catkin_ws" / "src"
OPTIONS = ("-std=c++17", "-O3", "-DNDEBUG", "-ffp-contract=off", "-fvisibility=hidden", "-fvisibility-inlines-hidden",
           "-DCROCODDYL_WITH_MULTITHREADING", "-DCROCODDYL_WITH_NTHREADS=1")


def wheel():
    """The folder with include/ and lib/ of crocoddyl."""
    crocoddyl = importlib.util.find_spec("crocoddyl")
    for folder in pathlib.Path(crocoddyl.origin).parents if crocoddyl else ():
        if (folder / "lib" / "libcrocoddyl.so").is_file():
            return folder
    sys.exit("no crocoddyl with its C++ library in this interpreter")


def library_folders():
    """Where our built libraries are."""
    build = pathlib.Path(os.environ.get("PHRI_BENCH_BUILD", ""))
    folders = []
    for package in ("phri_control", "phri_core"):
        cache = build / package / "CMakeCache.txt"
        if not cache.is_file():
            sys.exit(f"{cache} is not there: PHRI_BENCH_BUILD is not the build space of the workspace")
        devel = re.search(r"^CATKIN_DEVEL_PREFIX:\w+=(.+)$", cache.read_text(encoding="utf-8"), re.MULTILINE)
        folders.append(pathlib.Path(devel.group(1)) / "lib")
    return folders


def compiled(folder):
    """The program, in `folder`."""
    prefix, ours = wheel(), library_folders()
    program = folder / "peer_crocoddyl_cpp"
    done = subprocess.run(
        ["g++", *OPTIONS, HERE / "peer_crocoddyl_cpp.cpp", "-o", program,
         *(f"-I{SOURCES / path}" for path in ("phri_control/bench", "phri_control/include", "phri_core/include")),
         "-isystem", prefix / "include", "-isystem", "/usr/include/eigen3",
         # the wheel's first: what it needs of Eigen is its own
         f"-L{prefix / 'lib'}", "-lcrocoddyl", *(f"-L{path}" for path in ours), "-lphri_control", "-lphri_core",
         # RPATH, not RUNPATH: the wheel's libraries find each other by it
         "-Wl,--disable-new-dtags", f"-Wl,-rpath,{':'.join(map(str, [prefix / 'lib', *ours]))}"],
        capture_output=True, text=True)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if "error" in line or "undefined" in line]
        sys.exit(f"g++ against {prefix}: {(said or ['no message'])[0]}")
    return program


def main():
    case = pathlib.Path(sys.argv[1]).with_name("scenes.json")
    program = compiled(case.parent)
    os.execv(program, [program, case])


if __name__ == "__main__":
    main()
