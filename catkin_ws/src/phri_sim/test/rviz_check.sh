#!/bin/bash
# rviz_check.sh PICTURE.png [SECONDS [LAUNCH ARGUMENTS...]]: what rviz shows of a trial in real time, without a display.
# Starts Xvfb, experiment.launch and rviz, and saves a picture of the screen after SECONDS (default 25). Needs the built
# workspace sourced, Xvfb and imagemagick.
set -euo pipefail
picture=${1:?usage: rviz_check.sh PICTURE.png [SECONDS]}
seconds=${2:-25}
folder=$(mktemp -d)
export ROS_HOSTNAME=localhost ROS_LOG_DIR=$folder/log QT_QPA_PLATFORM=xcb LIBGL_ALWAYS_SOFTWARE=1
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("localhost", 0)); print(s.getsockname()[1])')
export ROS_MASTER_URI=http://localhost:$port
mkfifo "$folder/display"
Xvfb -displayfd 3 -screen 0 900x960x24 +extension GLX 3>"$folder/display" >"$folder/xvfb.log" 2>&1 &
xvfb=$!
DISPLAY=:$(head -n 1 "$folder/display")
export DISPLAY
roslaunch --port="$port" phri_sim experiment.launch record:=false "bag_dir:=$folder" "${@:3}" >"$folder/launch.log" 2>&1 &
launch=$!
trap 'kill -INT $launch 2>/dev/null; wait $launch; kill $xvfb; rm -rf "$folder"' EXIT
sleep "$seconds"
import -window root "$picture"
grep -iE "error|warn|fatal" "$folder/launch.log" || true
