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
"""Write targets, and the pixels of ``tirgeo locate``, in the formats of other programs."""

from __future__ import annotations

import contextlib
import html
import json
import re
import sqlite3
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from tirgeo_ros.core.targets.target import COLOURS, Target
from tirgeo_ros.core.types.texts import legible, utc
from tirgeo_ros.io.files.whole_files import PathLike, csv_text
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.columns import COLUMNS, Row, answer_rows, target_rows
from tirgeo_ros.io.targets.cot_events import target_event
from tirgeo_ros.io.targets.geopackage import (
    explained,
    make_tables,
    put_picture,
    put_target,
    transaction,
)

#: Returns the picture (JPEG) of the target with an id, or None.
Pictures = Callable[[str], bytes | None]
#: Beginnings of cells, by any separator, that a spreadsheet computes; an apostrophe prevents it.
_FORMULA = re.compile(r"""(^|[;|\t\n])(?=['" ]*[=+\-@\t\r])""")
_KML, _GPX = "http://www.opengis.net/kml/2.2", "http://www.topografix.com/GPX/1/1"
#: Some readers of GPX show its texts as HTML, others as they are.
_NO_TAGS = str.maketrans("<>", "\u2039\u203a")


def geojson(rows: Sequence[Row]) -> str:
    """Return a FeatureCollection: a point for each row in their order, then the ellipses.

    ``kind`` is ``point`` or ``ellipse`` (of 95 %, a polygon); a target's own kind is
    ``target_kind``. A refused pixel is a point without geometry; ``reason`` says why.
    """
    points, ellipses = [], []
    for cells, target, _ in rows:
        point = {"type": "Feature", "properties": {"kind": "point"} | cells, "geometry": None}
        points.append(point)
        if target:
            place = [cells["longitude_deg"], cells["latitude_deg"], cells["height_m"]]
            point["geometry"] = {"type": "Point", "coordinates": place}
            ring = [[longitude, latitude] for latitude, longitude in target.place.outline()]
            own = {key: cells[key] for key in ("id", "stamp_ns")}
            properties = {"kind": "ellipse"} | own | {"share": 0.95}
            geometry = {"type": "Polygon", "coordinates": [ring]}
            ellipses.append({"type": "Feature", "properties": properties, "geometry": geometry})
    document = {"type": "FeatureCollection", "features": points + ellipses}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def table(rows: Sequence[Row]) -> str:
    """Return CSV, a line for each row, with the mark by which Excel recognises UTF-8."""
    header = list(rows[0].cells) if rows else list(COLUMNS)
    return "\ufeff" + csv_text([header, *(map(_cell, row.cells.values()) for row in rows)])


def _cell(value: object) -> object:
    """Return a value as text; one that a spreadsheet would compute gets an apostrophe."""
    if isinstance(value, str):
        value = value.replace("\r\n", "\n").replace("\r", "\n").replace("\0", "")
        return _FORMULA.sub(r"\1'", value)
    return str(value).lower() if isinstance(value, bool) else value


def kml(rows: Sequence[Row]) -> str:
    """Return KML: each point with its ellipse, on the ground; a refused pixel's name and reason.

    KML's own heights are above sea level, so the ellipsoidal height is a property of the point.
    """
    styles = [_style(kind, colour) for kind, colour in COLOURS.items()]
    return _xml(_node("kml", _node("Document", *styles, *map(_placemark, rows)), xmlns=_KML))


def _style(kind: str, colour: str) -> ET.Element:
    red, green, blue = colour[1:3], colour[3:5], colour[5:]
    own = f"ff{blue}{green}{red}"  # KML's colours are alpha, blue, green, red
    return _node(
        "Style",
        _node("IconStyle", _node("color", own)),
        _node("LineStyle", _node("color", own)),
        _node("PolyStyle", _node("fill", "0")),
        # Balloons show HTML: this one shows the description alone, where all texts are escaped.
        _node("BalloonStyle", _node("text", "$[description]")),
        id=kind,
    )


def _placemark(row: Row) -> ET.Element:
    name = row.target.title if row.target else row.cells["id"]
    texts = (name, row.cells.get("note"), row.words)
    description = "<br>".join(html.escape(text) for text in texts if text)
    values = {
        key: str(value).lower() if isinstance(value, bool) else str(value)
        for key, value in row.cells.items()
        if value is not None
    }
    data = [_node("Data", _node("value", text), name=key) for key, text in values.items()]
    mark = _node("Placemark", _node("name", name), _node("description", description))
    if row.target:
        mark.append(_node("TimeStamp", _node("when", utc(row.target.place.stamp_ns))))
    kind = row.target.kind if row.target else "other"
    mark.extend([_node("styleUrl", f"#{kind}"), _node("ExtendedData", *data)])
    if row.target:
        place = row.target.place
        point = f"{place.longitude_deg:.9f},{place.latitude_deg:.9f}"
        ring = " ".join(f"{lon:.9f},{lat:.9f}" for lat, lon in place.outline())
        outer = _node("outerBoundaryIs", _node("LinearRing", _node("coordinates", ring)))
        shapes = _node("Point", _node("coordinates", point)), _node("Polygon", outer)
        mark.append(_node("MultiGeometry", *shapes))
    return mark


def gpx(rows: Sequence[Row]) -> str:
    """Return GPX 1.1 with a waypoint for each target; refused pixels are left out.

    Waypoints have no ``ele``: readers take it as above sea level, and the height here is above the
    ellipsoid. The description gives it.
    """
    points = [_waypoint(row.target, row.words) for row in rows if row.target]
    return _xml(_node("gpx", *points, version="1.1", creator="tirgeo", xmlns=_GPX))


def _waypoint(target: Target, words: str) -> ET.Element:
    """Return a waypoint; its schema fixes the order of children, and excludes 180 deg."""
    place = target.place
    longitude = -180.0 if place.longitude_deg == 180 else place.longitude_deg
    text = (f"{target.note}; {words}" if target.note else words).translate(_NO_TAGS)
    return _node(
        "wpt",
        _node("time", utc(place.stamp_ns)),
        _node("name", target.title.translate(_NO_TAGS)),
        *(_node("cmt", text), _node("desc", text)),  # devices show the first, programs the second
        _node("type", target.kind),
        lat=f"{place.latitude_deg:.9f}",
        lon=f"{longitude:.9f}",
    )


def cot(rows: Sequence[Row]) -> str:
    """Return Cursor-on-Target 2.0: ``events`` with an ``event`` for each target's last change."""
    targets = [row.target for row in rows if row.target is not None]
    return _xml(_node("events", *(target_event(each, each.changed_ns) for each in targets)))


def _node(_tag: str, *content: ET.Element | str, **attributes: str) -> ET.Element:
    """Return an element with children, or with a text as XML allows it, on one line."""
    node = ET.Element(_tag, attributes)
    for part in content:
        if isinstance(part, str):
            node.text = legible(part).replace("\n", " ")
        else:
            node.append(part)
    return node


def _xml(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def geopackage(rows: Sequence[Row], picture: Pictures = lambda _: None) -> bytes:
    """Return a GeoPackage as TargetStore keeps it; refused pixels are left out."""
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


#: The writer of each format, by the ending of the file's name.
FORMATS: Mapping[str, Callable[[Sequence[Row]], str | bytes]] = {
    "geojson": geojson,
    "kml": kml,
    "gpx": gpx,
    "csv": table,
    "gpkg": geopackage,
    "xml": cot,
}


def exported(targets: Sequence[Target], form: str, picture: Pictures | None = None) -> bytes:
    """Return targets in one of FORMATS; a GeoPackage has their pictures. Raises TargetError."""
    if form == "gpkg" and picture:
        return geopackage(target_rows(targets), picture)
    return _encoded(form, target_rows(targets))


def exported_answers(answers: Sequence[Answered], form: str) -> bytes:
    """Return the pixels of ``tirgeo locate``; only GeoJSON, KML and CSV keep refused ones."""
    return _encoded(form, answer_rows(answers))


def form_of(path: PathLike) -> str:
    """Return the format that a file's name asks for; GeoJSON for any other name."""
    ending = Path(path).suffix.lower().removeprefix(".")
    return ending if ending in FORMATS else "geojson"


def _encoded(form: str, rows: Sequence[Row]) -> bytes:
    content = FORMATS[form](rows)
    return content if isinstance(content, bytes) else content.encode(errors="backslashreplace")
