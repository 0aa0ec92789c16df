"""Export the flight for a GIS: what each picture shows, the track, and the targets."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import azimuth_row, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.camera_place import body_rpy, camera_heading_rad, height_above_m
from tirgeo_ros.core.ground.frame_geometry import Sight, footprint, frame_geometry
from tirgeo_ros.core.map.visibility import farthest_m
from tirgeo_ros.core.overlay.scale_bar_compass import ground_sample_m
from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.geopackage.layers import Layer, LayerFile
from tirgeo_ros.io.targets.formats import read_targets
from tirgeo_ros.io.targets.geopackage import ELLIPSES, TARGETS, rows_of_target
from tirgeo_ros.tools.export.frames import ExportFrame

_HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
_FIELD = "2"  # the kind of a property that is read from a field


@dataclass(frozen=True)
class Symbol:
    """Define a symbol: ``kind`` is marker, line or fill, ``drawn`` the class that draws it.

    ``angle_field`` names the field by which a marker is turned, deg, clockwise.
    """

    kind: str
    drawn: str
    properties: Mapping[str, str]
    angle_field: str = ""


def marker(shape: str, colour: str, size_mm: float, angle_field: str = "") -> Symbol:
    """Return a marker; ``colour`` is red, green, blue, alpha (0 to 255, by commas)."""
    properties = {
        "name": shape,
        "color": colour,
        "outline_color": "35,35,35,255",
        "outline_width": "0.2",
        "outline_width_unit": "MM",
        "size": f"{size_mm:g}",
        "size_unit": "MM",
        "angle": "0",
        "scale_method": "diameter",
    }
    return Symbol("marker", "SimpleMarker", properties, angle_field)


def line(colour: str, width_mm: float) -> Symbol:
    """Return a solid line."""
    properties = {
        "line_color": colour,
        "line_width": f"{width_mm:g}",
        "line_width_unit": "MM",
        "line_style": "solid",
        "capstyle": "round",
        "joinstyle": "round",
    }
    return Symbol("line", "SimpleLine", properties)


def area(colour: str, rim: str, width_mm: float) -> Symbol:
    """Return an area with its rim."""
    properties = {
        "color": colour,
        "style": "solid",
        "outline_color": rim,
        "outline_width": f"{width_mm:g}",
        "outline_width_unit": "MM",
        "outline_style": "solid",
        "joinstyle": "miter",
    }
    return Symbol("fill", "SimpleFill", properties)


def single(symbol: Symbol, label: str = "") -> str:
    """Return the QML of a layer with one symbol; ``label`` is an expression, "" for none."""
    root = _root(label)
    renderer = _renderer(root, "singleSymbol")
    _add_symbol(ET.SubElement(renderer, "symbols"), "0", symbol)
    return _text(root, label)


def by_value(column: str, symbols: Mapping[str, Symbol], label: str = "") -> str:
    """Return the QML of a layer whose symbols follow a column's values."""
    root = _root(label)
    renderer = _renderer(root, "categorizedSymbol")
    renderer.set("attr", column)
    categories, drawn = (ET.SubElement(renderer, one) for one in ("categories", "symbols"))
    for number, (value, symbol) in enumerate(symbols.items()):
        said = {"value": value, "label": value, "symbol": str(number), "render": "true"}
        ET.SubElement(categories, "category", said)
        _add_symbol(drawn, str(number), symbol)
    return _text(root, label)


def _root(label: str) -> ET.Element:
    shown = {"version": "3.4.0", "styleCategories": "Symbology|Labeling"}
    return ET.Element("qgis", shown | {"labelsEnabled": "1" if label else "0"})


def _renderer(root: ET.Element, kind: str) -> ET.Element:
    plain = {"symbollevels": "0", "enableorderby": "0", "forceraster": "0"}
    return ET.SubElement(root, "renderer-v2", {"type": kind} | plain)


def _add_symbol(parent: ET.Element, name: str, symbol: Symbol) -> None:
    said = {"name": name, "type": symbol.kind, "alpha": "1", "clip_to_extent": "1"}
    own = ET.SubElement(parent, "symbol", said)
    drawn = {"class": symbol.drawn, "pass": "0", "locked": "0", "enabled": "1"}
    layer = ET.SubElement(own, "layer", drawn)
    options = _option_map(layer)
    for key, value in symbol.properties.items():
        _option(options, key, "QString", value)
        ET.SubElement(layer, "prop", {"k": key, "v": value})
    if symbol.angle_field:
        _add_angle(layer, symbol.angle_field)


def _add_angle(layer: ET.Element, column: str) -> None:
    """Let a column's value turn the marker."""
    collection = _option_map(ET.SubElement(layer, "data_defined_properties"))
    _option(collection, "name", "QString", "")
    properties = _option_map(collection, "properties")
    angle = _option_map(properties, "angle")
    _option(angle, "active", "bool", "true")
    _option(angle, "field", "QString", column)
    _option(angle, "type", "int", _FIELD)
    _option(collection, "type", "QString", "collection")


def _option_map(parent: ET.Element, name: str = "") -> ET.Element:
    return ET.SubElement(parent, "Option", {"type": "Map"} | ({"name": name} if name else {}))


def _option(parent: ET.Element, name: str, kind: str, value: str) -> None:
    ET.SubElement(parent, "Option", {"name": name, "type": kind, "value": value})


def _text(root: ET.Element, label: str) -> str:
    if label:
        settings = ET.SubElement(ET.SubElement(root, "labeling", type="simple"), "settings")
        said = {"fieldName": label, "isExpression": "1", "fontSize": "9", "fontSizeUnit": "Point"}
        style = ET.SubElement(settings, "text-style", said | {"textColor": "20,20,20,255"})
        halo = {"bufferDraw": "1", "bufferSize": "0.8", "bufferSizeUnits": "MM"}
        ET.SubElement(style, "text-buffer", halo | {"bufferColor": "255,255,255,255"})
        ET.SubElement(settings, "placement", {"placement": "6", "dist": "1.5", "distUnits": "MM"})
    ET.indent(root)
    return _HEAD + ET.tostring(root, "unicode")


_WHEN = {"stamp_ns": "INTEGER", "time": "DATETIME"}
_COLOURS = ("228,26,28,255", "255,127,0,255", "55,126,184,255", "0,170,200,255", "152,78,163,255")
_OTHER = "90,90,90,255"
_NAMED = """coalesce(nullif("name", ''), "number" || ' ' || "target_kind")"""

FOOTPRINTS = Layer(
    "footprints",
    "Polygon",
    {
        "picture": "INTEGER",  # its number in the flight, from 0
        **_WHEN,  # of the exposure
        "latitude_deg": "REAL",  # of the camera
        "longitude_deg": "REAL",
        "height_m": "REAL",  # ellipsoidal
        "above_ground_m": "REAL",
        "heading_deg": "REAL",  # of the view, from true north, clockwise
        "pitch_deg": "REAL",  # of the line of sight, 0 level, negative down
        "gsd_m": "REAL",  # ground that the middle pixel spans along its row
        "slant_range_m": "REAL",  # to the ground in the picture's middle
        "ce90_m": "REAL",  # of that ground point
        "le90_m": "REAL",
    },
    "what the pictures show of the ground, with where they were taken",
    single(area("255,170,0,0", "220,120,0,200", 0.3)),
)
TRACK = Layer(
    "track",
    "LineString Z",
    {"begin": "DATETIME", "end": "DATETIME", "points": "INTEGER", "length_m": "REAL"},
    "the aircraft's way, a line for each unbroken part; ellipsoidal heights",
    single(line("30,90,200,255", 0.6)),
)
TRACK_POINTS = Layer(
    "track_points",
    "Point Z",
    {
        "picture": "INTEGER",
        **_WHEN,
        "state": "TEXT",  # of the filter
        "height_m": "REAL",
        "speed_m_s": "REAL",  # in space, the mean since the point before
        "roll_deg": "REAL",  # of the aircraft
        "pitch_deg": "REAL",
        "heading_deg": "REAL",
        "sigma_north_m": "REAL",  # one standard deviation
        "sigma_east_m": "REAL",
        "sigma_height_m": "REAL",
        "sigma_heading_deg": "REAL",
    },
    "the aircraft, at its IMU, when pictures were taken; ellipsoidal heights",
    single(marker("arrow", "30,90,200,255", 3.0, angle_field="heading_deg")),
)
#: The style of each layer of targets.
_STYLES = {
    TARGETS.name: by_value(
        "target_kind",
        {
            kind: marker("circle", colour, 3.4)
            for kind, colour in zip(KINDS, (*_COLOURS, _OTHER), strict=True)
        },
        label=_NAMED,
    ),
    ELLIPSES.name: single(area("228,26,28,30", "228,26,28,255", 0.4)),
}


_CONFIDENCE = ConfidenceConfig()
#: The track is broken where there is no point for so many intervals, or seconds if that is longer.
_INTERVALS, _LONGEST_S = 2.5, 2.0


class Vectors:
    """Write a GeoPackage with the layers of ``vector_layers``, in WGS84 (EPSG:4326).

    Each picture that is taken gives an outline and a point of the track. They are expected every
    ``every_s`` seconds (0: all of the flight): where they are missing, the track is broken.
    ``targets`` is a file of targets; without one there are no layers of them. ``confidence`` gives
    the sigmas besides the pose's. ``state_at`` returns the filter's state at a time of exposure
    (ns). Raises ExportError and TargetError naming the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        every_s: float = 0.0,
        targets: PathLike | None = None,
        confidence: ConfidenceConfig = _CONFIDENCE,
        state_at: Callable[[int], str | None] | None = None,
    ) -> None:
        clicked = [] if targets is None else read_targets(targets)
        layers = () if targets is None else (TARGETS, ELLIPSES)
        of_targets = [layer._replace(style=_STYLES[layer.name]) for layer in layers]
        self._file = LayerFile(path, (FOOTPRINTS, TRACK, TRACK_POINTS, *of_targets))
        for target in clicked:
            for layer, row, positions in rows_of_target(target):
                self._file.add(layer.name, positions, row)
        self._track = _Track(self._file, max(_INTERVALS * every_s, _LONGEST_S), state_at)
        self._confidence = confidence
        self._without_ground = 0

    def take(self, frame: ExportFrame) -> None:
        """Add the picture's outline and the aircraft's place."""
        self._track.add(frame.number, frame.body, frame.plane)
        outline_n = _outline_n(frame)
        if len(outline_n) < 3:
            self._without_ground += 1
            return
        # From the last point to the first: the picture's rim runs clockwise.
        positions = _lon_lat_deg(frame.plane, outline_n[::-1])
        self._file.add(FOOTPRINTS.name, positions, self._seen(frame))

    def finish(self) -> dict[str, object]:
        """Complete the file; return its name and the rows by layer."""
        self._track.end_part()
        self._file.finish()
        made = {"file": str(self._file.path), **self._file.counts}
        return made | {"pictures_without_ground": self._without_ground}

    def close(self) -> None:
        """Remove the file if it is not finished."""
        self._file.close()

    def _seen(self, frame: ExportFrame) -> dict[str, object]:
        """Return the columns of FOOTPRINTS."""
        pose, plane, ground = frame.pose, frame.plane, frame.ground
        assert ground is not None  # there is an outline
        geometry = frame_geometry(
            Sight(frame.camera, pose, plane, ground, frame.body), self._confidence
        )
        latitude, longitude, height_m = geometry.sensor
        return {
            "picture": frame.number,
            "stamp_ns": pose.stamp_ns,
            "time": pose.stamp_ns,
            "latitude_deg": math.degrees(latitude),
            "longitude_deg": math.degrees(longitude),
            "height_m": height_m,
            "above_ground_m": height_above_m(pose, plane, ground),
            "heading_deg": math.degrees(camera_heading_rad(pose)),
            "pitch_deg": math.degrees(geometry.sight_rpy[1]),
            "gsd_m": ground_sample_m(frame.camera, pose, plane, ground),
            "slant_range_m": geometry.slant_range_m,
            "ce90_m": geometry.ce90_m,
            "le90_m": geometry.le90_m,
        }


class _Track:
    """Write the points of the track, and a line through each part without a gap."""

    def __init__(
        self, file: LayerFile, longest_s: float, state_at: Callable[[int], str | None] | None
    ) -> None:
        self._file, self._longest_s, self._state_at = file, longest_s, state_at
        self._places = array("d")  # longitude, latitude (deg), height (m) of each point
        self._length_m, self._begin_ns = 0.0, 0
        self._newest: BodyPose | None = None

    def add(self, picture: int, body: BodyPose, plane: TangentPlane) -> None:
        """Add a point; end the part before it if it lies too far back."""
        speed_m_s = self._onwards(body)
        latitude, longitude, height_m = (
            float(x) for x in plane.geodetic_from_ned(body.position_n)
        )
        place = math.degrees(longitude), math.degrees(latitude), height_m
        self._places.extend(place)
        self._newest = body
        roll, pitch, heading = map(math.degrees, body_rpy(body, plane))
        north_m, east_m, down_m = np.sqrt(body.covariance.diagonal()[:3]).tolist()
        row = {
            "picture": picture,
            "stamp_ns": body.stamp_ns,
            "time": body.stamp_ns,
            "state": self._state_at(body.stamp_ns) if self._state_at else None,
            "height_m": height_m,
            "speed_m_s": speed_m_s,
            "roll_deg": roll,
            "pitch_deg": pitch,
            "heading_deg": heading % 360.0,
            "sigma_north_m": north_m,
            "sigma_east_m": east_m,
            "sigma_height_m": down_m,
            "sigma_heading_deg": math.degrees(_heading_sigma_rad(body)),
        }
        self._file.add(TRACK_POINTS.name, [place], row)

    def _onwards(self, body: BodyPose) -> float | None:
        """Return the mean speed since the point before, m/s; None at the begin of a part."""
        before = self._newest
        step_s = (body.stamp_ns - before.stamp_ns) * 1e-9 if before else math.inf
        if before is None or not 0 < step_s <= self._longest_s:
            self.end_part()
            self._begin_ns = body.stamp_ns
            return None
        step_m = float(np.linalg.norm(body.position_n - before.position_n))
        self._length_m += step_m
        return step_m / step_s

    def end_part(self) -> None:
        """Write the line through the points since the last gap; a single point makes none."""
        places, self._places = np.array(self._places).reshape(-1, 3), array("d")
        if len(places) > 1 and self._newest is not None:
            row = {
                "begin": self._begin_ns,
                "end": self._newest.stamp_ns,
                "points": len(places),
                "length_m": self._length_m,
            }
            self._file.add(TRACK.name, places, row)
        self._length_m = 0.0


def _outline_n(frame: ExportFrame) -> Array:
    """Return the picture's outline on the ground (N, 3); empty without a ground."""
    if frame.ground is None:
        return np.empty((0, 3))
    seen = frame.pose, frame.plane, frame.ground
    return footprint(frame.camera, *seen, farthest_m(frame.camera, height_above_m(*seen)))


def _lon_lat_deg(plane: TangentPlane, points_n: Array) -> Array:
    """Return longitudes and latitudes (N, 2), deg; beyond 180 where the points lie across it."""
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    return np.degrees(np.stack([np.unwrap(longitude), latitude], axis=1))


def _heading_sigma_rad(body: BodyPose) -> float:
    nose_n: Sequence[float] = matrix_from_quat(body.q_nb)[:, 0].tolist()
    row = np.array(azimuth_row(nose_n))
    return float(np.sqrt(row @ body.covariance[3:, 3:] @ row))
