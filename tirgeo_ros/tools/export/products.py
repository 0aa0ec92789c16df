"""List the products of ``tirgeo export``, and how each is made."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.tools.export import RASTERS
from tirgeo_ros.tools.export.export_frame import Product
from tirgeo_ros.tools.export.orthophotos import Mosaic, Orthophotos
from tirgeo_ros.tools.export.raster_options import RasterSetup


@dataclass(frozen=True)
class Job:
    """Hold what the products need besides the frames."""

    folder: Path
    rasters: RasterSetup | None  # None if no product of RASTERS is wanted


def _rasters(job: Job) -> RasterSetup:
    assert job.rasters is not None
    return job.rasters


#: By name in PRODUCTS; a product makes its files in ``folder``.
_MAKERS: Mapping[str, Callable[[Job], Product]] = {
    "ortho": lambda job: Orthophotos(job.folder / "ortho", _rasters(job)),
    "mosaic": lambda job: Mosaic(job.folder, _rasters(job)),
}
#: Files of the products directly in ``folder``.
FILES = ("mosaic.tif", "mosaic.kml", "mosaic.png", "summary.json")


def products(names: Collection[str], job: Job) -> dict[str, Product]:
    """Return the named products, ready to take frames."""
    return {name: make(job) for name, make in _MAKERS.items() if name in names}


def needs_ground(names: Collection[str]) -> bool:
    """Return whether one of the named products lies on the ground."""
    return any(name in RASTERS for name in names)
