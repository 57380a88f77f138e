#!/bin/bash
# Format, lint, launch files and layer rules. Every check runs; the exit status is non-zero when any has a finding.
# Needs the built workspace sourced (make check does both).
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
failed=()

# sources FIND_EXPRESSION...: files of the checkout, without what builds and runs leave behind
sources()
{
  find . \( -name .git -o -name __pycache__ -o -path ./results -o -path './catkin_ws/.catkin_tools' -o \
    -path './catkin_ws/build*' -o -path './catkin_ws/devel*' -o -path './catkin_ws/logs*' -o -name '.venv' \) -prune \
    -o -type f \( "$@" \) -print | sort
}

# check NAME COMMAND...: runs it, and shows what it says when it fails
check()
{
  local name=$1 output
  shift
  if output=$("$@" 2>&1); then
    echo "ok    $name"
  else
    printf 'FAIL  %s\n%s\n' "$name" "$output"
    failed+=("$name")
  fi
}

checkFormat()
{
  local bad=0 file
  for file in "${cpp[@]}"; do
    clang-format --dry-run -Werror "$file" 2>/dev/null || { echo "$file: clang-format -i would change it"; bad=1; }
  done
  return $bad
}

checkLaunchFiles()
{
  local bad=0 launch
  mkdir -p results/check
  for launch in $(sources -path '*/launch/*.launch'); do
    python3 /usr/share/roslaunch/scripts/roslaunch-check -o results/check/roslaunch.xml "$launch" || bad=1
  done
  return $bad
}

mapfile -t cpp < <(sources -name '*.cpp' -o -name '*.hpp')
mapfile -t shell < <(sources -name '*.sh' -o -path './.ci/run')
mapfile -t yaml < <(sources -name '*.yaml' -o -name '*.yml')
# Python by name or by first line (catkin nodes and phri-analysis may have no suffix)
mapfile -t python < <({ sources -name '*.py'; sources ! -name '*.*' -exec grep -lE '^#!.*python' {} \; ; } | sort -u)

check "clang-format" checkFormat
# the include folders are installed by phri_library, which catkin_lint does not look into
check "catkin_lint" catkin_lint -q -W1 --strict --offline --ignore uninstalled_include_path catkin_ws/src
check "flake8" flake8 "${python[@]}"
check "shellcheck" shellcheck "${shell[@]}"
check "yamllint" yamllint --strict "${yaml[@]}"
check "roslaunch-check" checkLaunchFiles
check "layer rules" scripts/check_layers.py
[ ${#failed[@]} -eq 0 ] || { echo "check: findings in: $(IFS=,; echo "${failed[*]}")" >&2; exit 1; }
echo "check: no findings"
