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
"""Measure how still a gimbal holds its camera, from a video of a fixed checkerboard.

Finds the camera's roll, pitch and yaw against a fixed checkerboard in every picture of a video
that was taken while the aircraft was turned about, and their standard deviations. Roll and pitch
show the gimbal's stability; yaw follows the aircraft.

example:
  tirgeo calibrate gimbal wall.mcap --board 9x6 --square 0.1 --camera camera.yaml -o attitude.csv
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tirgeo_ros.tools.cli._verb import BOARD, NUMBER, UsageError, call
from tirgeo_ros.tools.presentation.results import not_used

_RATE_HELP = (
    "pictures a second: how many of a bag are used, or the rate of the files (default %(default)g)"
)
OPTIONS = (
    *BOARD,
    ("--camera", "YAML", "calibration file (default: the bag's own)"),
    ("--rate", "HZ", _RATE_HELP, NUMBER | {"default": 10.0, "dest": "rate_hz"}),
    ("-o --output", "CSV", "file for the angles over time"),
)
_COLUMNS = {
    "std_deg": "std",
    "noise_deg": "of noise",
    "std_without_noise_deg": "without",
}


def run(args: argparse.Namespace) -> dict[str, object]:
    """Measure the attitudes; return a summary."""
    if not args.rate_hz > 0:
        raise UsageError("--rate must be positive")
    from tirgeo_ros.core.calibration.checkerboard import board_of  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.calibrate.gimbal import calibrate_gimbal  # noqa: PLC0415 heavy

    pictures = {"inputs": args.pictures, "board": board_of(args.board, args.square)}
    return call(calibrate_gimbal, args, "looking for the board", **pictures)


def describe(result: Mapping[str, Any]) -> str:
    """Return the standard deviations as a table, and how many pictures were not used."""
    lines = ["deg   " + "".join(f"{name:>12}" for name in _COLUMNS.values())]
    lines += [
        f"{axis:6}" + "".join(f"{result[name][axis]:12.4f}" for name in _COLUMNS)
        for axis in ("pitch", "yaw", "roll")
    ]
    lines.append(
        f"{result['used']} of {result['pictures']} pictures used, over "
        f"{result['duration_s']:.1f} s; reprojection error {result['reprojection_rms_px']:.3f} px"
    )
    lines += not_used(result["refused"])
    lines += [f"written: {path}" for path in result["output"]]
    return "\n".join(lines)
