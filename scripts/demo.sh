#!/bin/bash
# The demo experiment: simulated participants carry the handle through the maze, with and without assistance; recorded
# and reported into results/demo/<UTC>/. With a display rviz shows it. Needs a built workspace (make demo builds it).
# DEMO_LIMIT=seconds: the time after which the experiment is stopped.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
# catkin's setup files read variables that are not set
set +u
. "$root/scripts/env.sh"
set -u

freePort()
{
  /usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("localhost", 0)); print(s.getsockname()[1])'
}

# DISPLAY may be set and dead (an ended ssh session): ask the X server
displayWorks()
{
  [ -n "${DISPLAY:-}" ] && timeout 10 /usr/bin/python3 -c '
import ctypes, sys
x11 = ctypes.CDLL("libX11.so.6")
x11.XOpenDisplay.restype = ctypes.c_void_p
sys.exit(0 if x11.XOpenDisplay(None) else 1)'
}

fail()
{
  echo "demo: $1" >&2
  echo "demo: what it left is in $out" >&2
  exit "${2:-1}"
}

out=$root/results/demo/$(date -u +%Y%m%dT%H%M%SZ)
mkdir -p "$out"
export ROS_LOG_DIR=$out/ros_log ROS_HOME=$out/ros_home
# without a display as fast as it can; to be watched, five times as fast as life
rviz=false pace=0
if displayWorks; then rviz=true pace=5; fi
# a master of its own: a running roscore is left alone
port=$(freePort)
export ROS_MASTER_URI=http://localhost:$port

echo "demo: experiment maze_assistance_demo into $out (rviz: $rviz)"
# roslaunch returns 0 whatever happens: the session runner leaves its exit status in a file
launched=0
timeout --foreground --signal=INT --kill-after=60 "${DEMO_LIMIT:-1800}" roslaunch --port="$port" phri_sim session.launch \
  experiment:=maze_assistance_demo "bag_dir:=$out" record:=true "rviz:=$rviz" "pace:=$pace" ||
  launched=$?
experiment_seconds=$SECONDS
[ "$launched" -ne 124 ] || fail "the experiment was stopped after ${DEMO_LIMIT:-1800} s"
[ "$launched" -eq 0 ] || fail "roslaunch ended with exit status $launched" "$launched"
[ -s "$out/session.status" ] || fail "session_runner died: it left no session.status"
# "<exit status> <reason>"
read -r status reason <"$out/session.status" || true
case $status in
  0) ;;
  *[!0-9]* | '') fail "session.status holds '$status', expected an exit status 0-255" ;;
  *) fail "the session ended with exit status $status: ${reason:-no reason given}" "$status" ;;
esac

"$root/analysis/bin/phri-analysis" report "$out" || fail "the report could not be made"
for file in table.csv report.html; do
  [ -s "$out/$file" ] || fail "phri-analysis report left no $file"
done
echo
echo "demo: experiment $experiment_seconds s, report $((SECONDS - experiment_seconds)) s"
echo "demo: report  $out/report.html"
