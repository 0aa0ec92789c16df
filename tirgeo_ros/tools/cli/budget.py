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
"""Compute the ground errors that errors of the pose cause.

Computes the error budget over the picture: root mean square errors on level ground for each
factor, by the closed form of Ren et al. 2022 (section 3.5, a pinhole camera) and by the full
covariance of the pose, with the lens. Defaults of errors, view and camera are those of the paper.

example:
  tirgeo budget --height 60 --tilt 45 -o budget
  tirgeo budget --params bags/sample/params.yaml
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import NUMBER, PARAMETERS

#: Option, metavar, help text, name of the value.
_VALUES = (
    ("--height", "M", "height of the camera above the ground", "height_m"),
    ("--tilt", "DEG", "angle of the optical axis below the horizon", "depression_deg"),
    ("--speed", "M_S", "speed over ground, for errors of time", "speed_m_s"),
    ("--east-error", "M", "error of the camera's position", "east_error_m"),
    ("--north-error", "M", "error of the camera's position", "north_error_m"),
    ("--height-error", "M", "error of the camera's position", "height_error_m"),
    ("--heading-error", "DEG", "error of the camera's attitude", "heading_error_deg"),
    ("--roll-error", "DEG", "error of the camera's attitude", "roll_error_deg"),
    ("--pitch-error", "DEG", "error of the camera's attitude", "pitch_error_deg"),
)
OPTIONS = (
    ("-o --output", "DIR", "folder for CSV and maps (PNG)"),
    *PARAMETERS,
    *((*option, NUMBER | {"dest": name}) for *option, name in _VALUES),
)
_WIDE = 1e6  # m: larger values do not fit into the columns with three decimals
_COLUMNS = ("middle", "mean", "median", "percentile 95", "largest")


def run(args: argparse.Namespace) -> dict[str, object]:
    """Compute the budget; return it as plain values."""
    from tirgeo_ros.tools.budget.budget import make_budget  # noqa: PLC0415 heavy

    options = {name: getattr(args, name) for *_, name in _VALUES}
    values = {name: value for name, value in options.items() if value is not None}
    files = {name: getattr(args, name) for name in ("output", "params", "camera", "namespace")}
    return make_budget(values, **files)


def describe(result: dict[str, Any]) -> str:
    """Return the tables for a person."""
    view = f"{result['height_m']:.4g} m above the ground, {result['depression_deg']:.4g} deg down"
    parts = [f"camera {view}"]
    parts.append(f"errors on the ground, m\n{_table(result['rows'])}")
    sky = 1 - result["ground_share"]
    if sky > 0:
        parts.append(
            f"{sky:.0%} of the picture lies above the horizon and is left out; just below "
            "the horizon errors grow without bound: use the median"
        )
    if "output" in result:
        parts.append("\n".join(result["output"]))
    return "\n\n".join(parts)


def _table(rows: list[dict[str, Any]]) -> str:
    lines = [f"{'factor':<16}{'form':<9}" + "".join(f"{name:>14}" for name in _COLUMNS)]
    for row in rows:
        values = [row[f"{name.replace(' ', '_')}_m"] for name in _COLUMNS]
        cells = ["-" if v is None else f"{v:.3f}" if v < _WIDE else f"{v:.4g}" for v in values]
        columns = "".join(f"{cell:>14}" for cell in cells)
        lines.append(f"{row['factor']:<16}{row['form']:<9}{columns}")
    return "\n".join(lines)
