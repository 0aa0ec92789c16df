"""A large made-up map to measure with: a town of roads and buildings on level ground."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.types.arrays import Array

#: Six tenths of the vertices are of buildings of 4, 6 or 12 corners and 8 to 20 m, anyhow placed
#: and turned; the rest are of winding roads right across the town, a vertex each 4 m.
_BUILDINGS = 0.6
_ROAD_VERTICES = 2000
_SPACING_M = 7.9  # side of the town over the square root of its vertices
_SHAPES = (
    [[0, 0], [0, 1], [1, 1], [1, 0]],
    [[0, 0], [0, 1], [0.5, 1], [0.5, 0.5], [1, 0.5], [1, 0]],
    [
        *([0, 0], [0, 1], [0.2, 1], [0.2, 1.1], [0.4, 1.1], [0.4, 1]),
        *([1, 1], [1, 0.6], [1.1, 0.6], [1.1, 0.3], [1, 0.3], [1, 0]),
    ],
)


def town(vertices: int, plane: TangentPlane) -> list[MapLayer]:
    """About so many vertices, around the plane's origin; not filled, without labels."""
    rng = np.random.default_rng(1)
    side_m = _SPACING_M * vertices**0.5
    corners = np.mean([len(shape) for shape in _SHAPES])
    buildings = [_building(rng, side_m) for _ in range(int(vertices * _BUILDINGS / corners))]
    count = max(int(vertices * (1 - _BUILDINGS) / _ROAD_VERTICES), 1)
    roads = [_road(rng, side_m, across=bool(i % 2)) for i in range(count)]
    return [
        MapLayer("roads", _features(roads, plane, closed=False)),
        MapLayer(
            "buildings", _features(buildings, plane, closed=True), LayerStyle((255, 255, 255))
        ),
    ]


def _building(rng: np.random.Generator, side_m: float) -> Array:
    corners = (np.array(_SHAPES[rng.integers(len(_SHAPES))]) - 0.5) * rng.uniform(8, 20, 2)
    turn = rng.uniform(0, 2 * np.pi)
    ahead, aside = np.cos(turn), np.sin(turn)
    turned = corners @ np.array([[ahead, aside], [-aside, ahead]])
    return np.asarray(turned + rng.uniform(-side_m / 2, side_m / 2, 2))


def _road(rng: np.random.Generator, side_m: float, *, across: bool) -> Array:
    along = np.linspace(-side_m / 2, side_m / 2, _ROAD_VERTICES)
    aside = np.cumsum(rng.normal(0, 0.3, _ROAD_VERTICES))
    road = np.column_stack([along, aside + rng.uniform(-side_m / 2, side_m / 2)])
    return np.asarray(road[:, ::-1] if across else road)


def _features(parts: list[Array], plane: TangentPlane, *, closed: bool) -> list[GeoFeature]:
    flat = np.concatenate(parts)
    points_n = np.column_stack([flat, np.zeros(len(flat))])
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    places = np.column_stack([latitude, longitude, np.full(len(flat), plane.height_m)])
    cuts = np.cumsum([len(part) for part in parts])[:-1]
    return [GeoFeature("", closed, points) for points in np.split(places, cuts)]
