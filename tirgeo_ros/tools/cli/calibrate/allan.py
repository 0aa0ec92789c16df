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
"""Find the noise of the IMU from hours at rest (Allan variance).

Computes the overlapping Allan deviation of each axis of an IMU that lay still for hours, with
motors off, and from it random walk N, bias instability B (flicker floor over 0.664, and the plain
minimum), rate random walk K, and the Gauss-Markov bias that the filter models. Writes parameters
for ekf_node and a plot.

example:
  tirgeo calibrate allan still.mcap -o imu.yaml
  tirgeo process flight.mcap -o out.mcap --params imu.yaml
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import ANY_BAG, NAMESPACE, NEEDED, WINDOW, WORD, call

OPTIONS = (
    ("bag", "BAG", f"the record at rest: {ANY_BAG}"),
    ("-o --output", "YAML", "parameter file to write", NEEDED),
    ("--topic", "TOPIC", "topic of sensor_msgs/Imu (%(default)s)", WORD | {"default": "imu/data"}),
    *NAMESPACE,
    *WINDOW,
    ("--plot", "PNG", "where to write the plot (default: beside the YAML)"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Estimate the noise; return a summary."""
    from tirgeo_ros.tools.calibrate.allan import calibrate_allan  # noqa: PLC0415 heavy

    return call(calibrate_allan, args, "reading, s")


def describe(result: dict[str, Any]) -> str:
    """Return the axes as a table, and what was written."""
    from tirgeo_ros.tools.calibrate.allan import rest_table  # noqa: PLC0415 heavy

    odd = ", ".join(f"{number} {what}" for what, number in result["irregular"].items() if number)
    return (
        f"{result['samples']} samples of {result['topic']}, {result['span_s'] / 3600:.2f} h at "
        f"{result['rate_hz']:.2f} Hz, stamps to {result['jitter_ms']:.2g} ms"
        f"{'; ' if odd else ''}{odd.replace('_', ' ')}\n"
        f"{rest_table(result['axes'])}\n"
        f"written: {', '.join(result['output'])}"
    )
