#!/bin/bash
# build.sh [release|debug|asan]: builds the workspace and its tests; every profile has build and devel spaces of its own.
# JOBS=n sets how many compilers run at once.
set -euo pipefail
cd "$(dirname "$0")/../catkin_ws"
export PATH=/usr/bin:/bin:$PATH
profile=${1:-release}
case $profile in
  release) flags=(-DCMAKE_BUILD_TYPE=Release) suffix='' ;;
  debug) flags=(-DCMAKE_BUILD_TYPE=Debug) suffix=_debug ;;
  asan)
    flags=(-DCMAKE_BUILD_TYPE=RelWithDebInfo
      "-DCMAKE_CXX_FLAGS=-fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer -O1")
    suffix=_asan
    ;;
  *)
    echo "usage: build.sh [release|debug|asan]" >&2
    exit 2
    ;;
esac
command -v catkin >/dev/null || { echo "build: catkin is not installed: run docker/setup.sh" >&2; exit 1; }
command -v ccache >/dev/null && flags+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)

# an Eigen or pybind11 file takes up to 1.5 GB: a small machine must not start swapping
cores=$(nproc)
memory=$(($(awk '/MemAvailable/{print int($2 / 1048576)}' /proc/meminfo) * 2 / 3))
jobs=${JOBS:-$((cores < memory ? cores : memory))}
((jobs >= 1)) || jobs=1

# CMake refuses a build space that was made under another path: a checkout that moved, or is mounted in a container
if [ -e "build$suffix/.made_at" ] && [ "$(cat "build$suffix/.made_at")" != "$PWD" ]; then
  echo "build: the checkout has moved; building the $profile profile anew"
  rm -rf "build$suffix" "devel$suffix" "logs$suffix"
fi
mkdir -p "build$suffix"
echo "$PWD" >"build$suffix/.made_at"

catkin config --init --profile "$profile" --build-space "build$suffix" --devel-space "devel$suffix" \
  --log-space "logs$suffix" --link-devel --cmake-args "${flags[@]}" -DCATKIN_ENABLE_TESTING=ON \
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON -DPYTHON_EXECUTABLE=/usr/bin/python3 -DPython3_EXECUTABLE=/usr/bin/python3 >/dev/null
echo "build: $profile, $jobs at once"
# "tests" makes the gtest programs, which "all" leaves out. On failure catkin prints what the compiler said; sed drops
# its table of settings, which hides it.
if ! catkin build --profile "$profile" -p"$jobs" -j"$jobs" --no-status --no-notify --summarize \
  --catkin-make-args all tests -- |
  sed -u -e '/^Profile: /,/^Skiplisted Packages/d' -e '/^---*$/d' -e '/^NOTE: Forcing CMake/d' -e '/^ *$/d'; then
  echo "build: failed; the logs are in catkin_ws/logs$suffix/<package>/" >&2
  exit 1
fi
echo "build: done, $SECONDS s"
