"""Write targets, and the pixels that ``tirgeo locate`` located, in the formats of others."""

from __future__ import annotations

import contextlib
import json
import re
import sqlite3
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.files.whole_files import PathLike, csv_text
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.geopackage import make_tables, put_picture, put_target
from tirgeo_ros.io.targets.properties import COLUMNS, Row, of_answers, of_targets
from tirgeo_ros.io.targets.target_file import explained, transaction
from tirgeo_ros.io.targets.xml_formats import gpx, kml

#: Returns the JPEG of a target's id, or None.
Pictures = Callable[[str], bytes | None]
#: Where a spreadsheet would compute, in cells by any separator; an apostrophe makes them texts.
_FORMULA = re.compile(r"""(^|[;|\t\n])(?=['" ]*[=+\-@\t\r])""")
#: By this Excel knows UTF-8.
_MARK = "\ufeff"


def geojson(rows: Sequence[Row]) -> str:
    """Return a FeatureCollection: a point for each row in their order, then the ellipses.

    ``kind`` is ``point`` or ``ellipse`` (of 95 %, a polygon); a target's own kind is
    ``target_kind``. A refused pixel is a point without geometry; ``reason`` tells why.
    """
    features = [_point_feature(row) for row in rows]
    features += [_ellipse_feature(row, row.target) for row in rows if row.target]
    document = {"type": "FeatureCollection", "features": features}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _point_feature(row: Row) -> dict[str, Any]:
    said, geometry = row.properties, None
    if row.target:
        coordinates = [said["longitude_deg"], said["latitude_deg"], said["height_m"]]
        geometry = {"type": "Point", "coordinates": coordinates}
    return {"type": "Feature", "properties": {"kind": "point"} | said, "geometry": geometry}


def _ellipse_feature(row: Row, target: Target) -> dict[str, Any]:
    said = {key: row.properties[key] for key in ("id", "stamp_ns")}
    ring = [[longitude, latitude] for latitude, longitude in target.place.outline()]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    properties = {"kind": "ellipse"} | said | {"share": 0.95}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def table(rows: Sequence[Row]) -> str:
    """Return CSV, a line for each row, with a mark by which Excel knows UTF-8."""
    header = list(rows[0].properties) if rows else list(COLUMNS)
    return _MARK + csv_text([header, *(map(_cell, row.properties.values()) for row in rows)])


def _cell(value: object) -> object:
    """Return a value as text; one that a spreadsheet would compute gets an apostrophe."""
    if isinstance(value, str):
        value = value.replace("\r\n", "\n").replace("\r", "\n").replace("\0", "")
        return _FORMULA.sub(r"\1'", value)
    return str(value).lower() if isinstance(value, bool) else value


def geopackage(rows: Sequence[Row], picture: Pictures = lambda _: None) -> bytes:
    """Return a GeoPackage as TargetStore keeps it; refused pixels have no place there."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "targets.gpkg"
        with explained(path), contextlib.closing(sqlite3.connect(path)) as db:
            db.isolation_level = None
            db.execute("PRAGMA synchronous = OFF")
            with transaction(db):
                make_tables(db)
                for row in rows:
                    if row.target:
                        put_target(db, row.target)
                        if jpeg := picture(row.target.id):
                            put_picture(db, row.target.id, jpeg)
        return path.read_bytes()


class Form(NamedTuple):
    """Hold a format: how it is written, and its media type."""

    write: Callable[[Sequence[Row]], str | bytes]
    media_type: str


#: By the ending of the file's name.
FORMATS = {
    "geojson": Form(geojson, "application/geo+json"),
    "kml": Form(kml, "application/vnd.google-earth.kml+xml"),
    "gpx": Form(gpx, "application/gpx+xml"),
    "csv": Form(table, "text/csv; charset=utf-8"),
    "gpkg": Form(geopackage, "application/geopackage+sqlite3"),
}


def exported(targets: Sequence[Target], form: str, picture: Pictures | None = None) -> bytes:
    """Return targets in one of FORMATS; a GeoPackage has their pictures, as ``store.picture``.

    Raises TargetError if there is no room on the disk (GeoPackage).
    """
    if form == "gpkg" and picture:
        return geopackage(of_targets(targets), picture)
    return _encoded(FORMATS[form], of_targets(targets))


def exported_answers(answers: Sequence[Answered], form: str) -> bytes:
    """Return the pixels of ``tirgeo locate``; refused ones stay in GeoJSON, KML and CSV."""
    return _encoded(FORMATS[form], of_answers(answers))


def form_of(path: PathLike) -> str:
    """Return the format that a file's name asks for; GeoJSON for any other name."""
    ending = Path(path).suffix.lower().removeprefix(".")
    return ending if ending in FORMATS else "geojson"


def _encoded(form: Form, rows: Sequence[Row]) -> bytes:
    content = form.write(rows)
    return content if isinstance(content, bytes) else content.encode(errors="backslashreplace")
