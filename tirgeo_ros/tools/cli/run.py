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
"""Run the whole node graph in one process, on a machine without the ros2 command.

Runs live, or with --bag in simulated time until the bag ends. The nodes, their topics and their
parameters are those of the launch file, and ROS_DOMAIN_ID applies: rviz, Foxglove and recorders
can read and publish every topic. With --bag only this machine reaches the nodes. Ctrl-C ends all
nodes. If a node fails, all end with exit code 1. With --page the operator's page shows video,
targets and map in any browser; if viewer_node ends, it is started again. Needs ROS 2 Jazzy or its
wheels.

example:
  tirgeo run --map park.geojson --params my_aircraft.yaml
  tirgeo run --map park.geojson --params my_aircraft.yaml --page 0.0.0.0:8080
  tirgeo run --no-dji --remap config/mavros.yaml --map park.geojson
  tirgeo run --bag flight.mcap --map park.geojson --params my_aircraft.yaml
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from typing import NoReturn

from tirgeo_ros.tools.cli._verb import PAGE, PARAMS, WORD, UsageError, check_page

_NAMESPACE = "namespace of the aircraft, as uav1; default: none"
_NAMES = re.compile(r"(/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*)?/?", re.ASCII)
OPTIONS = (
    ("--bag", "IN", "flight to play instead of a live aircraft; the graph ends with it"),
    ("--map", "MAP", "the map to draw; default: the map of --params"),
    *PARAMS,
    ("--namespace", "NS", _NAMESPACE, WORD | {"default": ""}),
    *PAGE,
    ("--remap", "YAML", "file of the inputs that have other names, as config/mavros.yaml"),
    ("--no-dji", None, "without dji_node: other drivers publish the aircraft's topics"),
)


def run(args: argparse.Namespace) -> NoReturn:
    """Print the names of the nodes, and become the process that runs them."""
    from tirgeo_ros.tools.graph.whole_graph import WholeGraph  # noqa: PLC0415 heavy

    if not _NAMES.fullmatch(args.namespace):
        raise UsageError(f"--namespace {args.namespace}: use letters, digits, _ and /, as uav1")
    check_page(args)
    inputs = args.bag, args.map, args.params or (), args.namespace
    page = {"page": args.page, "cot": args.cot}
    graph = WholeGraph(*inputs, dji=not args.no_dji, **page, remap=args.remap)
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if args.json:
        print(json.dumps({"nodes": graph.nodes, "ros_domain_id": domain}), flush=True)
    else:
        nodes = ", ".join(graph.nodes)
        sys.stderr.write(f"{nodes} with ROS_DOMAIN_ID={domain}; Ctrl-C ends them\n")
        sys.stderr.flush()
    graph.run()
