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
r"""Find antennas, delays and the IMU's level from an ordinary flight.

Finds from a flight with turns, without any point on the ground, where the RTK antenna is, where
the two antennas point, and how late positions, velocities and headings are against the IMU; with
--level also how the IMU is tilted against the autopilot. If the flight does not determine a
parameter, the result names it, and what to fly for it. Several flights also tell the biases of
the IMU that the next flight begins with. Give the file to --params and to the nodes after the
aircraft's own file.

example:
  tirgeo calibrate aircraft flight.mcap --params aircraft.yaml -o found.yaml
  tirgeo process flight.mcap -o out.mcap --params aircraft.yaml --params found.yaml
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import BAG, NAMESPACE, PARAMS, call, names_of

_DELAYS = ("position_delay", "velocity_delay", "heading_delay")
_NAMES = ("antenna", "baseline", *_DELAYS, "rtk")
_HOLD_HELP = (
    f"values to keep, of {', '.join(_NAMES)}, separated by commas. Only differences of delays can "
    "be found: by default the IMU's delay is kept; rtk keeps the delay of positions and finds the "
    "IMU's delay"
)
_MORE_HELP = (
    "other flights of the aircraft: their IMU's biases and the first flight's make the mean and "
    "the sigma that the next flight begins with; the other values come from the first flight"
)
_LEVEL_HELP = (
    "find roll and pitch of the IMU's mounting (aircraft.imu_rpy_deg) too, against the "
    "autopilot's attitude, whose own error of level goes into them; calibrate the boresight again "
    "afterwards"
)
OPTIONS = (
    *BAG,
    ("more", "BAG", _MORE_HELP, {"nargs": "*"}),
    ("-o --output", "YAML", "parameter file to write (default: show only)"),
    *PARAMS,
    *NAMESPACE,
    ("--hold", "NAMES", _HOLD_HELP, {"type": names_of(_NAMES), "default": []}),
    ("--level", None, _LEVEL_HELP),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    from tirgeo_ros.tools.calibrate.aircraft import calibrate_aircraft  # noqa: PLC0415 heavy

    return call(calibrate_aircraft, args, "calibrating, runs")


def describe(result: dict[str, Any]) -> str:
    """Return the estimates as a table, what was not determined, and the innovations' size."""
    from tirgeo_ros.tools.calibrate.aircraft import aircraft_lines  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.calibrate.result import described  # noqa: PLC0415 heavy

    return described(aircraft_lines(result), result)
