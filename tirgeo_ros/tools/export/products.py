"""List the products of ``tirgeo export``, and how each is made."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.tools.export import RASTERS
from tirgeo_ros.tools.export.export_frame import Product
from tirgeo_ros.tools.export.orthophotos import Mosaic, Orthophotos
from tirgeo_ros.tools.export.raster_options import RasterSetup
from tirgeo_ros.tools.export.stills import Stills
from tirgeo_ros.tools.export.subtitles import Subtitles
from tirgeo_ros.tools.export.vectors import Vectors


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
