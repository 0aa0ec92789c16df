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
"""Calibrate a lens from pictures of a thermal checkerboard.

Finds focal lengths, principal point and distortion from pictures of a checkerboard: foil on the
dark squares shows it to a thermal camera. Writes a calibration file as ROS's camera_calibration
does. Pictures that would spoil the result are refused, each with its reason.

example:
  tirgeo calibrate lens pictures/ --board 9x6 --square 0.1 -o camera.yaml --plot coverage.png
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tirgeo_ros.tools.cli._verb import BOARD, NEEDED, call
from tirgeo_ros.tools.presentation.results import not_used

OPTIONS = (
    *BOARD,
    ("-o --output", "YAML", "calibration file to write", NEEDED),
    ("--plot", "PNG", "plot of corners and errors"),
    ("--k3", None, "estimate k3 too, not only k1 k2 p1 p2"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    from tirgeo_ros.core.calibration.checkerboard import board_of  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.calibrate.lens import calibrate_lens  # noqa: PLC0415 heavy

    pictures = {"inputs": args.pictures, "board": board_of(args.board, args.square)}
    return call(calibrate_lens, args, "looking for the board", **pictures)


def describe(result: Mapping[str, Any]) -> str:
    """Return the parameters with their standard deviations, and how many views were not used."""
    lines = [
        f"{name:<3}{value:14.6g} +- {result['sigma'][name]:.2g}"
        for name, value in result["parameters"].items()
    ]
    lines += [
        f"reprojection error {result['reprojection_rms_px']:.3f} px rms",
        (
            f"{result['views']} of {result['pictures']} pictures used; they cover "
            f"{100 * result['covered_share']:.0f} % of the frame, tilted up to "
            f"{result['tilt_deg']:.0f} deg"
        ),
        *not_used(result["refused"]),
        *(f"written: {path}" for path in result["output"]),
    ]
    return "\n".join(lines)
