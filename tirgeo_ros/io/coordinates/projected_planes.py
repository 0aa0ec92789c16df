"""Define planes in metres for pictures of the ground: UTM, or any projected system."""

from __future__ import annotations

import numpy as np
import pyproj

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import checked_system


class Plane:
    """Convert between degrees and a projected system.

    Without a name the system is the UTM zone of some points (n, 2), longitude and latitude in
    degrees. Raises MapError for a name that is unknown or no projected system in metres.
    """

    def __init__(self, name: str | None, degrees: Array) -> None:
        self.system = _named(name) if name else _utm(degrees)
        self._way = pyproj.Transformer.from_crs("EPSG:4326", self.system, always_xy=True)

    @property
    def name(self) -> str:
        """Return the system's name for people."""
        authority = self.system.to_authority()
        code = f" ({':'.join(authority)})" if authority else ""
        return f"{self.system.name}{code}"

    def metres(self, degrees: Array) -> Array:
        """Return x, y (n, 2) in metres of longitudes and latitudes (n, 2) in degrees."""
        return np.stack(self._way.transform(*degrees.T), axis=1)

    def degrees(self, metres: Array) -> Array:
        """Return longitudes and latitudes (n, 2) in degrees of x, y (n, 2) in metres."""
        x, y = metres.T
        return np.stack(self._way.transform(x, y, direction="INVERSE"), axis=1)


def _named(name: str) -> pyproj.CRS:
    system = checked_system(name, "--crs").to_2d()
    if not system.is_projected or any(axis.unit_name != "metre" for axis in system.axis_info):
        raise MapError(
            f"--crs {name}: {system.name} is not a projected system in metres; give one"
        )
    return system


def _utm(degrees: Array) -> pyproj.CRS:
    """Return the UTM zone of the median, also beyond latitude 84 deg, where UTM proper ends."""
    longitude, latitude = np.median(degrees, axis=0).tolist()
    return pyproj.CRS.from_epsg(utm_zone(latitude, longitude)[1])


def utm_zone(latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    """Return the number of a place's UTM zone, and the zone's EPSG code (WGS84).

    The exceptions around Norway and Svalbard are not made: their planes are as good.
    """
    zone = int((longitude_deg + 180) // 6) % 60 + 1
    return zone, (32600 if latitude_deg >= 0 else 32700) + zone
