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
"""Simulate a flight, with truth.

Writes flight.mcap (what the aircraft recorded, with thermal video), truth.mcap, map.geojson,
survey.geojson, targets.geojson (the warm things in it), observations.csv and params.yaml. The same
seed gives the same bytes.

example:
  tirgeo simulate config/scenarios/paper_flight.yaml -o flight --start 30 --duration 30
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import NEEDED, NUMBER, UsageError, call

OPTIONS = (
    ("scenario", "SCENARIO", "YAML file"),
    ("-o --output", "DIR", "folder for the files", NEEDED),
    ("--seed", "N", "seed to use instead of the scenario's", {"type": int}),
    ("--start", "S", "write from this second on", NUMBER | {"default": 0.0}),
    ("--duration", "S", "seconds to write; default: to the end", NUMBER),
    ("--no-images", None, "no video: quick"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Fly the scenario and write it; return a summary."""
    from tirgeo_ros.tools.simulate import simulate  # noqa: PLC0415 heavy

    if args.seed is not None and args.seed < 0:
        raise UsageError("--seed must not be negative")
    part = {"start_s": args.start, "duration_s": args.duration, "images": not args.no_images}
    places = {"scenario_path": args.scenario, "out_dir": args.output}
    return call(simulate, args, "simulating, s", **places, **part)
