#!/bin/bash
# A minute of trials in real time, recorded, with a model that learns beside them: how late the ticks of 1 kHz came.
# Leaves the bags and lateness.png in results/realtime/<UTC>/. Needs a built workspace (make realtime builds it).
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
set +u
. "$root/scripts/env.sh"
set -u
trials=${TRIALS:-5}  # about 14 s each
experiment=${EXPERIMENT:-maze_assistance}  # emerging_assistance learns while it runs

out=$root/results/realtime/$(date -u +%Y%m%dT%H%M%SZ)
mkdir -p "$out"
export ROS_LOG_DIR=$out/ros_log ROS_HOME=$out/ros_home
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("localhost", 0)); print(s.getsockname()[1])')
export ROS_MASTER_URI=http://localhost:$port
echo "realtime: $trials trials of $experiment, one simulated participant, in real time, into $out"
roslaunch --port="$port" phri_sim experiment.launch experiment:="$experiment" participant:=3 trial:="$trials" \
  rviz:=false record:=true "bag_dir:=$out" >"$out/launch.log" 2>&1 || true
read -r status reason <"$out/session.status" || { echo "realtime: no session.status; see $out/launch.log" >&2; exit 70; }
[ "$status" = 0 ] || { echo "realtime: the session ended with exit status $status: $reason" >&2; exit "$status"; }
phri-analysis lateness "$out"
