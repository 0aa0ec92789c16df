#!/bin/sh
# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# Makes the virtual environment $1 with tirgeo in it, editable. Run by make, from the project.
#   setup.sh .venv user          what the demo needs; ROS 2 Jazzy from wheels, or the sourced one
#   setup.sh .venv-floor floor   the oldest versions that tirgeo is made for, without ROS
set -eu
venv=$1
kind=$2

stop() {
    echo "tirgeo: $*" >&2
    exit 1
}

if [ "$kind" = floor ]; then
    unset ROS_DISTRO PYTHONPATH # a sourced ROS would bring its own versions in
    newest=3.12                 # NumPy 1.26 has no wheels for a later Python
    options=
    extras='test,maps,video,plots,page,dji'
    pins='numpy==1.26.* opencv-python-headless==4.6.* pyproj==3.6.* Pillow==10.2.*'
    pins="$pins mcap==1.1.* rosbags==0.10.11 cryptography==41.* pyogrio==0.12.* matplotlib==3.6.* scipy==1.11.* av==16.1.*"
    pins="$pins aiohttp==3.9.* mgrs==1.4.6 segno==1.5.* pytak==7.5.2"
elif [ "${ROS_DISTRO:-}" = jazzy ]; then
    newest=3.13
    options=--system-site-packages
    extras=video
    # The messages of a ROS 2 from packages are compiled against NumPy 1, and so is OpenCV to 4.11.
    pins='numpy<2 opencv-python-headless<4.12'
elif [ -n "${ROS_DISTRO:-}" ]; then
    stop "ROS 2 $ROS_DISTRO is sourced, but tirgeo is made for Jazzy: source" \
        "/opt/ros/jazzy/setup.bash, or take a shell without ROS (then its wheels are installed)"
elif [ "$(uname -sm)" = "Linux x86_64" ]; then
    newest=3.13
    options=
    extras=ros,video
    pins=
else
    stop "the wheels of ROS 2 Jazzy are for Linux on x86-64, this is $(uname -sm):" \
        "install ROS 2 Jazzy, source it and run make again"
fi

here=$(dirname "$0")
python=$("$here/find_python.sh" "$newest")
# The environment of before is kept until the new one is whole: without a network it would be lost.
old=$venv.old
put_back() {
    rm -rf "$venv"
    if [ -d "$old" ]; then mv "$old" "$venv"; fi
}
if [ -d "$old" ]; then put_back; fi # a run that was killed left it
if [ -d "$venv" ]; then mv "$venv" "$old"; fi
trap put_back EXIT
trap 'exit 130' HUP INT TERM

echo "tirgeo: setting up $venv with $python (once, some 40 s)" >&2
# shellcheck disable=SC2086 # no option must be no argument
"$python" -m venv $options "$venv"
for pin in $pins; do echo "$pin"; done >"$venv/constraints.txt"
"$here/pip_install.sh" "$venv" --editable ".[$extras]"
trap - EXIT
rm -rf "$old"
