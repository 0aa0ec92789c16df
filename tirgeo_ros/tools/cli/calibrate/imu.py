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
"""Measure the noise of the IMU in flight, and its vibration.

Measures the white noise of gyroscopes and accelerometers in a flight above 8 Hz, between the
spectral lines of vibration; the second differences, by which the filter adapts its noise; and the
strongest lines. Writes the noise of the flight's calmest tenth, but not less than that of
--params, as parameters for ekf_node, and a plot. Without -o it only prints them.

example:
  tirgeo calibrate imu flight.mcap -o imu.yaml
  tirgeo process flight.mcap -o out.mcap --params aircraft.yaml --params imu.yaml
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import BAG, NAMESPACE, PARAMS, WINDOW, call

OPTIONS = (
    *BAG,
    ("-o --output", "YAML", "parameter file to write (default: show only)"),
    *PARAMS,
    *NAMESPACE,
    *WINDOW,
    ("--plot", "PNG", "where to write the plot (default: beside the YAML)"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Measure the noise; return a summary."""
    from tirgeo_ros.tools.calibrate.imu import calibrate_imu  # noqa: PLC0415 heavy

    return call(calibrate_imu, args, "reading, s")


def describe(result: dict[str, Any]) -> str:
    """Return the axes as a table, and what was written."""
    from tirgeo_ros.tools.calibrate.imu import flight_table  # noqa: PLC0415 heavy

    rest = f", {result['resting_s']} s at rest left out" if result["resting_s"] else ""
    return (
        f"{result['samples']} samples of {result['topic']} at {result['rate_hz']:.2f} Hz: "
        f"{result['flying_s']} s in flight{rest}\n"
        f"{flight_table(result['axes'])}\n"
        f"written: {', '.join(result['output']) or 'nothing; -o writes it'}"
    )
