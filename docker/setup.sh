#!/bin/bash
# Installs docker/packages.txt on Debian 12 (bookworm), as root or by sudo. Safe to run again: when all is there it only
# says so. make, CI and the Dockerfile all use this script.
# Exit status: 0 all installed, 1 it could not be done, 3 this is not Debian 12.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
os_release=${PHRI_OS_RELEASE:-/etc/os-release}  # tests point this at another file
export LC_ALL=C DEBIAN_FRONTEND=noninteractive
log=$(mktemp "${TMPDIR:-/tmp}/phri_setup.XXXXXX")
trap 'rm -f "$log"' EXIT

fail()
{
  printf 'setup: %s\n' "$@" >&2
  exit 1
}

requireDebian12()
{
  # shellcheck source=/dev/null
  if [ -r "$os_release" ]; then . "$os_release"; fi
  if [ "${ID:-}" = debian ] && [ "${VERSION_CODENAME:-}" = bookworm ]; then return; fi
  cat >&2 <<EOF
setup: this is ${PRETTY_NAME:-an unknown system}. The stack uses the ROS 1 packages of Debian 12 (bookworm), which other systems lack.
setup: here it runs in a container; from the top of the checkout:

  docker build -t phri -f docker/Dockerfile .
  docker run --rm -v "\$PWD/results:/phri/results" phri make demo
  docker run --rm -v "\$PWD/results:/phri/results" phri make test

EOF
  exit 3
}

# names in $want that are not installed; one dpkg-query for all, which exits non-zero when some are unknown
missing()
{
  comm -23 <(printf '%s\n' "${want[@]}") \
    <(dpkg-query -W -f='${db:Status-Abbrev} ${Package}\n' "${want[@]}" 2>/dev/null | sed -n 's/^[ih]i *//p' | sort -u)
}

# names among the arguments that the package lists offer in no version
unavailable()
{
  comm -23 <(printf '%s\n' "$@") <(apt-cache policy "$@" 2>/dev/null |
    awk '/^[^ ].*:$/{name=substr($1, 1, length($1) - 1)} /^  Candidate:/ && $2 != "(none)"{print name}' | sort -u)
}

# apt-get's output on stdin: a line per tenth of the fetching, unpacking and setting up, since it takes minutes
showProgress()
{
  local line total=0 phase='' now count=0 tenth
  while IFS= read -r line; do
    printf '%s\n' "$line" >>"$log"
    case $line in
      *" newly installed,"*)
        [[ $line =~ ([0-9]+)\ upgraded,\ ([0-9]+)\ newly ]] && total=$((BASH_REMATCH[1] + BASH_REMATCH[2]))
        continue
        ;;
      Get:*) now=fetched ;;
      "Unpacking "*) now=unpacked ;;
      "Setting up "*) now="set up" ;;
      *) continue ;;
    esac
    [ "$now" = "$phase" ] || { phase=$now count=0 tenth=0; }
    count=$((count + 1))
    if [ "$total" -gt 0 ] && [ $((count * 10 / total)) -gt "$tenth" ]; then
      tenth=$((count * 10 / total))
      printf 'setup: %4d s  %s %d of %d packages\n' "$SECONDS" "$phase" "$count" "$total"
    fi
  done
}

requireDebian12
mapfile -t want < <(sed 's/#.*//' "$here/packages.txt" | tr -s ' \t' '\n' | grep . | sort -u)
mapfile -t need < <(missing)
if [ ${#need[@]} -eq 0 ]; then
  echo "setup: all ${#want[@]} packages are installed"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || fail "${#need[@]} packages are missing and need root: run as root, or install sudo" \
    "missing: ${need[*]}"
  as_root=(sudo)
fi
# DPkg::Lock::Timeout: another apt may be at work; Error-Mode=any: without it a broken source is only a warning
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get -q -o DPkg::Lock::Timeout=300
  -o Acquire::Retries=3 -o APT::Update::Error-Mode=any -o Dpkg::Use-Pty=0)

echo "setup: ${#need[@]} of ${#want[@]} packages are missing: ${need[*]}"
echo "setup: reading the package lists"
if ! "${apt[@]}" update >"$log" 2>&1; then
  tail -n 15 "$log" >&2
  fail "apt-get update failed: is there a network, and do the files in /etc/apt/ name a Debian 12 mirror?"
fi
mapfile -t absent < <(unavailable "${need[@]}")
[ ${#absent[@]} -eq 0 ] || fail "no package source offers: ${absent[*]}" \
  "the files in /etc/apt/ must name a Debian 12 (bookworm) mirror, component main"

if ! "${apt[@]}" install -y --no-install-recommends "${need[@]}" 2>&1 | showProgress; then
  tail -n 30 "$log" >&2
  mapfile -t need < <(missing)
  fail "apt-get install failed; not installed: ${need[*]}"
fi
mapfile -t need < <(missing)
[ ${#need[@]} -eq 0 ] || fail "apt-get ended without error, but these are not installed: ${need[*]}"
echo "setup: all ${#want[@]} packages are installed, $SECONDS s"
