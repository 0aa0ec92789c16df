"""Write a map as GeoJSON for a web page: latitude and longitude, names, colours."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from tirgeo_ros.core.map.layers import GeoFeature, MapLayer
from tirgeo_ros.core.types.errors import MapError

#: Beyond, a tablet's browser has no fluent map any more.
MOST_BYTES = 20 << 20
_DIGITS = 7  # of degrees: a centimetre


def page_map(layers: Iterable[MapLayer]) -> bytes:
    """Return layers as GeoJSON, in the order of drawing. Raises MapError if it is too large."""
    features = [
        {
            "type": "Feature",
            "properties": _properties(layer, part),
            "geometry": geometry,
        }
        for layer in layers
        for part, geometry in _shapes(layer.features)
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features}, separators=(",", ":"))
    if len(text) > MOST_BYTES:
        raise MapError(
            f"the map has {len(text) >> 20} MB as GeoJSON, and the page takes "
            f"{MOST_BYTES >> 20} MB; cut out the area of the flight"
        )
    return text.encode()


def _shapes(features: Sequence[GeoFeature]) -> Iterable[tuple[GeoFeature, dict[str, Any]]]:
    """Yield a part of each feature with the geometry; outlines of a group are one area."""
    numbered = enumerate(features)
    for _, pairs in groupby(numbered, key=lambda one: (one[1].group, one[1].group < 0 and one[0])):
        parts = [part for _, part in pairs]
        outlines = [part for part in parts if part.closed]
        if outlines:
            rings = [_positions(part) for part in outlines]
            yield outlines[0], {"type": "Polygon", "coordinates": rings}
        for part in parts:
            if not part.closed:
                yield part, _line_or_point(part)


def _line_or_point(part: GeoFeature) -> dict[str, Any]:
    positions = _positions(part)
    if len(positions) == 1:
        return {"type": "Point", "coordinates": positions[0]}
    return {"type": "LineString", "coordinates": positions}


def _positions(part: GeoFeature) -> list[list[float]]:
    """Return longitude and latitude (deg) of a part's points; an outline ends where it begins."""
    found: list[list[float]] = np.degrees(part.points[:, 1::-1]).round(_DIGITS).tolist()
    return [*found, found[0]] if part.closed and found[0] != found[-1] else found


def _properties(layer: MapLayer, part: GeoFeature) -> dict[str, Any]:
    blue, green, red = layer.style.line_bgr
    return {
        "layer": layer.name,
        "name": part.label,
        "color": f"#{red:02x}{green:02x}{blue:02x}",
        "filled": layer.style.fill_bgr is not None,
    }
