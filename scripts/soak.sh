#!/bin/bash
# Runs the random problems of the tests a hundred times as often: the cases named Soak* of every test_soak_* program, in
# as many programs at once as there are cores. Source scripts/env.sh first (make soak does).
#   PHRI_SOAK=100        times what `make test` runs, 0.001 to 10000
#   PHRI_SOAK_SEED=4711  with PHRI_SOAK_FILTER=Suite.case: one problem, as a failure names it
#   PHRI_SOAK_FILTER='Soak*'
#   PHRI_SOAK_JOBS=n     programs at once
# results/soak/ (or PHRI_SOAK_RESULTS) gets a JUnit file and the output of each. Printed: per case the problems, what
# they ended in, and the seconds of computing; last line: N problems, F failed.
# Exit status: 0, 64 usage, 66 the tests are not built, 70 a problem or a program failed.
set -uo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
results=${PHRI_SOAK_RESULTS:-$root/results/soak}
programs=${PHRI_DEVEL:-$root/catkin_ws/devel}/lib
filter=${PHRI_SOAK_FILTER:-Soak*}
export PHRI_SOAK=${PHRI_SOAK:-100}

fail()
{
  echo "soak: $1" >&2
  exit "$2"
}

[ $# -eq 0 ] || fail "unknown argument $1; usage: [PHRI_SOAK=100] soak.sh" 64
if ! [[ $PHRI_SOAK =~ ^[0-9]*\.?[0-9]+$ ]] ||
  ! awk -v factor="$PHRI_SOAK" 'BEGIN { exit !(factor >= 0.001 && factor <= 10000) }'; then
  fail "PHRI_SOAK=$PHRI_SOAK, expected a number from 0.001 to 10000" 64
fi
jobs=${PHRI_SOAK_JOBS:-$(nproc)}
[[ $jobs =~ ^[1-9][0-9]{0,2}$ ]] || fail "PHRI_SOAK_JOBS=$jobs, expected 1 to 999" 64
parts=$jobs
if [ -n "${PHRI_SOAK_SEED+set}" ]; then
  [[ $PHRI_SOAK_SEED =~ ^[0-9]+$ ]] || fail "PHRI_SOAK_SEED=$PHRI_SOAK_SEED, expected the number of a problem" 64
  parts=1
fi

mapfile -t found < <(find -L "$programs" -mindepth 2 -maxdepth 2 -type f -perm -u+x -name '*_test_soak_*' 2>/dev/null |
  sort)
[ ${#found[@]} -gt 0 ] || fail "no program *_test_soak_* in $programs: make build first" 66
rm -rf "$results"
mkdir -p "$results" || fail "cannot write $results" 74

runPart()
{
  local parts=$1 filter=$2 results=$3 program=$4 part=$5 name
  name=$(basename "$program").$part
  PHRI_SOAK_PART=$part/$parts "$program" --gtest_color=no "--gtest_filter=$filter" \
    "--gtest_output=xml:$results/$name.xml" >"$results/$name.txt"
  echo "$name $?" >>"$results/status"
}
export -f runPart
for program in "${found[@]}"; do
  for ((part = 1; part <= parts; ++part)); do printf '%s\0%s\0' "$program" "$part"; done
done | xargs -0 -n 2 -P "$jobs" bash -c 'runPart "$@"' runPart "$parts" "$filter" "$results"

# what failed, as the programs said it, and how to run it alone
grep -h -A 12 ': Failure$' "$results"/*.txt | head -n 60 >&2
awk -v expected=$((${#found[@]} * parts)) '
  FILENAME ~ /status$/ {
    ++ended
    if ($2 > 1) {  # 1: a failed assertion, which its case counts
      ++broken
      print "soak: program " $1 " ended with status " $2 >"/dev/stderr"
    } else if ($2) assertion = 1
    next
  }
  /^\[soak\] / {
    name = $2
    sub(/:$/, "", name)
    if (!(name in problems)) order[++cases] = name
    problems[name] += $3
    failed[name] += $5
    seconds[name] += $7
    total += $3
    bad += $5
    for (i = 9; i + 1 <= NF; i += 2) {
      kind = name SUBSEP $i
      if (!(kind in count)) kinds[name] = kinds[name] " " $i
      count[kind] += $(i + 1)
    }
  }
  END {
    for (i = 1; i <= cases; ++i) {
      name = order[i]
      printf "%s: %d problems, %d failed, %.1f s\n", name, problems[name], failed[name], seconds[name]
      n = split(kinds[name], list, " ")
      for (j = 1; j <= n; ++j) printf "    %-24s %d\n", list[j], count[name SUBSEP list[j]]
    }
    if (!total && !broken) print "soak: no case was run: does PHRI_SOAK_FILTER match one?" >"/dev/stderr"
    if (assertion && !bad) print "soak: a case failed as a whole, see the .txt files of the results" >"/dev/stderr"
    printf "%d problems, %d failed\n", total, bad + broken + (expected - ended)
    if (!total && !broken) exit 64
    exit bad || broken || assertion || ended != expected ? 70 : 0
  }' "$results/status" "$results"/*.txt
