#!/bin/bash
# Builds the benchmark programs and runs them beside their peers: results/bench.json and a table. Source scripts/env.sh
# first (make bench does). docs/benchmarks.md says what is measured.
#   scripts/bench.sh [--docs | --quick] [--rounds N] [--seconds S]
#     --docs   rewrites the table in docs/benchmarks.md
#     --quick  one short round into results/bench_quick.json: tells whether everything runs, its numbers mean nothing
# PEERS=no: ours alone, no network. Otherwise the peers are installed by pip into .venv/bench (1.6 GB), once.
# Exit status: 0, 64 usage, 66 the workspace is not built, 70 a peer could not be compared (its row says why).
set -uo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
build=${PHRI_BUILD:-$root/catkin_ws/build}
venv=${PHRI_BENCH_VENV:-$root/.venv/bench}
requirements=$root/scripts/bench/requirements.txt

fail()
{
  echo "bench: $1" >&2
  exit "$2"
}

buildPrograms()
{
  local log package
  for package in phri_control phri_learning phri_sim; do
    [ -f "$build/$package/CMakeCache.txt" ] || fail "$build/$package is not there: make build first" 66
  done
  log=$(mktemp)
  for package in phri_control phri_learning phri_sim; do
    # anew, because a target that CMake does not know yet does not make it look again
    if ! { cmake "$build/$package" && cmake --build "$build/$package" --target benchmarks; } >"$log" 2>&1; then
      tail -n 20 "$log" >&2
      rm -f "$log"
      fail "the benchmarks of $package do not build; they need libbenchmark-dev" 70
    fi
  done
  rm -f "$log"
}

# Peers that pip cannot install leave the reason in $venv/not_installed/<peer>, for their rows.
installPeers()
{
  cmp -s "$requirements" "$venv/installed" && return
  echo "bench: installing the peers into $venv (minutes)" >&2
  /usr/bin/python3 -m venv --clear "$venv" >&2 || { echo "bench: no venv: is python3-venv installed?" >&2; return; }
  if "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$requirements" >"$venv/pip.log" 2>&1; then
    cp "$requirements" "$venv/installed"
    return
  fi
  local line reason
  mkdir -p "$venv/not_installed"
  while read -r line; do
    case $line in '#'* | '') continue ;; esac
    if ! "$venv/bin/pip" install --quiet --disable-pip-version-check "$line" >"$venv/pip.log" 2>&1; then
      reason=$(grep -m1 ERROR "$venv/pip.log" || tail -n1 "$venv/pip.log")
      echo "bench: pip cannot install $line: $reason" >&2
      echo "pip: $reason" >"$venv/not_installed/${line%%=*}"
    fi
  done <"$requirements"
}

arguments=() output=bench.json
while [ $# -gt 0 ]; do
  case $1 in
    --docs) arguments+=(--docs "$root/docs/benchmarks.md") ;;
    --quick)
      arguments+=(--quick)
      output=bench_quick.json
      ;;
    --rounds | --seconds)
      [ $# -gt 1 ] || fail "$1 needs a number" 64
      arguments+=("$1" "$2")
      shift
      ;;
    *) fail "unknown argument $1; usage: bench.sh [--docs] [--quick] [--rounds N] [--seconds S]" 64 ;;
  esac
  shift
done
case ${PEERS:-yes} in
  yes) peers=true ;;
  no) peers=false ;;
  *) fail "PEERS=$PEERS, expected yes or no" 64 ;;
esac

buildPrograms
if $peers; then
  installPeers
  arguments+=(--peers "$venv/bin/python")
fi
exec /usr/bin/python3 "$root/scripts/bench/bench.py" --build "$build" \
  --output "$root/results/$output" "${arguments[@]}"
