"""Read and write surveyed ground points and their observations in pictures."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.files.text_file import read_text
from tirgeo_ros.io.files.whole_files import csv_text, write_files

T = TypeVar("T")

_SURVEY_COLUMNS = ("id", "lat", "lon", "h")
_OBSERVATION_COLUMNS = ("id", "stamp_ns", "u", "v")
_MARK_COLUMNS = ("id", "column", "row")
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


@dataclass(frozen=True, slots=True)
class Mark:
    """Hold the pixel of a ground point in one picture, for example an orthophoto."""

    id: str
    column: float  # px
    row: float  # px


def load_survey(path: str | os.PathLike[str]) -> list[SurveyPoint]:
    """Load points of a GeoJSON file with property ``id``, or of a CSV file ``id,lat,lon,h``.

    Latitude and longitude are WGS84 degrees in the file. Raises SurveyError naming file and place.
    """
    text = read_text(path, SurveyError)
    if text.lstrip().startswith(("{", "[")):
        points = _geojson_points(path, text)
    else:
        points = _csv_rows(path, text, _SURVEY_COLUMNS, _point_of_row)
    _refuse_repeated(path, points)
    return points


def save_survey(path: str | os.PathLike[str], points: Sequence[SurveyPoint]) -> None:
    """Write points as CSV where the name ends in ``.csv``, else as GeoJSON."""
    as_csv = Path(path).suffix.lower() == ".csv"
    write_files({path: _survey_csv(points) if as_csv else _survey_geojson(points)}, SurveyError)


def load_observations(path: str | os.PathLike[str]) -> list[Observation]:
    """Load a CSV file ``id,stamp_ns,u,v``. Raises SurveyError naming file and line."""
    return _csv_rows(path, read_text(path, SurveyError), _OBSERVATION_COLUMNS, _observation_of_row)


def load_marks(path: str | os.PathLike[str]) -> list[Mark]:
    """Load a CSV file ``id,column,row``. Raises SurveyError naming file and line."""
    marks = _csv_rows(path, read_text(path, SurveyError), _MARK_COLUMNS, _mark_of_row)
    _refuse_repeated(path, marks)
    return marks


def save_observations(path: str | os.PathLike[str], observations: Sequence[Observation]) -> None:
    """Write observations as CSV, pixels to a thousandth."""
    rows = [(o.id, str(o.stamp_ns), f"{o.u:.3f}", f"{o.v:.3f}") for o in observations]
    write_files({path: csv_text([_OBSERVATION_COLUMNS, *rows])}, SurveyError)


def check_rows(path: str | os.PathLike[str], rows: int) -> None:
    """Refuse more rows than can be processed at once."""
    if rows > MOST_ROWS:
        raise SurveyError(
            f"{path}: {rows} rows, and at most {MOST_ROWS} are taken: split the file"
        )


def _geojson_points(path: str | os.PathLike[str], text: str) -> list[SurveyPoint]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise SurveyError(f"{path}: line {error.lineno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:  # for numbers and nesting without end
        raise SurveyError(f"{path}: not JSON: {error}") from None
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise SurveyError(f"{path}: no GeoJSON FeatureCollection of points")
    check_rows(path, len(features))
    return [_point_of_feature(path, number, f) for number, f in enumerate(features, 1)]


def _point_of_feature(path: str | os.PathLike[str], number: int, feature: Any) -> SurveyPoint:
    try:
        name = {"id": str(feature["properties"]["id"])}
        coordinates = {"Point": feature["geometry"]["coordinates"]}[feature["geometry"]["type"]]
        longitude, latitude, height = (float(x) for x in coordinates[:3])
        return _point(_name(name), latitude, longitude, height)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise SurveyError(
            f"{path}: feature {number} is no Point with longitude, latitude, height and a "
            "property id"
        ) from None


def _csv_rows(
    path: str | os.PathLike[str],
    text: str,
    columns: tuple[str, ...],
    made: Callable[[dict[str, str]], T],
) -> list[T]:
    return list(_each_row(path, text, columns, made))


def _each_row(
    path: str | os.PathLike[str],
    text: str,
    columns: tuple[str, ...],
    made: Callable[[dict[str, str]], T],
) -> Iterator[T]:
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
        for row in reader:
            yield made(row)
    except (TypeError, ValueError, csv.Error):
        raise SurveyError(
            f"{path}: line {reader.line_num} does not read {','.join(columns)}"
        ) from None


def _point_of_row(row: dict[str, str]) -> SurveyPoint:
    return _point(_name(row), float(row["lat"]), float(row["lon"]), float(row["h"]))


def _observation_of_row(row: dict[str, str]) -> Observation:
    u, v, stamp_ns = float(row["u"]), float(row["v"]), int(row["stamp_ns"])
    if not (math.isfinite(u) and math.isfinite(v) and abs(stamp_ns) < 1 << 63):
        raise ValueError
    return Observation(_name(row), stamp_ns, u, v)


def _mark_of_row(row: dict[str, str]) -> Mark:
    column, line = float(row["column"]), float(row["row"])
    if not (math.isfinite(column) and math.isfinite(line)):
        raise ValueError
    return Mark(_name(row), column, line)


def _name(row: dict[str, str]) -> str:
    name = (row["id"] or "").strip()
    if not name:
        raise ValueError
    return name


def _point(name: str, latitude_deg: float, longitude_deg: float, height_m: float) -> SurveyPoint:
    """Return a point; raises ValueError for what is no place on earth."""
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180 and math.isfinite(height_m)):
        raise ValueError
    return SurveyPoint(name, math.radians(latitude_deg), math.radians(longitude_deg), height_m)


def _refuse_repeated(
    path: str | os.PathLike[str], points: Sequence[SurveyPoint] | Sequence[Mark]
) -> None:
    seen: set[str] = set()
    for point in points:
        if point.id in seen:
            raise SurveyError(f"{path}: point {point.id} stands twice; give each its own id")
        seen.add(point.id)


def _survey_csv(points: Sequence[SurveyPoint]) -> str:
    rows = [
        (p.id, _degrees(p.latitude_rad), _degrees(p.longitude_rad), f"{p.height_m:.4f}")
        for p in points
    ]
    return csv_text([_SURVEY_COLUMNS, *rows])


def _survey_geojson(points: Sequence[SurveyPoint]) -> str:
    features = [
        {
            "type": "Feature",
            "properties": {"id": p.id},
            "geometry": {
                "type": "Point",
                "coordinates": [
                    float(_degrees(p.longitude_rad)),
                    float(_degrees(p.latitude_rad)),
                    round(p.height_m, 4),
                ],
            },
        }
        for p in points
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"


def _degrees(angle_rad: float) -> str:
    """Return degrees with ten decimals: a hundredth of a millimetre on the ground."""
    return f"{math.degrees(angle_rad):.10f}"
