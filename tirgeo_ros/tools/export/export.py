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
"""Make products of a recorded flight: the work of ``tirgeo export``.

The flight is registered first, as in every command. Then the pictures with a trusted pose are
read, in order, and each is passed to all products.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Protocol

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, made_folder, write_files
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.export import PRODUCTS, RASTERS
from tirgeo_ros.tools.export.frames import ExportFrame, RegisteredFlight, frames, register
from tirgeo_ros.tools.export.rasters import Mosaic, Orthophotos, RasterOptions, raster_setup
from tirgeo_ros.tools.export.stills import Stills
from tirgeo_ros.tools.export.subtitles import Subtitles
from tirgeo_ros.tools.export.vectors import Vectors
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures, Window
from tirgeo_ros.tools.replay.node_configs import open_flight

#: Files of the products directly in the folder.
FILES = ("mosaic.tif", "flight.gpkg", "flight.srt", "summary.json")
_REGISTRATION = 20.0  # per cent of the work


class Product(Protocol):
    """Define a product of a flight: it takes the frames in order, then writes its files."""

    def take(self, frame: ExportFrame) -> None:
        """Take the next frame."""

    def finish(self) -> dict[str, object]:
        """Write the remaining files; return the product's entry in the summary."""


def export(
    bag: PathLike,
    output: PathLike,
    *,
    params: Files = None,
    namespace: str = "",
    method: str | None = None,
    camera: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    only: Collection[str] = (),
    smooth: bool = False,
    adjust: bool = False,
    window: Window | None = None,
    targets: PathLike | None = None,
    rasters: RasterOptions | None = None,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> dict[str, object]:
    """Write the products of a bag into a folder; return a summary, also as ``summary.json``.

    ``only`` names products: all by default. ``smooth``: poses from all measurements, also later
    ones; ``adjust``: what pictures show twice corrects them. ``targets`` is a file of targets for
    the layers. Pictures that cannot be used are counted by reason. Raise BagError, CameraError,
    ConfigError, ElevationError, ExportError, MapError, TargetError.
    """
    wanted, window = only or PRODUCTS, window or Window()
    places = [Path(output) / name for name in FILES]
    options = {"method": method, "dem": dem, "ground_height": ground_height, "camera": camera}
    arguments = bag, places, params, namespace, options
    opened = open_flight(
        *arguments, inputs=[targets], error=MapError, logs=logs, progress=progress
    )
    if not {*RASTERS}.isdisjoint(wanted):
        needed("rasterio", "writing orthophotos and mosaics", MapError)
    pictures = FlightPictures(opened.reader, namespace)
    chosen = pictures.chosen(window)
    flight = register(
        opened, chosen, _part(progress, 0.0, _REGISTRATION), smooth=smooth, adjust=adjust
    )
    products, lattice = _rasters(flight, rasters or RasterOptions(), Path(output), wanted)
    dji = ParameterFile(opened.params).config("dji_node", DjiConfig, namespace)
    if "stills" in wanted:
        products["stills"] = Stills(Path(output) / "stills", dji.geoid_undulation_m)
    if "vectors" in wanted:
        sources = targets, opened.configs.overlay.confidence, flight.states.get
        products["vectors"] = Vectors(places[1], window.every_s, *sources)
    if "subtitles" in wanted:
        times = pictures.stamps_ns, window.every_s
        products["subtitles"] = Subtitles(places[2], *times, dji.geoid_undulation_m)
    for frame in frames(pictures, flight, _part(progress, _REGISTRATION, 100.0)):
        for product in products.values():
            product.take(frame)
    written = lattice | {name: product.finish() for name, product in products.items()}
    result = _summary(flight, opened.reader, os.fspath(output), len(chosen), written)
    write_files({places[-1]: json.dumps(result, indent=1) + "\n"}, MapError)
    return result


def _rasters(
    flight: RegisteredFlight, options: RasterOptions, folder: Path, wanted: Collection[str]
) -> tuple[dict[str, Product], dict[str, object]]:
    """Make the folder; return the wanted RASTERS and their lattice. Raise ConfigError."""
    products: dict[str, Product] = {}
    if {*RASTERS}.isdisjoint(wanted):
        made_folder(folder, MapError)
        return products, {}
    if flight.ground is None:
        raise ConfigError("height of the ground not known: give --ground-height or --dem")
    poses = [posed.pose for posed in flight.posed.values()]
    setup = raster_setup(options, flight.camera, poses, flight.plane, flight.ground)
    made_folder(folder, MapError)
    if "ortho" in wanted:
        products["ortho"] = Orthophotos(folder / "ortho", setup)
    if "mosaic" in wanted:
        products["mosaic"] = Mosaic(folder, setup)
    lattice = {"crs": setup.projected.name, "gsd_m": setup.tiles.pixel_m}
    return products, lattice | {"grazing_deg": options.grazing_deg}


def _summary(
    flight: RegisteredFlight,
    reader: BagReader,
    folder: str,
    pictures: int,
    written: Mapping[str, object],
) -> dict[str, object]:
    """Return the summary: pictures and what became of them, what was written, and any error."""
    used = pictures - flight.refused.total()
    error = flight.no_go
    if reader.damage is not None:
        error = f"{reader.path}: {reader.damage}; the products come from the rest"
    elif not used:
        error = f"{reader.path}: none of its pictures could be used"
    return {
        "input": os.fspath(reader.path),
        "output": folder,
        "pictures": pictures,
        "used": used,
        "not_used": dict(flight.refused),
        **flight.summary,
        **written,
        "error": error,
    }


def _part(progress: Report, begin: float, end: float) -> Report:
    """Return the callback for a part of the work, in per cent of the whole."""
    return lambda done, total: progress(begin + (end - begin) * done / (total or 1.0), 100.0)
