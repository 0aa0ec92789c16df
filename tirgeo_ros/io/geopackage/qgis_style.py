"""Write styles of QGIS (QML): how a layer of points, lines or areas is drawn and labelled.

The properties of symbols are written in both forms that QGIS has had: ``prop``, and a map of
``Option``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

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
