"""Write a map as GeoJSON for a web page: latitude and longitude, names of layers and features."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.map.layers import GeoFeature, MapLayer
from tirgeo_ros.core.map.level_of_detail import worths
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array

#: What a tablet's browser draws fluently: parts (a line, an outline, a point) and their points.
MOST_PARTS, MOST_POINTS = 20_000, 150_000
_POINT_M = 10.0  # a point of the map matters as much as a building of this size
_DIGITS = 7  # of degrees: a centimetre

_Parts = list[tuple[int, GeoFeature]]  # each with the index of its layer


def page_map(layers: Sequence[MapLayer]) -> bytes:
    """Return layers as GeoJSON, in the order of drawing, simplified to what a browser can draw.

    ``simplified`` says in words what is changed, and is empty if nothing is.
    """
    parts = [(number, part) for number, layer in enumerate(layers) for part in layer.features]
    parts, fewer = _largest(parts)
    parts, coarser = _thinned(parts)
    features = [
        {
            "type": "Feature",
            "properties": {"layer": layers[number].name, "name": part.label},
            "geometry": geometry,
        }
        for number, of_layer in groupby(parts, key=itemgetter(0))
        for part, geometry in _shapes([part for _, part in of_layer])
    ]
    words = ", ".join(filter(None, (fewer, coarser)))
    found = {"type": "FeatureCollection", "simplified": words, "features": features}
    return json.dumps(found, separators=(",", ":")).encode()


def _largest(parts: _Parts) -> tuple[_Parts, str]:
    """Return the largest parts in their order, and words if some are left out."""
    if len(parts) <= MOST_PARTS:
        return parts, ""
    rank = np.argsort([-_size_m(part) for _, part in parts], kind="stable")
    chosen = [parts[i] for i in np.sort(rank[:MOST_PARTS]).tolist()]
    return chosen, f"{MOST_PARTS:,} of {len(parts):,} shapes"


def _thinned(parts: _Parts) -> tuple[_Parts, str]:
    """Return the parts with fewer points by Douglas and Peucker's rule, and words if they are."""
    lines = [_metres(part) for _, part in parts]
    starts = np.append(0, np.cumsum([len(line) for line in lines]))
    if starts[-1] <= MOST_POINTS:
        return parts, ""
    worth_m = worths(Polylines(np.concatenate(lines).T, starts, np.arange(len(lines))))
    tolerance_m, thinned = np.sort(worth_m)[-MOST_POINTS], []
    for (number, part), own_m in zip(parts, np.split(worth_m, starts[1:-1]), strict=True):
        fifth_m = np.sort(own_m)[-5:][0]  # with it a small outline keeps four corners
        stays = (own_m >= min(tolerance_m, fifth_m))[: len(part.points)]
        thinned.append((number, replace(part, points=part.points[stays])))
    return thinned, f"lines within {tolerance_m:.2g} m"


def _metres(part: GeoFeature) -> Array:
    """Return a part's points (N, 2), m; those of an outline end where it begins."""
    points = np.concatenate([part.points, part.points[:1]]) if part.closed else part.points
    return SEMI_MAJOR_AXIS_M * points[:, :2] * [1.0, math.cos(points[0, 0])]


def _size_m(part: GeoFeature) -> float:
    return math.hypot(*np.ptp(_metres(part), axis=0)) if len(part.points) > 1 else _POINT_M


def _shapes(features: Sequence[GeoFeature]) -> Iterable[tuple[GeoFeature, dict[str, Any]]]:
    """Yield a part of each feature with the geometry; outlines of a group are one area."""
    numbered = enumerate(features)
    for _, pairs in groupby(numbered, key=lambda one: (one[1].group, one[1].group < 0 and one[0])):
        parts = [part for _, part in pairs]
        outlines = [part for part in parts if part.closed]
        if outlines:
            rings = [_positions(part) for part in outlines]
            yield outlines[0], {"type": "Polygon", "coordinates": rings}
        for part in (part for part in parts if not part.closed):
            line = _positions(part)
            several = len(line) > 1
            kind, coordinates = ("LineString", line) if several else ("Point", line[0])
            yield part, {"type": kind, "coordinates": coordinates}


def _positions(part: GeoFeature) -> list[list[float]]:
    """Return longitude and latitude (deg) of a part's points; an outline ends where it begins."""
    found: list[list[float]] = np.degrees(part.points[:, 1::-1]).round(_DIGITS).tolist()
    return [*found, found[0]] if part.closed and found[0] != found[-1] else found
