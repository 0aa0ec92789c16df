"""Make products of a recorded flight: the work of ``tirgeo export``.

The flight is registered first, as every command does it. Then the pictures with a trusted pose
are read, in order, and each is given to all products.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.bounded_reading import imported_rasterio
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, paths_of
from tirgeo_ros.tools.export import PRODUCTS, RASTERS
from tirgeo_ros.tools.export.frames import (
    ExportFrame,
    FlightPictures,
    RegisteredFlight,
    Window,
    frames,
    register,
)
from tirgeo_ros.tools.export.orthophotos import Mosaic, Orthophotos
from tirgeo_ros.tools.export.rasters import RasterOptions, RasterSetup, raster_setup
from tirgeo_ros.tools.export.stills import Stills
from tirgeo_ros.tools.export.subtitles import Subtitles
from tirgeo_ros.tools.export.vectors import Vectors
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

_FIRST = 20.0  # per cent of the work: the registration


class Product(Protocol):
    """Define a product of a flight: it takes the frames in order, then writes its files."""

    def take(self, frame: ExportFrame) -> None:
        """Take the next frame."""

    def finish(self) -> dict[str, object]:
        """Write what is left; return what was made, for the summary."""

    def close(self) -> None:
        """Remove what is not finished."""


@dataclass(frozen=True)
class Job:
    """Hold what the products need besides the frames."""

    folder: Path
    rasters: RasterSetup | None  # None if no product of RASTERS is wanted
    stamps_ns: Sequence[int]  # of all pictures of the bag
    every_s: float  # between the pictures that are given
    state_at: Callable[[int], str | None]  # the filter's, at an exposure (ns)
    confidence: ConfidenceConfig
    undulation_m: float  # of the geoid; nan if it is not known
    targets: PathLike | None = None


def _rasters(job: Job) -> RasterSetup:
    assert job.rasters is not None
    return job.rasters


#: By name in PRODUCTS; a product makes its files in ``folder``.
_MAKERS: Mapping[str, Callable[[Job], Product]] = {
    "ortho": lambda job: Orthophotos(job.folder / "ortho", _rasters(job)),
    "mosaic": lambda job: Mosaic(job.folder, _rasters(job)),
    "stills": lambda job: Stills(job.folder / "stills", undulation_m=job.undulation_m),
    "vectors": lambda job: Vectors(
        job.folder / "flight.gpkg",
        every_s=job.every_s,
        targets=job.targets,
        confidence=job.confidence,
        state_at=job.state_at,
    ),
    "subtitles": lambda job: Subtitles(
        job.folder / "flight.srt",
        stamps_ns=job.stamps_ns,
        every_s=job.every_s,
        undulation_m=job.undulation_m,
    ),
}
#: Files of the products directly in ``folder``.
FILES = ("mosaic.tif", "mosaic.kml", "mosaic.png", "flight.gpkg", "flight.srt", "summary.json")


@contextmanager
def products(names: Collection[str], job: Job) -> Iterator[dict[str, Product]]:
    """Yield the named products, ready to take frames; what is not finished then is removed."""
    with ExitStack() as stack:
        made: dict[str, Product] = {}
        for name in [name for name in _MAKERS if name in names]:
            made[name] = _MAKERS[name](job)
            stack.callback(made[name].close)
        yield made


def needs_ground(names: Collection[str]) -> bool:
    """Return whether one of the named products lies on the ground."""
    return any(name in RASTERS for name in names)


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
    flight = register(*of_flight, chosen, _part(progress, 0.0, _FIRST), smooth=smooth)
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
        for frame in frames(pictures, flight, _part(progress, _FIRST, 100.0)):
            for product in made.values():
                product.take(frame)
        finished = {name: product.finish() for name, product in made.items()}
    written = _described(setup) | finished
    result = _result(flight, reader, os.fspath(folder), len(chosen), written)
    write_files({places[-1]: json.dumps(result, indent=1) + "\n"}, MapError)
    return result


def _result(
    flight: RegisteredFlight,
    reader: BagReader,
    folder: str,
    pictures: int,
    written: Mapping[str, object],
) -> dict[str, object]:
    """Return the summary: pictures and what became of them, what was written, and any error."""
    used = pictures - flight.refused.total()
    return {
        "input": os.fspath(reader.path),
        "output": folder,
        "pictures": pictures,
        "used": used,
        "not_used": dict(flight.refused),
        **flight.summary,
        **written,
        "error": _error(reader, used) or flight.no_go,
    }


def _part(progress: Report, begin: float, end: float) -> Report:
    """Return the callback for a part of the work, in per cent of the whole."""
    return lambda done, total: progress(begin + (end - begin) * done / (total or 1.0), 100.0)


def _setup(flight: RegisteredFlight, options: RasterOptions) -> RasterSetup:
    """Return the lattice of the rasters; raise ConfigError where the ground is not known."""
    if flight.ground is None:
        raise ConfigError("height of the ground not known: give --ground-height or --dem")
    poses = [one.pose for one in flight.posed.values()]
    return raster_setup(options, flight.camera, poses, flight.plane, flight.ground)


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
