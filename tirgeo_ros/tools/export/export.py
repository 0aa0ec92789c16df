"""Make products of a recorded flight: the work of ``tirgeo export``.

The flight is registered first, as every command does it. Then the pictures with a trusted pose
are read, in order, and each is given to all products.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterator
from pathlib import Path

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import ConfigError, MapError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.bounded_reading import imported_rasterio
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, paths_of
from tirgeo_ros.tools.export import PRODUCTS
from tirgeo_ros.tools.export.export_frame import ExportFrame
from tirgeo_ros.tools.export.flight_pictures import FlightPictures, Window
from tirgeo_ros.tools.export.products import FILES, Job, needs_ground, products
from tirgeo_ros.tools.export.raster_options import RasterOptions, RasterSetup, raster_setup
from tirgeo_ros.tools.export.registered_flight import RegisteredFlight, register
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

_FIRST = 20.0  # per cent of the work: the registration


def export(
    bag_in: PathLike,
    folder: PathLike,
    *,
    params: Files = None,
    namespace: str = "",
    method: str | None = None,
    camera: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    only: Collection[str] = (),
    smooth: bool = False,
    window: Window | None = None,
    targets: PathLike | None = None,
    rasters: RasterOptions | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Write the products of a bag into a folder; return a summary, also as ``summary.json``.

    ``only`` names products: all by default. ``smooth``: poses from all measurements, also later
    ones. ``targets`` is a file of targets for the layers. Pictures that cannot be used are
    counted with the reason. Raise BagError, CameraError, ConfigError, ElevationError,
    ExportError, MapError, TargetError.
    """
    wanted = only or PRODUCTS
    configs = node_configs(
        params, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
    )
    places = [Path(folder) / name for name in FILES]
    check_outputs((bag_in, targets, *paths_of(params), *configs.files), places, MapError)
    if needs_ground(wanted):
        imported_rasterio("orthophotos and mosaics need", MapError)
    reader = BagReader(bag_in)
    pictures = FlightPictures(reader, namespace)
    chosen = pictures.chosen(window or Window())
    of_flight = (reader, configs, params, namespace)
    flight = register(*of_flight, chosen, _first(progress), smooth=smooth)
    setup = _setup(flight, rasters or RasterOptions()) if needs_ground(wanted) else None
    dji = ParameterFile(params).config("dji_node", DjiConfig, namespace)
    job = Job(
        made_folder(folder, MapError),
        setup,
        stamps_ns=pictures.stamps_ns,
        every_s=window.every_s if window else 0.0,
        state_at=flight.states.get,
        confidence=configs.overlay.confidence,
        undulation_m=dji.geoid_undulation_m,
        targets=targets,
    )
    with products(wanted, job) as made:
        for frame in frames(pictures, flight, progress):
            for product in made.values():
                product.take(frame)
        finished = {name: product.finish() for name, product in made.items()}
    used = len(chosen) - flight.refused.total()
    result = {
        "input": os.fspath(bag_in),
        "output": os.fspath(folder),
        "pictures": len(chosen),
        "used": used,
        "not_used": dict(flight.refused),
        **flight.summary,
        **_described(setup),
        **finished,
        "error": _error(reader, used) or flight.no_go,
    }
    write_files({places[-1]: json.dumps(result, indent=1) + "\n"}, MapError)
    return result


def _first(progress: Report) -> Report:
    """Return the callback for the registration, which is the first part of the work."""
    return lambda done, total: progress(_FIRST * done / (total or 1.0), 100.0)


def _setup(flight: RegisteredFlight, options: RasterOptions) -> RasterSetup:
    """Return the lattice of the rasters; raise ConfigError where the ground is not known."""
    if flight.ground is None:
        raise ConfigError("height of the ground not known: give --ground-height or --dem")
    poses = [one.pose for one in flight.posed.values()]
    return raster_setup(options, flight.camera, poses, flight.plane, flight.ground)


def frames(
    pictures: FlightPictures, flight: RegisteredFlight, progress: Report
) -> Iterator[ExportFrame]:
    """Yield the pictures that have a pose, in order; count those that cannot be read."""
    kind = None
    for done, (number, pixels) in enumerate(pictures.read(flight.posed)):
        progress(_FIRST + (100 - _FIRST) * done / len(flight.posed), 100.0)
        if isinstance(pixels, TirgeoError):
            flight.refused["damaged"] += 1
            continue
        kind = kind or (pixels.dtype, pixels.ndim)
        if pixels.shape[:2] != (flight.camera.height, flight.camera.width):
            flight.refused["of another size than the camera's calibration"] += 1
        elif (pixels.dtype, pixels.ndim) != kind:
            flight.refused["of another kind than the first picture"] += 1
        else:
            stamp_ns, pose, body = flight.posed[number]
            place = flight.camera, pose, body, flight.plane, flight.ground
            yield ExportFrame(number, stamp_ns, pixels, *place)


def _error(reader: BagReader, used: int) -> str | None:
    """Return what makes the run a failure although there is a summary, or None."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the products come from the rest"
    return None if used else f"{reader.path}: none of its pictures could be used"


def _described(setup: RasterSetup | None) -> dict[str, object]:
    """Return the lattice of the rasters for the summary; nothing without rasters."""
    if setup is None:
        return {}
    options = setup.options
    return {
        "crs": setup.projected.name,
        "gsd_m": setup.tiles.pixel_m,
        "grazing_deg": options.grazing_deg,
    }
