"""Write a map as GeoJSON for a web page: latitude and longitude, names of layers and features."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
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


def page_map(layers: Iterable[MapLayer]) -> bytes:
    """Return layers as GeoJSON, in the order of drawing, simplified to what a browser can draw.

    Lines then lie within a tolerance of the map's; the smallest parts are left out if there are
    too many. ``simplified`` says so in words, and is empty if nothing is changed.
    """
    layers = list(layers)
    kept, words = _simplified([part for layer in layers for part in layer.features])
    features, end = [], 0
    for layer in layers:
        start, end = end, end + len(layer.features)
        left = [part for part in kept[start:end] if part is not None]
        features += [
            {
                "type": "Feature",
                "properties": {"layer": layer.name, "name": part.label},
                "geometry": geometry,
            }
            for part, geometry in _shapes(left)
        ]
    found = {"type": "FeatureCollection", "simplified": words, "features": features}
    return json.dumps(found, separators=(",", ":")).encode()


def _simplified(parts: list[GeoFeature]) -> tuple[list[GeoFeature | None], str]:
    """Return the parts with fewer points, None for those left out, and words for what changed."""
    chosen = [*range(len(parts))]
    if len(parts) > MOST_PARTS:
        chosen = np.sort(np.argsort(-_sizes_m(parts), kind="stable")[:MOST_PARTS]).tolist()
    rings = [_metres(parts[i]) for i in chosen]
    kept: list[GeoFeature | None] = [None] * len(parts)
    said = [f"{len(chosen):,} of {len(parts):,} shapes"] if len(chosen) < len(parts) else []
    worths_m, tolerance_m = [np.full(len(ring), math.inf) for ring in rings], 0.0
    if sum(map(len, rings)) > MOST_POINTS:
        starts = np.append(0, np.cumsum([len(ring) for ring in rings]))
        worth_m = worths(Polylines(np.concatenate(rings).T, starts, np.arange(len(rings))))
        worths_m, tolerance_m = np.split(worth_m, starts[1:-1]), np.sort(worth_m)[-MOST_POINTS]
        said.append(f"lines within {tolerance_m:.2g} m")
    for i, worth_m in zip(chosen, worths_m, strict=True):
        fifth_m = np.sort(worth_m)[-5:][0]  # with it a small outline keeps four corners
        stays = worth_m >= min(tolerance_m, fifth_m)
        kept[i] = replace(parts[i], points=parts[i].points[stays[: len(parts[i].points)]])
    return kept, ", ".join(said)


def _metres(part: GeoFeature) -> Array:
    """Return a part's points (N, 2), m; those of an outline end where it begins."""
    points = np.concatenate([part.points, part.points[:1]]) if part.closed else part.points
    return SEMI_MAJOR_AXIS_M * points[:, :2] * [1.0, math.cos(points[0, 0])]


def _sizes_m(parts: list[GeoFeature]) -> Array:
    """Return the diagonal of the box around each part (N,), m."""
    counts = np.array([len(part.points) for part in parts])
    starts = np.cumsum(counts) - counts
    points = np.concatenate([part.points[:, :2] for part in parts])
    low, high = (each.reduceat(points, starts) for each in (np.minimum, np.maximum))
    spans_m = SEMI_MAJOR_AXIS_M * (high - low) * np.column_stack([counts > 0, np.cos(low[:, 0])])
    return np.where(counts > 1, np.hypot(*spans_m.T), _POINT_M)


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
