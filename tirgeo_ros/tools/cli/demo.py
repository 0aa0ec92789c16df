# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Run the whole node graph on the sample flight.

Starts every node as a process of its own, with a DDS domain of its own, plays a bag to them in
real time and writes overlay.mp4, still.png, summary.json, the recording and the logs. Needs ROS 2
Jazzy or its wheels.

With --page the operator's page shows the flight, which is played again and again until Ctrl-C;
the folder then has only the page's targets and recordings.

example:
  tirgeo demo -o demo
  tirgeo demo --page
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._verb import ANY_BAG, METHODS, NUMBER, PAGE, UsageError, check_page
from tirgeo_ros.tools.presentation.progress import Progress, three

_SERIAL = "simulate the aircraft's serial port: DJI's protocol to dji_node over a pseudo-terminal"
OPTIONS = (
    ("-o --output", "DIR", "folder for the files (%(default)s)", {"default": Path("demo")}),
    ("--bag", "BAG", f"another flight: {ANY_BAG}"),
    ("--rate", "X", "speed of playing, times real time", NUMBER | {"default": 1.0}),
    ("--params", "YAML", "parameters; default: params.yaml beside the bag, if there"),
    ("--map", "MAP", "the map; default: map.geojson beside the bag, if there"),
    ("--method", "M", "method of the filter: %(choices)s", {"choices": METHODS}),
    ("--serial", None, _SERIAL),
    *PAGE,
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the graph; return the summary."""
    from tirgeo_ros.tools.graph.demo import (  # noqa: PLC0415 heavy
        demo_setup,
        demonstrate,
        show_page,
    )

    if not 0.01 <= args.rate <= 100:
        raise UsageError("--rate must be from 0.01 to 100")
    if args.serial and args.rate != 1:
        raise UsageError("--serial runs in real time: leave --rate out")
    check_page(args)
    options = (args.bag, args.output, args.params, args.map, args.method, args.rate)
    setup = demo_setup(*options, serial=args.serial, page=args.page is not None)
    domain = setup.environment["ROS_DOMAIN_ID"]
    sys.stderr.write(f"the nodes use ROS_DOMAIN_ID={domain} on this machine only\n")
    if args.page is not None:
        return show_page(setup, args.page, args.cot or "", sys.stderr)
    with Progress("playing", unit="s") as bar:
        return demonstrate(setup, bar)


def describe(result: dict[str, Any]) -> str:
    """Return the summary for a person; it ends with the files to look at."""
    if "page" in result:
        return f"targets and recordings: {result['page']}"
    frames = f"{result['frames_in']} frames in, {result['frames_out']} out"
    latency, cores = _number(result["frame_latency_ms"]), _number(result["cores"].get("total"))
    heading = f"heading to {_number(result['heading_sigma_deg'])} deg"
    truth = result["camera_against_truth"]
    if truth:
        metres, degrees = map(_number, (truth["position_rms_m"], truth["attitude_rms_deg"]))
        heading += f"; the camera is {metres} m and {degrees} deg off (rms)"
    lines = [
        f"{frames}, {latency} ms later; {cores} cores",
        f"{result['state']} by {result['method']}, {heading}",
        f"all numbers: {Path(result['video']).with_name('summary.json')}",
        "",
        f"look at  {result['video']}",
        f"    and  {result['still']}",
        _what_to_see(result),
    ]
    return "\n".join(lines)


def _what_to_see(result: dict[str, Any]) -> str:
    """Return what the video and the still should show."""
    drawn = result["overlay"].get("drawn", 0)
    if not drawn:
        return "no frame shows the map; each frame says why"
    return (
        "The map's lines should lie on the edges of paths and beds, in "
        f"{drawn} frames from {_number(result['first_map_after_s'])} s on."
    )


def _number(value: object) -> str:
    return three(value) if isinstance(value, float) else str(value)
