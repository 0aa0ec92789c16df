"""Write rows as KML, GPX and Cursor-on-Target, with texts that no reader takes for markup."""

from __future__ import annotations

import html
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.cot.target_events import target_event
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.properties import Row, legible, of_answers, utc

_KML = "http://www.opengis.net/kml/2.2"
_GPX = "http://www.topografix.com/GPX/1/1"
#: Colours in KML are alpha, blue, green, red.
_LINE = "ffff50ff"
#: Some readers of GPX show its texts as HTML, others as they are.
_NO_TAGS = str.maketrans("<>", "\u2039\u203a")


def kml(rows: Sequence[Row]) -> str:
    """Return KML: each point with its ellipse, on the ground; a refused pixel's name and reason.

    KML's own heights are above sea level, so the ellipsoidal height is a property of the point.
    """
    root = ET.Element("kml", xmlns=_KML)
    document = ET.SubElement(root, "Document")
    style = ET.SubElement(document, "Style", id="target")
    _child(ET.SubElement(style, "LineStyle"), "color", _LINE)
    _child(ET.SubElement(style, "PolyStyle"), "fill", "0")
    # Balloons show HTML: this one shows the description alone, where all texts are escaped.
    _child(ET.SubElement(style, "BalloonStyle"), "text", "$[description]")
    for row in rows:
        _add_placemark(document, row)
    return _xml(root)


def _add_placemark(document: ET.Element, row: Row) -> None:
    mark = ET.SubElement(document, "Placemark")
    name = row.target.title if row.target else row.properties["id"]
    _child(mark, "name", name)
    texts = (name, row.properties.get("note"), row.words)
    _child(mark, "description", "<br>".join(html.escape(text) for text in texts if text))
    if row.target:
        _child(ET.SubElement(mark, "TimeStamp"), "when", utc(row.target.place.stamp_ns))
    _child(mark, "styleUrl", "#target")
    extended = ET.SubElement(mark, "ExtendedData")
    for key, value in row.properties.items():
        if value is not None:
            text = str(value).lower() if isinstance(value, bool) else str(value)
            _child(ET.SubElement(extended, "Data", name=key), "value", text)
    if row.target:
        _add_kml_shapes(mark, row.target.place)


def _add_kml_shapes(mark: ET.Element, place: Located) -> None:
    both = ET.SubElement(mark, "MultiGeometry")
    point = ET.SubElement(both, "Point")
    _child(point, "coordinates", f"{place.longitude_deg:.9f},{place.latitude_deg:.9f}")
    outer = ET.SubElement(ET.SubElement(both, "Polygon"), "outerBoundaryIs")
    ring = " ".join(f"{longitude:.9f},{latitude:.9f}" for latitude, longitude in place.outline())
    _child(ET.SubElement(outer, "LinearRing"), "coordinates", ring)


def gpx(rows: Sequence[Row]) -> str:
    """Return GPX 1.1 with a waypoint for each target; refused pixels are left out.

    Waypoints have no ``ele``: readers take it as above sea level, and the height here is above the
    ellipsoid. The description says it.
    """
    root = ET.Element("gpx", version="1.1", creator="tirgeo", xmlns=_GPX)
    for row in rows:
        if row.target:
            _add_waypoint(root, row.target, row.words)
    return _xml(root)


def _add_waypoint(root: ET.Element, target: Target, words: str) -> None:
    """Add a waypoint; the schema fixes the order of its children."""
    place = target.place
    longitude = -180.0 if place.longitude_deg == 180 else place.longitude_deg  # below 180 there
    where = {"lat": f"{place.latitude_deg:.9f}", "lon": f"{longitude:.9f}"}
    point = ET.SubElement(root, "wpt", where)
    _child(point, "time", utc(place.stamp_ns))
    _child(point, "name", target.title.translate(_NO_TAGS))
    text = f"{target.note}; {words}" if target.note else words
    for tag in ("cmt", "desc"):  # devices show the one, programs the other
        _child(point, tag, text.translate(_NO_TAGS))
    _child(point, "type", target.kind)


def cot(answers: Sequence[Answered]) -> str:
    """Return Cursor-on-Target 2.0: an ``event`` for each located point, in a root ``events``.

    The events are those of targets, as the operator's page sends them; the time is the picture's.
    """
    root = ET.Element("events")
    targets = [row.target for row in of_answers(answers) if row.target is not None]
    root.extend([target_event(target, target.changed_ns) for target in targets])
    return _xml(root)


def _child(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = _printable(text)


def _printable(text: str) -> str:
    """Return the text without the characters that XML does not allow, on one line."""
    return legible(text).replace("\n", " ")


def _xml(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"
