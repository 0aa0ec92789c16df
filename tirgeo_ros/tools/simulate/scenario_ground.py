"""Define the visible part of a scenario: site, park, warm targets, video, survey."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.config.schema import param
from tirgeo_ros.core.frames.tangent_plane import TangentPlane


@dataclass(frozen=True, slots=True)
class SiteScenario:
    """Hold the site: the origin of the plane in which the truth is given."""

    latitude_deg: float = param(39.85, "latitude", ("deg", -89, 89))
    longitude_deg: float = param(116.70, "longitude", ("deg", -180, 180))
    ground_height_m: float = param(11.5, "ellipsoidal", ("m", -500, 9000))
    geoid_undulation_m: float = param(-9.0, "of the sea level", ("m", -120, 100))

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane of the site, at the height of the ground."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        return TangentPlane(float(lat), float(lon), self.ground_height_m)


@dataclass(frozen=True, slots=True)
class VideoScenario:
    """Hold the thermal camera, by default that of Table 9, and its pictures."""

    width: int = param(640, "of a picture", ("px", 16, 4096))
    height: int = param(512, "of a picture", ("px", 16, 4096))
    focal_px: tuple[float, ...] = param((XT2.fx, XT2.fy), "fx, fy", ("px", 1, 1e5))
    principal_px: tuple[float, ...] = param((XT2.cx, XT2.cy), "cx, cy", ("px", -1e4, 1e4))
    #: If not 0: square pixels around the middle, in place of focal_px and principal_px.
    fov_deg: float = param(0.0, "field of view across", ("deg", 0, 140))
    distortion: tuple[float, ...] = param(
        XT2.distortion, "k1, k2, p1, p2, k3, ...", ("", -100, 100), sizes=(0, 4, 5, 8)
    )
    #: 8 is thermal/image_raw/compressed (JPEG), 16 is thermal/image_raw (mono16).
    bits: int = param(8, "of a pixel: 8 or 16", ("", 8, 16))
    rate_hz: float = param(9.0, "frames per second", ("Hz", 0.1, 60))
    latency_s: float = param(0.05, "stamp minus exposure", ("s", 0, 2))
    jpeg_quality: int = param(65, "of thermal/image_raw/compressed", ("", 1, 100))
    blur_px: float = param(0.7, "standard deviation of the optics' blur", ("px", 0, 9))
    noise_grey: float = param(1.0, "sigma of a pixel, grey levels", ("", 0, 50))
    vignetting: float = param(0.06, "loss of contrast in the corners", ("", 0, 1))

    @property
    def camera(self) -> Camera:
        """Return the camera; raise CameraError."""
        (fx, fy), (cx, cy) = self.focal_px, self.principal_px
        if self.fov_deg:
            cx, cy = (self.width - 1) / 2, (self.height - 1) / 2
            fx = fy = self.width / 2 / math.tan(math.radians(self.fov_deg) / 2)
        return Camera(self.width, self.height, fx, fy, cx, cy, self.distortion)


@dataclass(frozen=True, slots=True)
class ParkScenario:
    """Hold where the flower beds lie, from the site's origin, and how finely they are painted."""

    north_m: tuple[float, ...] = param((-76.0, 106.0), "edges of the beds", ("m", -1e4, 1e4))
    east_m: tuple[float, ...] = param((-36.0, 104.0), "edges of the beds", ("m", -1e4, 1e4))
    cell_m: float = param(14.0, "each bed lies in a square of this side", ("m", 6, 100))
    margin_m: float = param(50.0, "grass painted around the beds", ("m", 0, 2000))
    resolution_m: float = param(0.05, "of the painted ground", ("m", 0.01, 1))
    slope_deg: float = param(0.0, "the ground rises by this", ("deg", 0, 30))
    uphill_deg: float = param(0.0, "towards here, from north", ("deg", -360, 360))


#: Targets at given places, as rows of north, east (m), warmer than grass by (K), size (m).
_targets: Any = partial(
    param, description="of four", within=("", -1e4, 1e4), sizes=tuple(range(0, 401, 4))
)


@dataclass(frozen=True, slots=True)
class SceneScenario:
    """Hold what a search looks for, warmer than the ground."""

    people: int = param(0, "at seeded places, in addition to the given ones", ("", 0, 100))
    people_at: tuple[float, ...] = _targets((31.0, 41.0, 12.0, 0.5))
    fires: int = param(0, "at seeded places", ("", 0, 100))
    fires_at: tuple[float, ...] = _targets(())
    vehicles: int = param(0, "at seeded places", ("", 0, 100))
    vehicles_at: tuple[float, ...] = _targets(())


@dataclass(frozen=True, slots=True)
class SurveyScenario:
    """Hold control points on corners of beds, and an operator's clicks on them."""

    points: int = param(20, "control points", ("", 1, 1000))
    views: int = param(3, "clicks on each, in as many frames", ("", 1, 100))
    #: No clicks earlier: a filter needs some time.
    after_s: float = param(20.0, "of the first click", ("s", 0, 7200))
    sigma_m: tuple[float, ...] = param((0.01, 0.01, 0.02), "north, east, down", ("m", 0, 100))
    click_sigma_px: float = param(0.5, "error of a click, per axis", ("px", 0, 50))
    #: An operator clicks between these rows, and at least this far from the left and right edge.
    rows_px: tuple[float, ...] = param((180.0, 490.0), "rows", ("px", 0, 1e4))
    side_px: float = param(40.0, "columns from the edge", ("px", 0, 1e4))
    apart_s: float = param(1.0, "shortest time between clicks on a point", ("s", 0, 100))
