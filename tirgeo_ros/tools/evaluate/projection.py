"""Project to the plane of the ground errors: transverse Mercator on WGS84, by PROJ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pyproj

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.coordinates.crs import utm_zone

#: Above this latitude zones are too narrow to be useful.
_MOST_LATITUDE_DEG = 84.0


@dataclass(frozen=True)
class Projection:
    """Project to a transverse Mercator plane."""

    name: str
    definition: str  # for PROJ

    @cached_property
    def _proj(self) -> Any:
        return pyproj.Proj(self.definition)

    def project(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Return east and north (..., 2), m, of positions (...)."""
        east, north = self._proj(np.degrees(longitude_rad), np.degrees(latitude_rad))
        return np.stack([np.asarray(east, float), np.asarray(north, float)], axis=-1)

    def local_axes(self, latitude_rad: float, longitude_rad: float) -> Array:
        """Return the matrix (2, 2) from metres north, east at a point to east, north in the plane.

        It is the scale at that point, rotated by the meridian convergence.
        """
        factors = self._proj.get_factors(math.degrees(longitude_rad), math.degrees(latitude_rad))
        turn, scale = math.radians(factors.meridian_convergence), factors.meridional_scale
        sine, cosine = scale * math.sin(turn), scale * math.cos(turn)
        return np.array([[-sine, cosine], [cosine, sine]])


def projection_of(kind: str, latitude_rad: Array, longitude_rad: Array) -> Projection:
    """Return ``gauss-krueger`` (3-degree zones, scale 1) or ``utm`` for points (N,), N at least 1.

    The zone is that of the points' middle. Raise SurveyError too near a pole.
    """
    latitude_deg = math.degrees(float(np.mean(latitude_rad)))
    # The mean of directions, so that it is right for points on both sides of 180 degrees.
    middle = np.arctan2(np.sin(longitude_rad).mean(), np.cos(longitude_rad).mean())
    longitude_deg = math.degrees(float(middle))
    if abs(latitude_deg) > _MOST_LATITUDE_DEG:
        raise SurveyError(
            f"the survey lies at latitude {latitude_deg:.1f}: no transverse Mercator zone there"
        )
    if kind == "utm":
        zone, code = utm_zone(latitude_deg, longitude_deg)
        half = "S" if latitude_deg < 0 else "N"
        return Projection(f"UTM zone {zone}{half}, WGS84 (EPSG:{code})", f"EPSG:{code}")
    meridian = 3.0 * math.floor(longitude_deg / 3 + 0.5)
    side = "W" if meridian < 0 else "E"
    return Projection(
        f"Gauss-Krueger, 3-degree zone of {abs(meridian):g} deg {side}, WGS84",
        f"+proj=tmerc +lon_0={meridian:g} +k=1 +x_0=500000 +ellps=WGS84 +units=m",
    )
