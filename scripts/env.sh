# shellcheck shell=bash
# Source this: Debian's ROS and the built workspace, with the system's Python first. (The ROS modules belong to
# /usr/bin/python3; a pyenv or conda python that comes first on PATH cannot import rospy.)
# PHRI_PROFILE=debug or asan takes the workspace that scripts/build.sh built with that name.
PHRI_ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PHRI_ROOT
case $PATH in /usr/bin:*) ;; *) PATH=/usr/bin:/bin:$PATH ;; esac
# all nodes run on this machine: its name need not resolve
export ROS_HOSTNAME=${ROS_HOSTNAME:-localhost} ROS_MASTER_URI=${ROS_MASTER_URI:-http://localhost:11311}

PHRI_DEVEL=$PHRI_ROOT/catkin_ws/devel
[ "${PHRI_PROFILE:-release}" = release ] || PHRI_DEVEL=${PHRI_DEVEL}_$PHRI_PROFILE
export PHRI_DEVEL
if [ -f "$PHRI_DEVEL/setup.bash" ]; then
  # shellcheck source=/dev/null
  . "$PHRI_DEVEL/setup.bash"
fi

if [ "${PHRI_PROFILE:-release}" = asan ]; then
  # Python loads our modules into a program that was not built with the sanitizers (scripts/test.py preloads these);
  # ROS and Python themselves leak
  PHRI_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libstdc++.so.6)"
  export PHRI_PRELOAD ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1
fi

# into every bag and session.yaml
PHRI_GIT_REVISION=$(git -C "$PHRI_ROOT" describe --always --dirty 2>/dev/null || echo unknown)
export PHRI_GIT_REVISION

export PATH=$PHRI_ROOT/analysis/bin:$PATH PYTHONPATH=$PHRI_ROOT/analysis${PYTHONPATH:+:$PYTHONPATH}
