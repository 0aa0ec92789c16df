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
r"""Make products of a flight for GIS, photogrammetry and players.

Registers the flight and rectifies its pictures to the ground: each as an orthophoto (ortho), and
all as one mosaic with the best view on top. Both are Cloud-Optimised GeoTIFFs. stills have
position and angles in EXIF and XMP; vectors are footprints, track and targets in one GeoPackage;
subtitles (SRT) have the camera's position. Pictures without a trusted pose are only counted.

example:
  tirgeo export bags/sample/flight.mcap -o products --params bags/sample/params.yaml
  tirgeo export bags/sample/flight.mcap -o mosaic --params bags/sample/params.yaml \
    --only mosaic --every 0.5 --gsd 0.1 --crs EPSG:32650
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import (
    FLIGHT,
    NEEDED,
    NUMBER,
    REGISTRATION,
    WINDOW,
    WORD,
    UsageError,
    call,
    names_of,
)
from tirgeo_ros.tools.export import PRODUCTS

_ONLY = {"type": names_of(PRODUCTS)}
_EVERY = "use at most one picture in each interval of S seconds; 0: all (default: %(default)g)"
_DEGREES = "degrees Celsius = 16-bit value x SCALE + OFFSET, as 0.04 -273.15; default: values stay"
_GRAZING = "leave out ground that is seen at a smaller angle (default: %(default)g)"
_TARGETS = "targets for flight.gpkg, from a GeoPackage of the page or of tirgeo locate"
OPTIONS = (
    *FLIGHT,
    ("-o --output", "DIR", "folder for the products; replaces an earlier run's", NEEDED),
    *REGISTRATION,
    *WINDOW,
    ("--every", "S", _EVERY, NUMBER | {"default": 1.0}),
    ("--only", "NAMES", f"products to make, of {', '.join(PRODUCTS)}; default: all", _ONLY),
    ("--targets", "FILE", _TARGETS),
    ("--crs", "CRS", "projected system of the rasters; default: the UTM zone of the place", WORD),
    ("--gsd", "M", "pixel size of the rasters; default: by that of the pictures", NUMBER),
    ("--grazing", "DEG", _GRAZING, NUMBER | {"default": 15.0}),
    ("--nearest", None, "keep the video's own values: no means, and no feathering in the mosaic"),
    ("--degrees", ("SCALE", "OFFSET"), _DEGREES, NUMBER | {"nargs": 2}),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Make the products; return a summary."""
    from tirgeo_ros.tools.export.export import export  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.export.rasters import RasterOptions  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.replay.flight_pictures import Window  # noqa: PLC0415 heavy

    if args.degrees and not args.degrees[0]:
        raise UsageError("--degrees: SCALE must not be 0")
    if args.gsd is not None and not args.gsd > 0:
        raise UsageError("--gsd must be more than 0")
    if not 0 < args.grazing < 90:
        raise UsageError("--grazing must be between 0 and 90")
    if not args.every >= 0:
        raise UsageError("--every must be 0 or more")
    degrees = tuple(args.degrees) if args.degrees else None
    rasters = RasterOptions(args.crs, args.gsd, args.grazing, args.nearest, degrees)
    window = Window(args.from_s, args.to_s, args.every)
    return call(export, args, "exporting, %", window=window, rasters=rasters)
