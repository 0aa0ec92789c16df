#!/bin/sh
# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# Prints a Python from 3.10 up to the version $1 (3.13) that can make a virtual environment.
# PYTHON, where set, is the only candidate; with ROS 2 sourced it must also import rclpy.
# A candidate is run, not only looked for: version managers leave names that run nothing.
set -eu
newest=${1:-3.13}

works() {
    "$1" - "$newest" "${ROS_DISTRO:-}" 2>&1 <<'PY'
import sys

newest, ros = sys.argv[1:]
version = "%d.%d" % sys.version_info[:2]
if not (3, 10) <= sys.version_info[:2] <= tuple(map(int, newest.split("."))):
    sys.exit("is Python " + version)
try:
    import ensurepip, venv
except ImportError:
    sys.exit("lacks venv (Debian, Ubuntu: sudo apt install python%s-venv)" % version)
if ros:
    try:
        import rclpy
    except ImportError as error:
        sys.exit("cannot import rclpy (%s): source ROS 2 %s, or unset ROS_DISTRO" % (error, ros))
PY
}

tried=
for name in ${PYTHON:-python3 python3.12 python3.13 python3.11 python3.10}; do
    path=$(command -v "$name") || continue
    if answer=$(works "$path"); then
        echo "$path"
        exit 0
    fi
    tried="$tried
  $path $(echo "$answer" | head -n 1)"
done
{
    echo "tirgeo needs Python 3.10 to $newest with venv; install one or name it: make PYTHON=/path/to/python3"
    echo "tried:${tried:- nothing, for ${PYTHON:-python3} is not there}"
} >&2
exit 1
