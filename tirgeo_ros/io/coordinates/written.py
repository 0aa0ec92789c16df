"""Write a place as people pass it on: decimal degrees, DMS, MGRS and UTM."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import NamedTuple

import mgrs
import pyproj

_HUNDREDTHS = 360_000  # of a second of arc, in a degree
#: The library keeps the zone's numbers in globals of C, and runs without Python's lock.
_ONE_AT_A_TIME = threading.Lock()


class Written(NamedTuple):
    """Hold a place in each way of writing; texts to read out, copy and paste."""

    decimal: str  # "48.208174, 16.373819": latitude, longitude, to 0.1 m
    dms: str  # 48°12'29.43"N 16°22'25.75"E: to 0.3 m
    mgrs: str  # "33U XP 02066 40350": the square of 1 m, so its digits are cut, not rounded
    utm: str  # "33U 602066.7 5340350.8": zone and band, easting, northing, m; "" near the poles


def written(latitude_deg: float, longitude_deg: float) -> Written:
    """Return a place on WGS84, latitude -90 to 90 and longitude -180 to 180, as texts."""
    square = _mgrs(latitude_deg, longitude_deg)
    return Written(
        f"{latitude_deg:.6f}, {longitude_deg:.6f}",
        f"{_dms(latitude_deg, 'NS')} {_dms(longitude_deg, 'EW')}",
        _spaced(square),
        _utm(square[:3], latitude_deg, longitude_deg),
    )


def _dms(degrees: float, hemispheres: str) -> str:
    """Return whole degrees, minutes and seconds; rounded first, so no seconds are 60.00."""
    whole, rest = divmod(round(abs(degrees) * _HUNDREDTHS), _HUNDREDTHS)
    minutes, hundredths = divmod(rest, 6000)
    side = hemispheres[degrees < 0]
    return f"{whole}\N{DEGREE SIGN}{minutes:02}'{hundredths / 100:05.2f}\"{side}"


def _mgrs(latitude_deg: float, longitude_deg: float) -> str:
    """Return the square of 1 m; with two digits of a zone unless it is near a pole."""
    with _ONE_AT_A_TIME:
        text = str(mgrs.MGRS().toMGRS(latitude_deg, longitude_deg))
    return text.zfill(15) if text[0].isdigit() else text


def _spaced(square: str) -> str:
    at = 3 if square[0].isdigit() else 1
    return f"{square[:at]} {square[at : at + 2]} {square[at + 2 : -5]} {square[-5:]}"


def _utm(zone: str, latitude_deg: float, longitude_deg: float) -> str:
    """Return UTM in the zone of the MGRS square, which in Norway is not always the nearest."""
    if not zone[0].isdigit():
        return ""
    way = _way(int(zone[:2]), north=zone[2] >= "N")
    with _ONE_AT_A_TIME:
        easting_m, northing_m = way.transform(longitude_deg, latitude_deg)
    return f"{zone} {easting_m:.1f} {northing_m:.1f}"


@lru_cache(maxsize=8)
def _way(zone: int, *, north: bool) -> pyproj.Transformer:
    code = (32600 if north else 32700) + zone
    return pyproj.Transformer.from_crs("EPSG:4326", f"EPSG:{code}", always_xy=True)
