"""Name what every format holds of a target: its properties with units, and their types.

Make the rows that every format writes, of targets and of the pixels of ``tirgeo locate``.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple

from tirgeo_ros.core.ground.ground_point import Refusal
from tirgeo_ros.core.targets.target import Fixing, Target, fixing_of
from tirgeo_ros.io.coordinates.crs import written
from tirgeo_ros.io.surveys.survey import Answered

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


class Row(NamedTuple):
    """Hold what is written of a target, or of a pixel that was located or refused."""

    properties: dict[str, Any]  # texts, numbers, bool; None for what a refused pixel lacks
    target: Target | None  # None of a refused pixel
    words: str  # for a person


def of_targets(targets: Sequence[Target]) -> list[Row]:
    """Return a row for each target."""
    return [Row(of_target(one), one, _words(one)) for one in targets]


def of_answers(answers: Sequence[Answered]) -> list[Row]:
    """Return a row for each pixel in their order; a located one is a target with its name."""
    return [_row(number, one) for number, one in enumerate(answers, 1)]


def _row(number: int, one: Answered) -> Row:
    name, answer = one
    pixel = {"id": name, "stamp_ns": answer.stamp_ns, "u": answer.uv[0], "v": answer.uv[1]}
    if isinstance(answer, Refusal):
        known = pixel | {key: None for key in OF_PLACE if key not in pixel}
        reason = answer.reason.value
        return Row(known | {"reason": reason}, None, f"not located: {reason}")
    place = fixing_of(answer)
    target = target_of_pixel(number, name, place)
    return Row(pixel | of_place(place) | {"reason": None}, target, _words(target))


def target_of_pixel(number: int, name: str, place: Fixing) -> Target:
    """Return a located pixel as a target: the same one for the same file, number and name."""
    own_id = uuid.uuid5(uuid.NAMESPACE_URL, f"tirgeo/{place}/{number}/{name!r}").hex
    return Target(own_id, number, name, "other", "", "", place.stamp_ns, place.stamp_ns, (place,))


def _words(target: Target) -> str:
    """Describe the place for a person."""
    place = target.place
    ellipse = place.ellipse
    text = (
        f"95 % within {ellipse.major_m:.2f} x {ellipse.minor_m:.2f} m (semi-axes), the longer "
        f"towards {math.degrees(ellipse.azimuth_rad):.0f} deg; {place.height_m:.2f} m above the "
        "ellipsoid"
    )
    return text if target.clicks_agree else f"{text}; its clicks disagree"
