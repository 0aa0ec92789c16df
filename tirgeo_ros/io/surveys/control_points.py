"""Read control points of a picture: pixels with the ground positions that they show.

Pixels are columns and rows from the top left corner of the picture. QGIS counts rows upwards
(below zero); their sign is changed.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.coordinates.crs import to_wgs84
from tirgeo_ros.io.files.text_file import read_text
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.surveys.survey import check_rows, load_marks, load_survey

_QGIS_X, _QGIS_Y = ("mapX", "mapY")
_QGIS_PIXELS = (("sourceX", "sourceY"), ("pixelX", "pixelY"))  # of now and of QGIS before 3.26


@dataclass(frozen=True, slots=True)
class ControlPoints:
    """Hold points (n) in the order of their file."""

    names: list[str]
    pixels: Array  # (n, 2) column, row
    degrees: Array  # (n, 2) longitude, latitude in WGS84
    unused: tuple[str, ...] = ()  # those that only one of two files has


def load_control_points(
    points: PathLike, survey: PathLike | None, points_crs: str | None
) -> ControlPoints:
    """Load marks (CSV ``id,column,row``) with their survey, or a ``.points`` file of QGIS alone.

    ``points_crs`` is the system of a ``.points`` file, else it is the one that the file names.
    Raises SurveyError.
    """
    if survey is not None:
        return _matched(points, survey)
    return _qgis(points, points_crs)


def downward(pixels: Array) -> Array:
    """Return pixels (n, 2) with rows that grow downwards.

    QGIS's are below zero and grow upwards.
    """
    upward = len(pixels) > 0 and float(np.median(pixels[:, 1])) < 0
    return pixels * np.array([1.0, -1.0]) if upward else pixels


def _matched(points: PathLike, survey: PathLike) -> ControlPoints:
    marks = {mark.id: mark for mark in load_marks(points)}
    places = {point.id: point for point in load_survey(survey)}
    used = [name for name in marks if name in places]
    if not used:
        raise SurveyError(f"{points}: none of its ids is in {survey}")
    radians = [(places[name].longitude_rad, places[name].latitude_rad) for name in used]
    pixels = np.array([(marks[name].column, marks[name].row) for name in used])
    unused = [name for name in [*marks, *places] if not (name in marks and name in places)]
    return ControlPoints(used, downward(pixels), np.degrees(radians), tuple(unused))


def _qgis(path: PathLike, points_crs: str | None) -> ControlPoints:
    lines = read_text(path, SurveyError).splitlines()
    check_rows(path, len(lines))
    comments = [line for line in lines if line.startswith("#")]
    named = [line.partition(":")[2].strip() for line in comments if line.startswith("#CRS:")]
    crs = points_crs or (named[0] if named else "")
    rows = _rows(path, [line for line in lines if not line.startswith("#")])
    if not crs:
        raise SurveyError(
            f"{path}: names no coordinate reference system; give --points-crs (EPSG code)"
        )
    values = np.array(list(rows.values()), float).reshape(-1, 4)
    flat = np.column_stack([values[:, :2], np.zeros(len(values))])
    degrees, _ = to_wgs84(flat, crs, str(path))
    if not np.isfinite(degrees).all() or (np.abs(degrees[:, 1]) > 90).any():
        raise SurveyError(f"{path}: a point is not a place in {crs[:40]}")
    return ControlPoints(list(rows), downward(values[:, 2:]), degrees[:, :2])


def _rows(path: PathLike, lines: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Return easting, northing, column, row of the enabled points, by their numbers."""
    reader = csv.DictReader(lines)
    header = reader.fieldnames or ()
    pixels = next((pair for pair in _QGIS_PIXELS if set(pair) <= set(header)), None)
    if pixels is None or not {_QGIS_X, _QGIS_Y} <= set(header):
        raise SurveyError(
            f"{path}: not a .points file of QGIS (mapX,mapY,sourceX,sourceY); "
            "with a CSV id,column,row give --survey too"
        )
    found: dict[str, tuple[float, ...]] = {}
    for number, row in enumerate(reader, 1):
        try:
            values = tuple(float(row[name]) for name in (_QGIS_X, _QGIS_Y, *pixels))
        except (TypeError, ValueError):
            values = (math.nan,)
        if not all(map(math.isfinite, values)):
            raise SurveyError(f"{path}: point {number} is not four numbers")
        if (row.get("enable") or "1").strip() != "0":
            found[str(number)] = values
    return found
