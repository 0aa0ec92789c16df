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
"""Transform points between coordinate reference systems, and write positions as text."""

from __future__ import annotations

import re
import threading
from functools import cache, lru_cache
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
import pyproj
from pyproj.crs import Datum  # type: ignore[attr-defined]
from pyproj.exceptions import CRSError, ProjError

from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import MapError

_REMEDY = (
    "save the map in WGS84 (EPSG:4326), or name its system in a crs member (GeoJSON) or under crs "
    "in the style sheet"
)
#: Remark for positions whose datum is not stated.
ASSUMED = "taken as WGS84: within 2 m for a modern datum, 100 m off or more for an old one"
_WGS84_AXIS_M = 6378137.0
#: A datum shift that is less exact than this is reported. EPSG states 1 m for most datums of
#: tectonic plates (ETRS89 and the like), in which RTK services work too, and 2 or 3 m for some
#: (NAD83(2011), GDA2020).
_EXACT_M = 1.0
_PLATE_M = 3.0
_ROUNDING_DEG = 1e-9  # a tenth of a millimetre
_NO_DATUM = re.compile(r"unknown|not.?specified|undefined|unnamed|\bnone\b", re.IGNORECASE)
_HUNDREDTHS = 360_000  # of a second of arc, in a degree
_BANDS = "CDEFGHJKLMNPQRSTUVWXX"  # of UTM, 8 deg high from -80 on; the last is higher
#: The library mgrs keeps a zone's numbers in C globals and releases Python's lock.
_MGRS_LOCK = threading.Lock()


def checked_system(name: str, where: str) -> pyproj.CRS:
    """Return the system that a code, a WKT or a PROJ text names.

    Raises MapError if it is unknown, or is not on the Earth's surface.
    """
    system = _any_system(name)
    if system is None:
        raise MapError(f"{where}: unknown coordinate reference system {_short(name)!r}; {_REMEDY}")
    if not system.is_geographic and not system.is_projected:
        raise MapError(
            f"{where}: {_short(name)!r} is a {system.type_name}, and a map needs longitudes and "
            f"latitudes or a plane; {_REMEDY}"
        )
    return system


@lru_cache(maxsize=32)
def _any_system(name: str) -> pyproj.CRS | None:
    try:
        return pyproj.CRS.from_user_input(name)
    except (CRSError, ProjError, UnicodeError, ValueError):
        return None


def _short(name: str) -> str:
    line = " ".join(name.split())
    return line if len(line) <= 60 else line[:57] + "..."


def to_wgs84(points: Array, name: str, where: str) -> tuple[Array, tuple[str, ...]]:
    """Convert points (N, 3) x, y, z to longitude, latitude (deg), ellipsoidal height (m).

    Returns the points (N, 3) and remarks. x comes before y whatever the system's own order.
    Heights of a compound system are above another datum, so they become nan. Heights of a plain
    system are ellipsoidal and stay as they are.

    Raises MapError for an unknown system, and for one whose datum PROJ cannot transform to WGS84.
    """
    system = checked_system(name, where)
    places = np.array(points, float)
    remarks: tuple[str, ...] = ()
    if system.is_compound:
        if np.isfinite(places[:, 2]).any():
            remarks = (f"{where}: heights of {system.name} are not above the ellipsoid: left out",)
        places[:, 2] = np.nan
    try:
        transformer = pyproj.Transformer.from_crs(system.to_2d(), "EPSG:4326", always_xy=True)
    except ProjError:
        raise MapError(
            f"{where}: cannot be transformed from {system.name} to WGS84: is it of the Earth?"
        ) from None
    places[:, 0], places[:, 1] = transformer.transform(points[:, 0], points[:, 1])
    if len(places):
        remarks += _shift_remarks(transformer, system, where)
    return places, remarks


def _shift_remarks(
    transformer: pyproj.Transformer, system: pyproj.CRS, where: str
) -> tuple[str, ...]:
    """Return remarks on the datum shift that PROJ used for the last point transformed.

    If PROJ knows no shift, a datum with an ellipsoid as large as WGS84's is taken as WGS84. Raises
    MapError for any other datum, which may be hundreds of metres off.
    """
    try:
        step = transformer.get_last_used_operation()
    except ProjError:  # there is only one operation, and it changes nothing
        step = transformer
    if "Ballpark" not in step.description:
        exact = step.accuracy <= (_PLATE_M if _of_a_plate(system) else _EXACT_M)
        remark = f"{where}: from {system.name} to WGS84 is known only to {step.accuracy:g} m"
        return () if exact else (remark,)
    if not _has_wgs84_size(system):
        raise MapError(
            f"{where}: the transformation from the datum of {system.name} to WGS84 is not known; "
            f"give its EPSG code or +towgs84 under crs in the style sheet"
        )
    if _of_a_plate(system):
        return ()
    datum = system.datum.name if system.datum else ""
    if not datum or _NO_DATUM.search(datum):
        return (f"{where}: {system.name} names no datum: {ASSUMED}",)
    return (f"{where}: the datum {_short(datum)!r} of {system.name} is not known: {ASSUMED}",)


def _of_a_plate(system: pyproj.CRS) -> bool:
    """Return whether the datum has a name and WGS84's size: such datums agree with WGS84."""
    datum = system.datum
    if datum is None or _NO_DATUM.search(datum.name) or not _has_wgs84_size(system):
        return False
    try:  # by a code, or by a name or an alias that PROJ knows
        return "id" in datum.to_json_dict() or bool(Datum.from_name(datum.name))
    except CRSError:
        return False


def _has_wgs84_size(system: pyproj.CRS) -> bool:
    ellipsoid = system.ellipsoid
    return ellipsoid is not None and abs(ellipsoid.semi_major_metre - _WGS84_AXIS_M) < 1.0


def in_range(points: Array) -> BoolArray:
    """Return for each point (N, 3) whether it is a longitude and a latitude in degrees."""
    valid: BoolArray = (np.abs(points[:, 0]) <= 360) & (np.abs(points[:, 1]) <= 90)
    return valid


def range_fault(x: float, y: float, *, all_are: bool) -> str:
    """Return what is wrong with an invalid vertex, and the remedy if all are invalid."""
    swapped = " (are the two swapped?)" if abs(x) <= 90 < abs(y) <= 180 else ""
    remedy = f"; {_REMEDY}" if all_are else ""
    return f"({x:.6g}, {y:.6g}) is not a longitude and a latitude{swapped}{remedy}"


def once_around(longitudes: Array) -> Array:
    """Return longitudes (deg) wrapped to -180 to 180; rounding errors beyond are clipped."""
    once = np.abs(longitudes) < 180 + _ROUNDING_DEG
    return np.where(once, np.clip(longitudes, -180, 180), (longitudes + 180) % 360 - 180)


class Plane:
    """Convert between degrees and a plane in metres for pictures: UTM, or any projected system.

    Without a name the system is the UTM zone of the points ``degrees`` (n, 2), longitude and
    latitude. Raises MapError for a name that is unknown or not a projected system in metres.
    """

    def __init__(self, name: str | None, degrees: Array) -> None:
        if not name:
            # Also beyond latitude 84 deg, where UTM proper ends.
            longitude, latitude = np.median(degrees, axis=0).tolist()
            # Without the exceptions around Norway and Svalbard: their planes are as good.
            zone = int((longitude + 180) // 6) % 60 + 1
            name = f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"
        self.system = system = checked_system(name, "--crs").to_2d()
        if not system.is_projected or any(axis.unit_name != "metre" for axis in system.axis_info):
            raise MapError(
                f"--crs {name}: {system.name} is not a projected system in metres; give one"
            )
        self._transformer = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)

    @property
    def name(self) -> str:
        """Return the system's name for people."""
        authority = self.system.to_authority()
        code = f" ({':'.join(authority)})" if authority else ""
        return f"{self.system.name}{code}"

    def metres(self, degrees: Array) -> Array:
        """Return x, y (n, 2) in metres of longitudes and latitudes (n, 2) in degrees."""
        return np.stack(self._transformer.transform(*degrees.T), axis=1)

    def degrees(self, metres: Array) -> Array:
        """Return longitudes and latitudes (n, 2) in degrees of x, y (n, 2) in metres."""
        x, y = metres.T
        return np.stack(self._transformer.transform(x, y, direction="INVERSE"), axis=1)


class Written(NamedTuple):
    """Hold a place as text in each notation, to read out, copy and paste."""

    decimal: str  # "48.208174, 16.373819": latitude, longitude, to 0.1 m
    dms: str  # 48°12'29.43"N 16°22'25.75"E: to 0.3 m
    mgrs: str  # "33U XP 02066 40350": the square of 1 m, so its digits are cut, not rounded
    utm: str  # "33U 602066.7 5340350.8": zone and band, easting, northing, m; "" near the poles


def written(latitude_deg: float, longitude_deg: float) -> Written:
    """Return a place on WGS84, latitude -90 to 90 and longitude -180 to 180, as texts.

    ``mgrs`` is empty without the package mgrs, which Ubuntu lacks (``has_mgrs``).
    """
    return Written(
        f"{latitude_deg:.6f}, {longitude_deg:.6f}",
        f"{_dms(latitude_deg, 'NS')} {_dms(longitude_deg, 'EW')}",
        _mgrs(latitude_deg, longitude_deg) if has_mgrs() else "",
        _utm(latitude_deg, longitude_deg),
    )


@cache
def has_mgrs() -> bool:
    """Return whether the package mgrs is installed."""
    return find_spec("mgrs") is not None


def _mgrs(latitude_deg: float, longitude_deg: float) -> str:
    import mgrs  # noqa: PLC0415  an extra

    with _MGRS_LOCK:
        square = str(mgrs.MGRS().toMGRS(latitude_deg, longitude_deg))
    at = 1  # near a pole the square has no zone number
    if square[0].isdigit():
        square, at = square.zfill(15), 3
    return f"{square[:at]} {square[at : at + 2]} {square[at + 2 : -5]} {square[-5:]}"


def _utm(latitude_deg: float, longitude_deg: float) -> str:
    """Return zone and band, easting and northing; nothing near the poles, where UTM ends."""
    if not -80 <= latitude_deg < 84:
        return ""
    band = _BANDS[int((latitude_deg + 80) // 8)]
    zone = _utm_zone(latitude_deg, longitude_deg)
    to_utm = _to_utm(zone, north=band >= "N")
    easting, northing = to_utm.transform(longitude_deg, latitude_deg)
    return f"{zone:02}{band} {easting:.1f} {northing:.1f}"


def _utm_zone(latitude_deg: float, longitude_deg: float) -> int:
    if latitude_deg >= 72 and 0 <= longitude_deg < 42:  # around Svalbard they are 12 deg wide
        return 31 + 2 * int((longitude_deg + 3) // 12)
    if 56 <= latitude_deg < 64 and 3 <= longitude_deg < 6:  # the west of Norway
        return 32
    return int((longitude_deg + 180) // 6) % 60 + 1


def _dms(degrees: float, hemispheres: str) -> str:
    """Return whole degrees, minutes and seconds; rounded first, so no seconds are 60.00."""
    whole, rest = divmod(round(abs(degrees) * _HUNDREDTHS), _HUNDREDTHS)
    minutes, hundredths = divmod(rest, 6000)
    side = hemispheres[degrees < 0]
    return f"{whole}\N{DEGREE SIGN}{minutes:02}'{hundredths / 100:05.2f}\"{side}"


@lru_cache(maxsize=8)
def _to_utm(zone: int, *, north: bool) -> pyproj.Transformer:
    code = (32600 if north else 32700) + zone
    return pyproj.Transformer.from_crs("EPSG:4326", f"EPSG:{code}", always_xy=True)
