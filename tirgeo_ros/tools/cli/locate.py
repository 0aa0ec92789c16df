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
r"""Locate pixels of a flight's pictures on the ground.

Writes each point with its 95 % ellipse. A pixel is named by its picture's stamp, column and row.
If it cannot be located, the reason is written. ce and le of Cursor-on-Target are CE90 and LE90.

example:
  tirgeo locate bags/sample/flight.mcap --pixels bags/sample/observations.csv -o points.geojson \
    --params bags/sample/params.yaml
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import FLIGHT, NEEDED, REGISTRATION, call

_PIXELS = (
    "a head id,stamp_ns,u,v, then the pixels: the picture's header stamp, column, row; or "
    "id,picture,u,v with the names of stills"
)
_OUTPUT = (
    "file for points and ellipses: .geojson, .kml, .gpx, .csv, .gpkg, or .xml for Cursor-on-Target"
)
OPTIONS = (
    *FLIGHT,
    ("--pixels", "CSV", _PIXELS, NEEDED),
    ("-o --output", "OUT", _OUTPUT, NEEDED),
    *REGISTRATION,
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Locate the pixels; return a summary."""
    from tirgeo_ros.tools.replay.locate import locate_pixels  # noqa: PLC0415 heavy

    return call(locate_pixels, args, "locating, s")
