"""Write located points as GeoJSON, KML and Cursor-on-Target."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located, Refusal

#: Corners of an ellipse as a polygon: it lies within 0.15 % of the curve.
_CORNERS = 60
_KML = "http://www.opengis.net/kml/2.2"
#: Cursor-on-Target: an unknown object on the ground, found by fused sensors.
_COT_TYPE, _COT_HOW = "a-u-G", "m-f"
_COT_STALE = timedelta(days=1)
_NUMBERS = (
    "height_m",
    "sigma_north_m",
    "sigma_east_m",
    "sigma_height_m",
    "ellipse_major_m",
    "ellipse_minor_m",
    "ellipse_azimuth_deg",
)


class Answered(NamedTuple):
    """Hold a pixel of a list and its located point or refusal."""

    id: str
    answer: Located | Refusal


def geojson(answers: Sequence[Answered]) -> str:
    """Return a FeatureCollection: a point for each pixel in their order, then the ellipses.

    ``kind`` is ``point`` or ``ellipse`` (of 95 %, a polygon). A refused pixel is a point without
    geometry; ``reason`` tells why. Sigmas are one standard deviation.
    """
    features = [_point_feature(one) for one in answers]
    features += [_ellipse_feature(name, found) for name, found in _found(answers)]
    document = {"type": "FeatureCollection", "features": features}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def kml(answers: Sequence[Answered]) -> str:
    """Return KML: each point with its ellipse, on the ground; a refused pixel's name and reason.

    KML's own heights are above sea level, so the ellipsoidal height is a property of the point.
    """
    root = ET.Element("kml", xmlns=_KML)
    document = ET.SubElement(root, "Document")
    for name, answer in answers:
        mark = ET.SubElement(document, "Placemark")
        _child(mark, "name", name)
        _child(mark, "description", _words(answer))
        if isinstance(answer, Located):
            _child(ET.SubElement(mark, "TimeStamp"), "when", _utc(answer.stamp_ns))
        extended = ET.SubElement(mark, "ExtendedData")
        for key, value in _properties(name, answer).items():
            if value is not None:
                _child(ET.SubElement(extended, "Data", name=key), "value", str(value))
        if isinstance(answer, Located):
            _add_kml_shapes(mark, answer)
    return _xml(root)


def _add_kml_shapes(mark: ET.Element, found: Located) -> None:
    both = ET.SubElement(mark, "MultiGeometry")
    point = ET.SubElement(both, "Point")
    _child(point, "coordinates", "{:.9f},{:.9f}".format(*_longitude_latitude(found)))
    polygon = ET.SubElement(both, "Polygon")
    outer = ET.SubElement(polygon, "outerBoundaryIs")
    ring = " ".join(f"{lon:.9f},{lat:.9f}" for lon, lat in _ring(found))
    _child(ET.SubElement(outer, "LinearRing"), "coordinates", ring)


def cot(answers: Sequence[Answered]) -> str:
    """Return Cursor-on-Target 2.0: one ``event`` for a located point, in a root ``events``.

    ``hae`` is the ellipsoidal height. As the event schema defines them, ``ce`` and ``le`` are one
    standard deviation: of the position along the ellipse's longer axis, and of the height. The
    time is the picture's; an event is stale a day later.
    """
    root = ET.Element("events")
    for name, found in _found(answers):
        uid = _printable(f"tirgeo.{name}.{found.stamp_ns}")
        event = ET.SubElement(root, "event", version="2.0", uid=uid)
        event.attrib |= {"type": _COT_TYPE, "how": _COT_HOW}
        event.attrib |= {"time": _utc(found.stamp_ns), "start": _utc(found.stamp_ns)}
        event.attrib["stale"] = _utc(found.stamp_ns, _COT_STALE)
        ET.SubElement(event, "point", _cot_point(found))
        detail = ET.SubElement(event, "detail")
        ET.SubElement(detail, "contact", callsign=_printable(name))
        _child(detail, "remarks", _words(found))
    return _xml(root)


def _cot_point(found: Located) -> dict[str, str]:
    longitude, latitude = _longitude_latitude(found)
    along = float(np.linalg.eigvalsh(found.covariance_n[:2, :2])[-1])
    return {
        "lat": f"{latitude:.9f}",
        "lon": f"{longitude:.9f}",
        "hae": f"{found.height_m:.3f}",
        "ce": f"{math.sqrt(along):.3f}",
        "le": f"{math.sqrt(float(found.covariance_n[2, 2])):.3f}",
    }


def _found(answers: Sequence[Answered]) -> Iterator[tuple[str, Located]]:
    for name, answer in answers:
        if isinstance(answer, Located):
            yield name, answer


def _point_feature(one: Answered) -> dict[str, Any]:
    geometry = None
    if isinstance(one.answer, Located):
        coordinates = [*_longitude_latitude(one.answer), round(one.answer.height_m, 4)]
        geometry = {"type": "Point", "coordinates": coordinates}
    properties = {"kind": "point"} | _properties(*one)
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _ellipse_feature(name: str, found: Located) -> dict[str, Any]:
    properties = {"kind": "ellipse", "id": name, "stamp_ns": found.stamp_ns, "share": 0.95}
    geometry = {"type": "Polygon", "coordinates": [_ring(found)]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _properties(name: str, answer: Located | Refusal) -> dict[str, Any]:
    """Return the properties of a pixel, for every format; None for what a refusal lacks."""
    known: dict[str, Any] = {"id": name, "stamp_ns": answer.stamp_ns}
    known |= {"u": answer.uv[0], "v": answer.uv[1]}
    if isinstance(answer, Refusal):
        return known | dict.fromkeys(_NUMBERS) | {"reason": answer.reason.value}
    sigmas = np.sqrt(answer.covariance_n.diagonal()).tolist()
    major_m, minor_m, azimuth_rad = answer.ellipse
    numbers = (answer.height_m, *sigmas, major_m, minor_m, math.degrees(azimuth_rad))
    rounded = {key: round(x, 4) for key, x in zip(_NUMBERS, numbers, strict=True)}
    return known | rounded | {"reason": None}


def _words(answer: Located | Refusal) -> str:
    """Describe the answer for a person."""
    if isinstance(answer, Refusal):
        return f"not located: {answer.reason.value}"
    ellipse = answer.ellipse
    return (
        f"95 % within {ellipse.major_m:.2f} x {ellipse.minor_m:.2f} m (semi-axes), the longer "
        f"towards {math.degrees(ellipse.azimuth_rad):.0f} deg; {answer.height_m:.2f} m above the "
        "ellipsoid"
    )


def _longitude_latitude(found: Located) -> tuple[float, float]:
    """Return longitude and latitude in degrees, to a tenth of a millimetre."""
    return (
        round(math.degrees(found.longitude_rad), 9),
        round(math.degrees(found.latitude_rad), 9),
    )


def _ring(found: Located) -> list[list[float]]:
    """Return the ellipse's corners, longitude and latitude in deg, anticlockwise and closed."""
    ellipse = found.ellipse
    turn = np.linspace(0, -2 * math.pi, _CORNERS + 1)
    along, across = ellipse.major_m * np.cos(turn), ellipse.minor_m * np.sin(turn)
    cos, sin = math.cos(ellipse.azimuth_rad), math.sin(ellipse.azimuth_rad)
    corners_n = np.stack([along * cos - across * sin, along * sin + across * cos, 0 * turn], -1)
    corners_n[-1] = corners_n[0]
    around = TangentPlane(found.latitude_rad, found.longitude_rad, found.height_m)
    latitude, longitude, _ = around.geodetic_from_ned(corners_n)
    return np.round(np.degrees(np.stack([longitude, latitude], -1)), 9).tolist()  # type: ignore[no-any-return]


def _utc(stamp_ns: int, later: timedelta = timedelta()) -> str:
    """Return ISO 8601 to a millisecond, rounded down."""
    since = timedelta(milliseconds=stamp_ns // 1_000_000) + later
    moment = datetime(1970, 1, 1, tzinfo=timezone.utc) + since
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


def _child(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = _printable(text)


def _printable(text: str) -> str:
    """Return the text without the characters that XML does not allow."""
    return "".join(letter for letter in text if letter.isprintable())


def _xml(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"
