"""Coordinate reference systems: from a map's own to longitudes and latitudes in WGS84."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pyproj
from pyproj.exceptions import CRSError, ProjError

from tirgeo_ros.core.errors import MapError
from tirgeo_ros.core.polylines import BoolArray
from tirgeo_ros.core.samples import Array

_REMEDY = (
    "save the map in WGS84 (EPSG:4326), or name its system in a crs member (GeoJSON) or under crs "
    "in the style sheet"
)
_WGS84_AXIS_M = 6378137.0
#: A shift less exact than this is told. EPSG gives 1 m to the datums of plates (ETRS89 and the
#: like), which services for RTK work in too.
_EXACT_M = 1.0


def known(name: str) -> bool:
    """Whether a name is that of a system on the Earth's surface."""
    return _system(name) is not None


def checked_system(name: str, where: str) -> pyproj.CRS:
    """The system of a code, a WKT or a PROJ text.

    Raises MapError if it is unknown, or is none of the Earth's surface.
    """
    system = _system(name)
    if system is None:
        raise MapError(f"{where}: unknown coordinate reference system {_short(name)!r}; {_REMEDY}")
    return system


@lru_cache(maxsize=32)
def _system(name: str) -> pyproj.CRS | None:
    try:
        system = pyproj.CRS.from_user_input(name)
    except (CRSError, ProjError, UnicodeError, ValueError):
        return None
    return system if system.is_geographic or system.is_projected else None


def _short(name: str) -> str:
    line = " ".join(name.split())
    return line if len(line) <= 60 else line[:57] + "..."


def to_wgs84(points: Array, name: str, where: str) -> tuple[Array, tuple[str, ...]]:
    """Points (N, 3) x, y, z as longitude, latitude (deg), ellipsoidal height (m); and remarks.

    x comes before y whatever the system's own order. Heights of a compound system are those of
    another zero, so they become nan; heights of a plain one are the ellipsoid's, as they are.

    Raises MapError for an unknown system, and for one whose datum PROJ cannot bring to WGS84.
    """
    system = checked_system(name, where)
    laid = np.array(points, float)
    remarks: tuple[str, ...] = ()
    if system.is_compound:
        if np.isfinite(laid[:, 2]).any():
            remarks = (
                f"{where}: heights of {system.name} are none above the ellipsoid: left out",
            )
        laid[:, 2] = np.nan
    transformer = _transformer(system, where)
    laid[:, 0], laid[:, 1] = transformer.transform(points[:, 0], points[:, 1])
    if len(laid):
        remarks += _shift_remarks(transformer, system, where)
    return laid, remarks


def _transformer(system: pyproj.CRS, where: str) -> pyproj.Transformer:
    try:
        return pyproj.Transformer.from_crs(system.to_2d(), "EPSG:4326", always_xy=True)
    except ProjError:
        raise MapError(
            f"{where}: there is no way from {system.name} to WGS84: is it of the Earth?"
        ) from None


def _shift_remarks(
    transformer: pyproj.Transformer, system: pyproj.CRS, where: str
) -> tuple[str, ...]:
    """What the step between the datums lacks; it is that of the last point transformed."""
    try:
        step = transformer.get_last_used_operation()
    except ProjError:  # nothing was to be done, or all failed: the check of range says so
        return ()
    if "Ballpark" in step.description:
        return _unknown_datum(system, where)
    if step.accuracy > _EXACT_M:
        return (f"{where}: from {system.name} to WGS84 is known to {step.accuracy:g} m only",)
    return ()


def _unknown_datum(system: pyproj.CRS, where: str) -> tuple[str, ...]:
    """An ellipsoid as large as WGS84's is taken for it; another is hundreds of metres off."""
    ellipsoid = system.ellipsoid
    if ellipsoid is not None and abs(ellipsoid.semi_major_metre - _WGS84_AXIS_M) < 1.0:
        return (f"{where}: {system.name} names no datum: taken for WGS84",)
    raise MapError(
        f"{where}: the way from the datum of {system.name} to WGS84 is not known; "
        f"give its EPSG code or +towgs84 under crs in the style sheet"
    )


def in_range(points: Array) -> BoolArray:
    """Which points (N, 3) are a longitude and a latitude in degrees."""
    right: BoolArray = (np.abs(points[:, 0]) <= 180) & (np.abs(points[:, 1]) <= 90)
    return right


def range_error(where: str, x: float, y: float) -> MapError:
    """The error for a vertex that is none."""
    return MapError(f"{where}: ({x:.6g}, {y:.6g}) is not a longitude and a latitude; {_REMEDY}")
