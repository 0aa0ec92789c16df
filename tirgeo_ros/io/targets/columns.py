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
"""Define the columns of a target and of a located pixel, for every format; make their rows."""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.core.targets.target import NEW, Target
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.coordinates.crs import written
from tirgeo_ros.io.surveys.survey import Answered

#: Field of a click that files keep -> its type in SQL.
CLICK = {
    "stamp_ns": "INTEGER NOT NULL",
    **dict.fromkeys(("latitude_deg", "longitude_deg", "height_m"), "REAL NOT NULL"),
    "covariance_enu": "TEXT NOT NULL",
}
#: Column of a place -> its type in SQL; sigmas are one standard deviation, ellipses 95 %.
_PLACE_COLUMNS = {
    "stamp_ns": "INTEGER",
    "time": "DATETIME",
    **dict.fromkeys(("latitude_deg", "longitude_deg", "height_m"), "REAL"),
    **dict.fromkeys(("sigma_north_m", "sigma_east_m", "sigma_height_m"), "REAL"),
    **dict.fromkeys(("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg"), "REAL"),
    **dict.fromkeys(("covariance_enu", "mgrs", "utm"), "TEXT"),
}
_CELSIUS = "temperature_c"  # column of a pixel
#: Column of a target -> its type in SQL, and its cell. A point that a GIS adds has neither id nor
#: number.
_TARGET_COLUMNS: Mapping[str, tuple[str, Callable[[Target], Any]]] = {
    "id": ("TEXT UNIQUE", lambda t: t.id),
    "number": ("INTEGER UNIQUE", lambda t: t.number),
    "name": ("TEXT", lambda t: _utf8(t.name)),
    "target_kind": ("TEXT", lambda t: t.kind),
    "note": ("TEXT", lambda t: _utf8(t.note)),
    "aircraft": ("TEXT", lambda t: _utf8(t.aircraft)),
    "created_ns": ("INTEGER", lambda t: t.created_ns),
    "changed_ns": ("INTEGER", lambda t: t.changed_ns),
    "clicks": ("INTEGER", lambda t: len(t.clicks)),
    "clicks_agree": ("BOOLEAN", lambda t: t.clicks_agree),
    "status": ("TEXT", lambda t: t.status),
}
#: Column -> its type in SQL.
COLUMNS: Mapping[str, str] = {
    name: kind for name, (kind, _) in _TARGET_COLUMNS.items()
} | _PLACE_COLUMNS


class Row(NamedTuple):
    """Hold the row of a target, or of a pixel that was located or refused."""

    cells: dict[str, Any]  # texts, numbers, bool; None for cells that a refused pixel lacks
    target: Target | None  # None: a refused pixel
    words: str  # for a person


def target_cells(target: Target) -> dict[str, Any]:
    """Return the cells of a target, in the order of ``COLUMNS``."""
    own = {name: cell(target) for name, (_, cell) in _TARGET_COLUMNS.items()}
    return own | _place_cells(target.place)


def target_rows(targets: Sequence[Target]) -> list[Row]:
    """Return a row for each target."""
    return [Row(target_cells(target), target, _words(target)) for target in targets]


def answer_rows(answers: Sequence[Answered]) -> list[Row]:
    """Return a row for each pixel, in order; a located one is a target with the pixel's name."""
    rows = []
    for number, (name, answer) in enumerate(answers, 1):
        pixel = {"id": name, "stamp_ns": answer.stamp_ns, "u": answer.uv[0], "v": answer.uv[1]}
        if isinstance(answer, Refusal):
            nothing = {key: None for key in (*_PLACE_COLUMNS, _CELSIUS) if key not in pixel}
            reason = answer.reason.value
            rows.append(Row(pixel | nothing | {"reason": reason}, None, f"not located: {reason}"))
        else:
            target = target_of_pixel(number, name, answer)
            known, words = math.isfinite(answer.temperature_c), _words(target)
            temperature_c = round(answer.temperature_c, 2) if known else None
            words += f"; {temperature_c:.1f} deg C" if known else ""
            temperature = {_CELSIUS: temperature_c, "reason": None}
            rows.append(Row(pixel | _place_cells(answer) | temperature, target, words))
    return rows


def target_of_pixel(number: int, name: str, place: Located) -> Target:
    """Return a located pixel as a target: the same one for the same file, number and name."""
    numbers = ", ".join(f"{key}={getattr(place, key)!r}" for key in CLICK)
    # "Fixing", as in earlier versions, so that a map recognises the point of an earlier export.
    own_id = uuid.uuid5(uuid.NAMESPACE_URL, f"tirgeo/Fixing({numbers})/{number}/{name!r}").hex
    return Target(own_id, number, name, "other", "", "", place.stamp_ns, place.stamp_ns, (place,))


def _place_cells(place: Located) -> dict[str, Any]:
    """Return the cells of a place in the order of ``_PLACE_COLUMNS``."""
    east2, _, _, _, north2, _, _, _, up2 = place.covariance_enu
    major_m, minor_m, azimuth_rad = place.ellipse
    texts = written(place.latitude_deg, place.longitude_deg)
    return {
        "stamp_ns": place.stamp_ns,
        "time": utc(place.stamp_ns),
        "latitude_deg": round(place.latitude_deg, 9),
        "longitude_deg": round(place.longitude_deg, 9),
        "height_m": round(place.height_m, 4) + 0.0,  # not -0.0
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


def _utf8(text: str) -> str:
    """Return a text that UTF-8 can encode; other characters (of a damaged file) are escaped."""
    return text.encode(errors="backslashreplace").decode()


def _words(target: Target) -> str:
    """Describe the place for a person."""
    place = target.place
    ellipse, height_m = place.ellipse, round(place.height_m, 2) + 0.0  # not -0.0
    text = (
        f"95 % within {ellipse.major_m:.2f} x {ellipse.minor_m:.2f} m (semi-axes), the longer "
        f"towards {math.degrees(ellipse.azimuth_rad):.0f} deg; {height_m:.2f} m above the "
        "ellipsoid"
    )
    text = text if target.clicks_agree else f"{text}; its clicks disagree"
    return text if target.status == NEW else f"{target.status}; {text}"
