"""Name what every format holds of a target: its properties with units, and their types."""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone
from typing import Any

from tirgeo_ros.core.targets.target import Fixing, Target
from tirgeo_ros.io.coordinates.written import written

#: Line end, zero-width non-joiner, zero-width joiner.
_KEPT = "\n\u200c\u200d"
#: Property of a place -> its type in SQL.
OF_PLACE = {
    "stamp_ns": "INTEGER",
    "time": "DATETIME",
    "latitude_deg": "REAL",
    "longitude_deg": "REAL",
    "height_m": "REAL",
    "sigma_north_m": "REAL",
    "sigma_east_m": "REAL",
    "sigma_height_m": "REAL",
    "ellipse_major_m": "REAL",
    "ellipse_minor_m": "REAL",
    "ellipse_azimuth_deg": "REAL",
    "covariance_enu": "TEXT",
    "mgrs": "TEXT",
    "utm": "TEXT",
}
#: Property of a target -> its type in SQL. A point that a GIS adds has neither id nor number.
COLUMNS = {
    "id": "TEXT UNIQUE",
    "number": "INTEGER UNIQUE",
    "name": "TEXT",
    "target_kind": "TEXT",
    "note": "TEXT",
    "aircraft": "TEXT",
    "created_ns": "INTEGER",
    "changed_ns": "INTEGER",
    "clicks": "INTEGER",
    "clicks_agree": "BOOLEAN",
} | OF_PLACE


def of_target(target: Target) -> dict[str, Any]:
    """Return the properties of a target, in the order of ``COLUMNS``.

    ``stamp_ns`` and ``time`` are those of the newest picture that was clicked.
    """
    return {
        "id": target.id,
        "number": target.number,
        "name": utf8(target.name),
        "target_kind": target.kind,
        "note": utf8(target.note),
        "aircraft": utf8(target.aircraft),
        "created_ns": target.created_ns,
        "changed_ns": target.changed_ns,
        "clicks": len(target.fixings),
        "clicks_agree": target.clicks_agree,
    } | of_place(target.place)


def of_place(place: Fixing) -> dict[str, Any]:
    """Return the properties of a place; sigmas are one standard deviation, ellipses 95 %."""
    east2, _, _, _, north2, _, _, _, up2 = place.covariance_enu
    major_m, minor_m, azimuth_rad = place.ellipse
    texts = written(place.latitude_deg, place.longitude_deg)
    return {
        "stamp_ns": place.stamp_ns,
        "time": utc(place.stamp_ns),
        "latitude_deg": round(place.latitude_deg, 9),
        "longitude_deg": round(place.longitude_deg, 9),
        "height_m": round(place.height_m, 4),
        "sigma_north_m": round(math.sqrt(north2), 4),
        "sigma_east_m": round(math.sqrt(east2), 4),
        "sigma_height_m": round(math.sqrt(up2), 4),
        "ellipse_major_m": round(major_m, 4),
        "ellipse_minor_m": round(minor_m, 4),
        "ellipse_azimuth_deg": round(math.degrees(azimuth_rad), 4),
        "covariance_enu": " ".join(f"{number:.6g}" for number in place.covariance_enu),
        "mgrs": texts.mgrs,
        "utm": texts.utm,
    }


def legible(text: str) -> str:
    """Return a text without control characters; each tab or other space is a plain one.

    Line ends stay, and the joiners within emoji, Persian and Indian words.
    """
    spaced = (" " if c.isspace() and c != "\n" else c for c in text)
    return "".join(c for c in spaced if c.isprintable() or c in _KEPT)


def utf8(text: str) -> str:
    """Return a text that can be encoded: what cannot (of a damaged file) is escaped."""
    return text.encode(errors="backslashreplace").decode()


def utc(stamp_ns: int, later: timedelta = timedelta()) -> str:
    """Return ISO 8601 to a millisecond, rounded down."""
    since = timedelta(milliseconds=stamp_ns // 1_000_000) + later
    moment = datetime(1970, 1, 1, tzinfo=timezone.utc) + since
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"
