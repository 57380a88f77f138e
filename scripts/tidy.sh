#!/bin/bash
# clang-tidy (rules: .clang-tidy) over the C++ sources of libraries and nodes, by the compile commands of the build.
set -euo pipefail
cd "$(dirname "$0")/.."
suffix=''
[ "${PHRI_PROFILE:-release}" = release ] || suffix=_$PHRI_PROFILE
status=0
for package in catkin_ws/src/*/; do
  name=$(basename "$package")
  commands=catkin_ws/build$suffix/$name
  mapfile -t files < <(find "$package"src "$package"ros -name '*.cpp' 2>/dev/null | sort)
  [ ${#files[@]} -gt 0 ] || continue
  [ -f "$commands/compile_commands.json" ] || { echo "tidy: $name is not built" >&2; exit 1; }
  echo "tidy: $name, ${#files[@]} files"
  printf '%s\0' "${files[@]}" | xargs -0 -n1 -P"$(nproc)" clang-tidy --quiet -p "$commands" 2>/dev/null || status=1
done
exit $status
