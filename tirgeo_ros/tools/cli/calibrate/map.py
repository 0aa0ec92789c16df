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
r"""Make a map from features digitised on an orthophoto, by control points.

Transforms features, digitised in pixels of an orthophoto, by a polynomial that is fitted to
control points, and writes them as GeoJSON in WGS84. Pixels are counted from the top left corner;
QGIS's negative rows are converted. Prints the residuals of each point, and warns of features
outside the points' hull.

example:
  tirgeo calibrate map beds_px.geojson --points marks.csv --survey survey.geojson \
    -o map.geojson
  tirgeo calibrate map beds_px.geojson --points ortho.points -o map.geojson --order 2
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import NEEDED, WORD
from tirgeo_ros.tools.presentation.results import table

_POINTS_HELP = (
    "id,column,row with --survey, or a .points file of QGIS's georeferencer (3.26 or later)"
)
_ORDERS = {"type": int, "choices": (1, 2, 3), "default": 3}
OPTIONS = (
    ("vectors", "PIXELS.geojson", "the features, with coordinates column, row"),
    ("--points", "FILE", _POINTS_HELP, NEEDED),
    ("--survey", "GCPS", "the control points: GeoJSON points, or CSV id,lat,lon,h"),
    ("-o --output", "GEOJSON", "the map to write", NEEDED),
    ("--order", "ORDER", "order of the polynomial: %(choices)s (default: 3)", _ORDERS),
    ("--crs", "CRS", "plane of the fit (default: the UTM zone of the points)", WORD),
)
#: Columns of the residuals: title, key, format.
_COLUMNS = (
    ("point", "id", ""),
    ("column", "column", ".1f"),
    ("row", "row", ".1f"),
    ("x [m]", "x_m", ".4f"),
    ("y [m]", "y_m", ".4f"),
    ("length [m]", "length_m", ".4f"),
    ("[px]", "length_px", ".2f"),
    ("left out [m]", "left_out_m", ".4f"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Georeference the features; return a summary."""
    from tirgeo_ros.tools.calibrate.map import calibrate_map  # noqa: PLC0415 heavy

    options = {name: getattr(args, name) for name in ("survey", "order", "crs")}
    return calibrate_map(args.vectors, args.points, args.output, **options)


def describe(result: dict[str, Any]) -> str:
    """Return the residuals as a table, their means, and what was written."""
    rows = [[f"{point[key]:{form}}" for _, key, form in _COLUMNS] for point in result["residuals"]]
    means = (
        f"mean residual {result['mean_residual_px']:.2f} px, {result['mean_residual_m']:.4f} m "
        f"(rms {result['rms_residual_px']:.2f} px, {result['rms_residual_m']:.4f} m; each point "
        f"left out {result['rms_left_out_m']:.4f} m)"
    )
    lines = [
        table([[title for title, _, _ in _COLUMNS], *rows], right=True),
        means,
        f"order {result['order']} in {result['crs']}, {result['pixel_m']:.4g} m a pixel",
        f"{result['features']} features, {result['features_outside']} of them reach outside",
        f"written: {', '.join(result['output'])}",
    ]
    return "\n".join(lines)
