"""Read KML and KMZ (OGC 07-147r2, 12-007r2): the placemarks, in any folders.

Longitudes and latitudes are in WGS84. Heights are above the ground or above the sea (EGM96), never
above the ellipsoid: all are left out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.archive import Archive
from tirgeo_ros.io.maps.feature_faults import FeatureError
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import Part, ShapeBuilder, Table, check_count, check_layer, empty_map

_COMMA = re.compile(r"\s*,\s*")
_BLANK_COMMA = re.compile(r"\s,|,\s")  # some programs write so
_DEEPEST = 200  # elements in elements
#: Elements and attributes of a file: some 300 bytes each in memory.
_MOST_ELEMENTS = 1_500_000
_AT_ONCE = 1 << 16  # bytes for the parser
_LONGEST_TAG = 1 << 20  # bytes of a tag or a comment: the parser keeps each whole
_HOLDERS = {"kml", "Document", "Folder"}
_GEOMETRIES = {"Point", "LineString", "LinearRing", "Polygon"}
#: What is not drawn, and the remedy if the file has nothing else.
_NOT_DRAWN = {
    "NetworkLink": "a link: open it in Google Earth or QGIS and save what it leads to as KML",
    "Model": "a body in space: draw its outline",
    "GroundOverlay": "a picture: draw as lines what is wanted of it",
    "ScreenOverlay": "a picture",
    "PhotoOverlay": "a picture",
}
_STYLES = {"Style", "StyleMap"}


def read_kml(path: Path, layer: str, _wanted: Wanted) -> list[Table]:
    """Return the only table of a KML file, or the placemarks of its folders named ``layer``.

    Raises MapError, naming the file, if it is no KML.
    """
    return [_read(path, path.read_bytes(), layer)]


def _read(path: Path, content: bytes, layer: str) -> Table:
    root = _tree(content, path)
    if root.tag != "kml" and root.tag not in _HOLDERS | {"Placemark"}:
        raise MapError(f"{path}: XML, but not KML: it begins with {root.tag}")
    folders = [each for each in root.iter() if each.tag in {"Document", "Folder"}]
    check_layer(path, layer, {_text(folder, "name") for folder in folders} | {path.stem})
    chosen = [root]
    if layer and layer != path.stem:
        chosen = [folder for folder in folders if _text(folder, "name") == layer]
    return _table(path, layer or path.stem, chosen)


def read_kmz(path: Path, archive: Archive, layer: str) -> list[Table]:
    """Read the main file of a KMZ: doc.kml, else its first .kml.

    Raises MapError as ``read_kml``.
    """
    names = archive.names(".kml")
    main = next((name for name in names if name.lower() == "doc.kml"), names[0])
    table = _read(path, archive.read(main), layer)
    if len(names) == 1:
        return [table]
    told = f"{path}: of {len(names)} .kml in it {main} alone is read"
    empty = f"{table.empty}; of {len(names)} .kml in it {main} alone is read: unpack the others"
    return [replace(table, left_out=(*table.left_out, told), empty=empty)]


def _tree(content: bytes, path: Path) -> Element:
    """Return the elements, names without their prefixes: any version's namespace is accepted."""
    builder = _Builder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = builder.refuse_entity
    try:
        _feed(parser, content)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise MapError(f"{path}: no KML that can be read: {error}") from None
    return builder.close()


def _feed(parser: Any, content: bytes) -> None:
    """Parse a file; refuse a tag of which the parser holds too many bytes."""
    for begin in range(0, len(content), _AT_ONCE):
        parser.Parse(content[begin : begin + _AT_ONCE], False)
        if begin - parser.CurrentByteIndex > _LONGEST_TAG:
            raise ValueError(f"a tag of more than {_LONGEST_TAG} bytes")
    parser.Parse(b"", True)


class _Builder:
    """Build the tree; refuse what grows without bound."""

    def __init__(self) -> None:
        self._tree = TreeBuilder()
        self._depth = 0
        self._elements = 0
        self._names: dict[str, str] = {}

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._elements += 1 + len(attributes)
        if self._depth > _DEEPEST:
            raise ValueError("it is nested too deeply")
        if self._elements > _MOST_ELEMENTS:
            raise ValueError(
                f"more than {_MOST_ELEMENTS} elements; cut out the flight's surroundings"
            )
        self._tree.start(self._local(name), attributes)

    def end(self, name: str) -> None:
        self._depth -= 1
        self._tree.end(self._local(name))

    def _local(self, name: str) -> str:
        """Return the name without its prefix; each is in memory once."""
        return self._names.setdefault(name, name.rpartition(":")[2])

    def data(self, text: str) -> None:
        self._tree.data(text)

    def refuse_entity(self, *_declaration: object) -> None:
        raise ValueError("it declares entities of its own")

    def close(self) -> Element:
        return self._tree.close()


def _text(element: Element, name: str) -> str:
    return (element.findtext(name) or "").strip()


def _elements(roots: list[Element], tag: str | None = None) -> Iterator[Element]:
    """Return each element (of a tag) once: a chosen folder may be inside another one."""
    return iter(dict.fromkeys(each for root in roots for each in root.iter(tag)))


def _instead(chosen: list[Element]) -> str:
    """Return what a file without a shape contains, and what to do."""
    tags = Counter(each.tag for each in _elements(chosen))
    styles = sum(tags[tag] for tag in _STYLES)
    told = [f"{tags[tag]} {tag} ({what})" for tag, what in _NOT_DRAWN.items() if tags[tag]]
    told += [f"{styles} styles"] if styles else []
    held = ", ".join(told) or "nothing that can be drawn"
    return f"it has {tags['Placemark']} placemarks and {held}"


def _table(path: Path, name: str, chosen: list[Element]) -> Table:
    shapes = ShapeBuilder()
    properties: list[Mapping[str, Any]] = []
    set_aside = 0
    for number, placemark in enumerate(_elements(chosen, "Placemark")):
        check_count(number + 1, str(path))
        properties.append(_properties(placemark))
        drawn = len(shapes.parts)
        shapes.take(number, _parts(placemark))
        bare = len(shapes.parts) == drawn and number not in shapes.faults.numbers
        if bare and any(each.tag in _NOT_DRAWN for each in placemark.iter()):
            set_aside += 1
    return Table(
        str(path),
        name,
        None,
        shapes.shapes(),
        properties,
        {key for each in properties for key in each},
        _told(path, chosen),
        set_aside,
        faults=shapes.faults,
        empty="" if shapes.parts else empty_map(path, _instead(chosen)),
    )


def _told(path: Path, chosen: list[Element]) -> tuple[str, ...]:
    """Return a line for each kind of element of which something is left out."""
    high = "with heights above the sea: the heights left out"
    counts = Counter(
        f"{each.tag} left out" if each.tag in _NOT_DRAWN else f"{each.tag} {high}"
        for each in _elements(chosen)
        if each.tag in _NOT_DRAWN
        or (each.tag in _GEOMETRIES and _text(each, "altitudeMode") == "absolute")
    )
    return tuple(f"{path}: {count} {what}" for what, count in counts.items())


def _properties(placemark: Element) -> dict[str, str]:
    """Return name, description, and the data of ExtendedData in both of its forms."""
    plain = {key: _text(placemark, key) for key in ("name", "description")}
    found = {key: text for key, text in plain.items() if text}
    for data in placemark.iterfind("ExtendedData//Data"):
        found.setdefault(data.get("name", ""), _text(data, "value"))
    for data in placemark.iterfind("ExtendedData//SimpleData"):
        found.setdefault(data.get("name", ""), (data.text or "").strip())
    return found


def _pieces(geometry: Element) -> Iterator[tuple[str, str]]:
    """Yield kind and coordinates of the geometries in an element, in their order."""
    for each in geometry:
        if each.tag in {"Point", "LineString", "LinearRing"}:
            yield each.tag, _text(each, "coordinates")
        elif each.tag == "Polygon":
            for ring in each.iterfind("*/LinearRing"):
                yield "Polygon", _text(ring, "coordinates")
        elif each.tag == "Track":  # of "lon lat height", one for each place
            places = (",".join((coord.text or "").split()) for coord in each.iterfind("coord"))
            yield "LineString", " ".join(places)
        elif each.tag in {"MultiGeometry", "MultiTrack"}:
            yield from _pieces(each)


def _parts(placemark: Element) -> Iterator[Part]:
    """Yield the parts of a placemark; a ring outside a polygon becomes a closed line."""
    for kind, text in _pieces(placemark):
        points = _positions(text)
        if kind == "LinearRing":
            yield "LineString", np.concatenate([points, points[:1]])
        else:
            yield kind, points


def _positions(text: str) -> NDArray[np.float64]:
    """Return longitudes and latitudes (n, 2) of "lon,lat[,height] lon,lat[,height] ...".

    Raises FeatureError for any other text.
    """
    tuples = (_COMMA.sub(",", text) if _BLANK_COMMA.search(text) else text).split()
    if not tuples:
        return np.empty((0, 2))
    commas = {each.count(",") for each in tuples}
    try:
        if len(commas) == 2:
            tuples = [",".join(each.split(",")[:2]) for each in tuples]
        numbers = np.array(list(map(float, ",".join(tuples).split(","))))
        right = commas <= {1, 2} and "_" not in text  # Python would read 1_6 as 16
    except ValueError:
        right = False
    if not right:
        raise FeatureError(f"{text[:40]!r} are no coordinates lon,lat[,height]")
    return numbers.reshape(len(tuples), -1)[:, :2]
