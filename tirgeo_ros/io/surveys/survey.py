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
"""Read and write surveyed ground points and their observations in pictures."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.ground.ground_point import Answer
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError, nearest
from tirgeo_ros.io.coordinates.crs import to_wgs84
from tirgeo_ros.io.files.whole_files import PathLike, csv_text, read_text, write_files

T = TypeVar("T")

_SURVEY_COLUMNS = ("id", "lat", "lon", "h")
_OBSERVATION_COLUMNS = ("id", "stamp_ns", "u", "v")
_STILL_COLUMNS = ("id", "picture", "u", "v")
_MARK_COLUMNS = ("id", "column", "row")
_QGIS_COLUMNS = ("mapX", "mapY", "sourceX", "sourceY")  # since 3.26
#: Limit for a file: ``locate`` needs 35 kB and a millisecond for each row.
MOST_ROWS = 20_000


@dataclass(frozen=True, slots=True)
class SurveyPoint:
    """Hold a surveyed ground point."""

    id: str
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal


@dataclass(frozen=True, slots=True)
class Observation:
    """Hold the pixel at which a ground point was seen in a picture."""

    id: str
    stamp_ns: int  # of the picture's header
    u: float  # column, px
    v: float  # row, px


def load_survey(path: PathLike) -> list[SurveyPoint]:
    """Load points of GeoJSON with property ``id``, or CSV ``id,lat,lon,h``. Raises SurveyError."""
    text = read_text(path, SurveyError)
    if text.lstrip().startswith(("{", "[")):
        points = _geojson_points(path, text)
    else:
        points = _csv_rows(path, text, _SURVEY_COLUMNS, _point)
    _refuse_repeated(path, [point.id for point in points])
    return points


def save_survey(path: PathLike, points: Sequence[SurveyPoint]) -> None:
    """Write points as CSV where the name ends in ``.csv``, else as GeoJSON."""
    # Ten decimals of a degree are a hundredth of a millimetre.
    places = [(math.degrees(p.latitude_rad), math.degrees(p.longitude_rad)) for p in points]
    rows = [
        (p.id, f"{latitude:.10f}", f"{longitude:.10f}", f"{p.height_m:.4f}")
        for p, (latitude, longitude) in zip(points, places, strict=True)
    ]
    text = csv_text([_SURVEY_COLUMNS, *rows])
    if Path(path).suffix.lower() != ".csv":
        features = [
            {
                "type": "Feature",
                "properties": {"id": name},
                "geometry": {"type": "Point", "coordinates": [float(lon), float(lat), float(h)]},
            }
            for name, lat, lon, h in rows
        ]
        text = json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"
    write_files({path: text}, SurveyError)


def load_observations(
    path: PathLike, stills: Mapping[str, int] = MappingProxyType({})
) -> list[Observation]:
    """Load a CSV file ``id,stamp_ns,u,v``, or ``id,picture,u,v`` with the names of ``stills``.

    ``stills`` gives the stamp (ns) of each. Raises SurveyError naming file and line, and for a
    name that is not among them.
    """
    text = read_text(path, SurveyError)
    header = [name.strip() for name in text.partition("\n")[0].split(",")]
    if "stamp_ns" in header or "picture" not in header:
        return _csv_rows(path, text, _OBSERVATION_COLUMNS, _observation)
    rows = _csv_rows(path, text, _STILL_COLUMNS, _by_name)
    for number, (_, picture, _) in enumerate(rows, 1):
        if picture not in stills:
            hint = nearest(picture, stills) if stills else "; it has none: use stamp_ns"
            raise SurveyError(f"{path}: row {number}: no still {picture} in the flight{hint}")
    return [Observation(name, stills[picture], *uv) for name, picture, uv in rows]


def save_observations(path: PathLike, observations: Sequence[Observation]) -> None:
    """Write observations as CSV, pixels to a thousandth."""
    rows = [(o.id, str(o.stamp_ns), f"{o.u:.3f}", f"{o.v:.3f}") for o in observations]
    write_files({path: csv_text([_OBSERVATION_COLUMNS, *rows])}, SurveyError)


def check_rows(path: PathLike, rows: int) -> None:
    """Refuse more rows than can be processed at once."""
    if rows > MOST_ROWS:
        raise SurveyError(
            f"{path}: {rows} rows, more than the {MOST_ROWS} allowed: split the file"
        )


def _geojson_points(path: PathLike, text: str) -> list[SurveyPoint]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise SurveyError(f"{path}: line {error.lineno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:  # numbers too long, nesting too deep
        raise SurveyError(f"{path}: not JSON: {error}") from None
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise SurveyError(f"{path}: not a GeoJSON FeatureCollection of points")
    check_rows(path, len(features))
    points = []
    try:
        for feature in features:
            shape, name = feature["geometry"], str(feature["properties"]["id"])
            longitude, latitude, height = {"Point": shape["coordinates"]}[shape["type"]][:3]
            points.append(_point(name, latitude, longitude, height))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise SurveyError(
            f"{path}: feature {len(points) + 1} is not a Point with longitude, latitude, height "
            "and a property id"
        ) from None
    return points


def _csv_rows(
    path: PathLike, text: str, columns: tuple[str, ...], parse: Callable[..., T]
) -> list[T]:
    """Return the result of ``parse`` for each row's cells, in the order of ``columns``."""
    lines = text.splitlines()
    check_rows(path, len(lines) - 1)
    reader = csv.DictReader(lines, skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or ()]
    missing = [name for name in columns if name not in header]
    if missing:
        raise SurveyError(
            f"{path}: no column {', '.join(missing)}; the first line must be {','.join(columns)}"
        )
    reader.fieldnames = header
    try:
        return [parse(*(row[name] for name in columns)) for row in reader]
    except (TypeError, ValueError, csv.Error):
        raise SurveyError(
            f"{path}: line {reader.line_num} does not match {','.join(columns)}"
        ) from None


def _observation(name: str, stamp: str, u: str, v: str) -> Observation:
    stamp_ns = int(stamp)
    if abs(stamp_ns) >= 1 << 63:
        raise ValueError
    return Observation(_name(name), stamp_ns, *_finite(u, v))


def _by_name(name: str, picture: str, u: str, v: str) -> tuple[str, str, list[float]]:
    return _name(name), _name(picture), _finite(u, v)


def _finite(*numbers: str | float) -> list[float]:
    """Return finite numbers; raises ValueError for others, TypeError for None."""
    values = [float(number) for number in numbers]
    if not all(map(math.isfinite, values)):
        raise ValueError
    return values


def _name(name: str | None) -> str:
    if not (name or "").strip():
        raise ValueError
    return str(name).strip()


def _point(name: str, *place: str | float) -> SurveyPoint:
    """Return a point at latitude, longitude (deg), height; raises ValueError off the Earth."""
    latitude_deg, longitude_deg, height_m = _finite(*place)
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        raise ValueError
    return SurveyPoint(
        _name(name), math.radians(latitude_deg), math.radians(longitude_deg), height_m
    )


def _refuse_repeated(path: PathLike, ids: Sequence[str]) -> None:
    for name, count in Counter(ids).items():
        if count > 1:
            raise SurveyError(f"{path}: point {name} appears twice; give each its own id")


class Answered(NamedTuple):
    """Hold the id of a pixel in a list, and its located point or refusal."""

    id: str
    answer: Answer


@dataclass(frozen=True, slots=True)
class ControlPoints:
    """Hold points (n) in the order of their file."""

    names: list[str]
    pixels: Array  # (n, 2) column, row
    degrees: Array  # (n, 2) longitude, latitude in WGS84
    unused: tuple[str, ...] = ()  # ids that only one of two files has


def load_control_points(points: PathLike, survey: PathLike | None) -> ControlPoints:
    """Load marks (CSV ``id,column,row``) with their survey, or a ``.points`` file of QGIS alone.

    Raises SurveyError.
    """
    if survey is None:
        return _qgis(points)
    text = read_text(points, SurveyError)
    rows = _csv_rows(points, text, _MARK_COLUMNS, lambda n, *uv: (_name(n), _finite(*uv)))
    _refuse_repeated(points, [name for name, _ in rows])
    marks, places = dict(rows), {point.id: point for point in load_survey(survey)}
    used = [name for name in marks if name in places]
    if not used:
        raise SurveyError(f"{points}: none of its ids is in {survey}")
    radians = [(places[name].longitude_rad, places[name].latitude_rad) for name in used]
    unused = [name for name in [*marks, *places] if not (name in marks and name in places)]
    pixels = np.array([marks[name] for name in used])
    return ControlPoints(used, downward(pixels), np.degrees(radians), tuple(unused))


def downward(pixels: Array) -> Array:
    """Return pixels (n, 2), rows counted downwards; QGIS's rows are negative."""
    upward = len(pixels) > 0 and float(np.median(pixels[:, 1])) < 0
    return pixels * np.array([1.0, -1.0]) if upward else pixels


def _qgis(path: PathLike) -> ControlPoints:
    lines = read_text(path, SurveyError).splitlines()
    check_rows(path, len(lines))
    crs = next((line.partition(":")[2].strip() for line in lines if line.startswith("#CRS:")), "")
    reader = csv.DictReader(line for line in lines if not line.startswith("#"))
    if not {*_QGIS_COLUMNS} <= {*(reader.fieldnames or ())}:
        raise SurveyError(
            f"{path}: not a .points file of QGIS ({','.join(_QGIS_COLUMNS)}); with a CSV "
            "id,column,row give --survey too"
        )
    if not crs:
        raise SurveyError(f"{path}: names no coordinate system; save it with QGIS 3.26 or later")
    points: dict[str, list[float]] = {}  # of the enabled points, by their numbers
    for number, row in enumerate(reader, 1):
        try:
            values = _finite(*(row[name] for name in _QGIS_COLUMNS))
        except (TypeError, ValueError):
            raise SurveyError(f"{path}: point {number} must have four numbers") from None
        if (row.get("enable") or "1").strip() != "0":
            points[str(number)] = values
    table = np.array(list(points.values()), float).reshape(-1, 4)
    flat = np.column_stack([table[:, :2], np.zeros(len(table))])
    degrees, _ = to_wgs84(flat, crs, str(path))
    if not np.isfinite(degrees).all() or (np.abs(degrees[:, 1]) > 90).any():
        raise SurveyError(f"{path}: a point is outside its system {crs[:40]}")
    return ControlPoints(list(points), downward(table[:, 2:]), degrees[:, :2])
