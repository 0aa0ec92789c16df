"""Set up the rasters of a run: one lattice for the frames' orthophotos and their mosaic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.orthorectification.ground_tiles import GroundTiles
from tirgeo_ros.core.orthorectification.orthophoto import FrameView, level_gsd_m, seeds
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.tools.export.export_frame import ExportFrame

#: Ground that is seen flatter than this is left out: there, 1 m of height moves it by 3.7 m.
GRAZING_DEG = 15.0
#: Sizes of pixels, times a power of ten.
_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
_LOOKED_AT = 200  # pictures from which the pixel size is derived, spread over the flight


@dataclass(frozen=True)
class RasterOptions:
    """Hold what the user may set for rasters."""

    crs: str | None = None  # None: the UTM zone of the place
    gsd_m: float | None = None  # size of a pixel; None: by the pictures' own
    grazing_deg: float = GRAZING_DEG
    nearest: bool = False  # values of the video as they are: no means, no feathering
    even: bool = False  # match the grey levels of the mosaic's pictures to each other
    #: Degrees Celsius are 16-bit values times the first plus the second; None: as they are.
    degrees: tuple[float, float] | None = None


@dataclass(frozen=True)
class RasterSetup:
    """Hold the lattice of all rasters of a run, and the options."""

    projected: Plane
    tiles: GroundTiles
    options: RasterOptions

    def view(self, frame: ExportFrame) -> FrameView:
        """Return a frame as seen from the lattice; raise MapError for degrees of 8 bits."""
        options = self.options
        if options.degrees is not None and frame.pixels.dtype != np.uint16:
            raise MapError(
                "--degrees is for 16-bit video; the pictures of this flight have 8 bits"
            )
        grazing_rad = math.radians(options.grazing_deg)
        place = self.tiles, frame.camera, frame.pose
        return FrameView(*place, frame.pixels, grazing_rad, nearest=options.nearest)


def raster_setup(
    options: RasterOptions,
    camera: Camera,
    poses: Sequence[CameraPose],
    plane: TangentPlane,
    ground: Ground,
) -> RasterSetup:
    """Return the setup for a flight with these poses of its pictures, at least one.

    Raise MapError for an unsuitable ``crs``, and where no picture sees ground.
    """
    some = poses[:: math.ceil(len(poses) / _LOOKED_AT)]
    latitude, longitude, _ = plane.geodetic_from_ned(np.array([one.position_n for one in some]))
    projected = Plane(options.crs, np.degrees(np.stack([longitude, latitude], axis=1)))
    pixel_m = options.gsd_m
    if pixel_m is None:
        pixel_m = _rounded(_median_gsd_m(options, camera, some, plane, ground))
    return RasterSetup(projected, GroundTiles(projected, pixel_m, plane, ground), options)


def _median_gsd_m(
    options: RasterOptions,
    camera: Camera,
    poses: Sequence[CameraPose],
    plane: TangentPlane,
    ground: Ground,
) -> float:
    """Return the median ground sample distance, m, over the pictures."""
    grazing_rad = math.radians(options.grazing_deg)
    gsd_m = np.concatenate(
        [
            level_gsd_m(camera, pose, plane, seeds(camera, pose, plane, ground), grazing_rad)
            for pose in poses
        ]
    )
    known = gsd_m[np.isfinite(gsd_m)]
    if not known.size:
        raise MapError(
            f"no picture sees the ground at {options.grazing_deg:g} deg or steeper: is its height "
            "right? (--ground-height, --dem, --grazing)"
        )
    return float(np.median(known))


def _rounded(length_m: float) -> float:
    """Return the longest of _STEPS times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(length_m))
    step = max(step for step in _STEPS if step * power <= length_m * (1 + 1e-9))
    return float(f"{step * power:.6g}")
