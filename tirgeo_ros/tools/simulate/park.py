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
"""Lay out a park of flower beds on level or sloping ground; write its map and elevation model.

There are beds with corners, paths, hydrants, and lamps, which are not in the map. Coordinates are
metres north and east of the site's origin, on its plane; heights are above that plane. The same
scenario and seed give the same park.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.scenario import ParkScenario

_NODE_DEG = 1e-5  # spacing of the elevation model: 1.1 m along a meridian
#: Text of a ``.prj`` file beside an elevation model in WGS84 degrees.
WGS84_TEXT = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]\n'
)
_FLOWERS = (
    *("Peony", "Iris", "Päonie", "牡丹", "Lavande d'été", "Chrysanthemum", "芍药"),
    "Grünfläche",
)
_WIDE_M, _NARROW_M = 4.0, 1.6  # paths

Floats = npt.NDArray[np.floating]


class Relief:
    """Compute heights of the ground."""

    def __init__(self, scenario: ParkScenario) -> None:
        edges = np.array([scenario.north_m, scenario.east_m]).T
        #: South-western and north-eastern corner of the ground: north, east (2, 2).
        self.corners: Array = edges + scenario.margin_m * np.array([[-1.0], [1.0]])
        uphill = math.radians(scenario.uphill_deg)
        rise = math.tan(math.radians(scenario.slope_deg))
        self._rise = rise * math.cos(uphill), rise * math.sin(uphill)
        self.highest_m = float((self.corners * self._rise).max(axis=0).sum())

    def places(self, level: Array) -> Array:
        """Return ground points (N, 3) in the plane of the site at north and east (N, 2)."""
        return np.column_stack([level, -level @ self._rise])

    def descent(self, position_p: Floats, rays_p: Floats) -> tuple[Floats, Floats]:
        """Return a point's (3,) height over the ground, m, and the descent of rays (N,).

        A ray (N, 3) from the point meets the ground at ``height / descent`` times its length.
        """
        # Python floats keep arrays in single precision, which is much faster.
        north, east = self._rise
        height = -(position_p[2] + north * position_p[0] + east * position_p[1])
        return height, rays_p[:, 2] + north * rays_p[:, 0] + east * rays_p[:, 1]


def elevation_text(relief: Relief, plane: TangentPlane) -> str:
    """Return the ground as an ESRI ASCII grid of WGS84 degrees, ellipsoidal heights."""
    lat, lon, _ = plane.geodetic_from_ned(np.pad(relief.corners, ((0, 0), (0, 1))))
    (south, north), (west, east) = np.degrees(lat), np.degrees(lon)
    rows, columns = (math.ceil(span / _NODE_DEG) + 1 for span in (north - south, east - west))
    lons = np.radians(west + _NODE_DEG * np.arange(columns))
    lines = [
        f"ncols {columns}",
        f"nrows {rows}",
        f"xllcenter {west:.10f}",
        f"yllcenter {south:.10f}",
        f"cellsize {_NODE_DEG:.10f}",
    ]
    for row in reversed(range(rows)):
        row_lat = np.full(columns, math.radians(south + _NODE_DEG * row))
        level = plane.ned_from_geodetic(row_lat, lons, np.full(columns, plane.height_m))
        _, _, height = plane.geodetic_from_ned(relief.places(level[:, :2]))
        lines.append(" ".join(f"{metres:.3f}" for metres in height.tolist()))
    return "\n".join(lines) + "\n"


#: The level ground of the paper's flight.
LEVEL = Relief(ParkScenario())


class Bed(NamedTuple):
    """Hold a flower bed within its kerb."""

    name: str
    outline: Array  # (N, 2) north, east; clockwise seen from above, not closed
    holes: tuple[Array, ...]  # each like the outline
    warmth: float  # -1 cold to 1 warm


class ParkPath(NamedTuple):
    """Hold a paved path along a line."""

    name: str
    line: Array  # (2, 2) north, east
    width_m: float


class Lamp(NamedTuple):
    """Hold a hot, round object that is not in the map."""

    center: Array  # (2,) north, east
    radius_m: float
    warmth: float


class Park(NamedTuple):
    """Hold everything on the ground."""

    beds: list[Bed]
    paths: list[ParkPath]
    hydrants: dict[str, Array]  # name -> north, east (2,)
    lamps: list[Lamp]


def lay_out(scenario: ParkScenario, seed: int) -> Park:
    """Lay beds in the cells of a grid, paths between them, and lamps along the paths north."""
    rng, cell = generator(seed, "park"), scenario.cell_m
    (south, north_end), (west, east_end) = scenario.north_m, scenario.east_m
    rows = max(1, int((north_end - south) / cell))
    columns = max(1, int((east_end - west) / cell))
    beds = [_bed(rng, scenario, row, column) for row in range(rows) for column in range(columns)]
    corner, far = np.array([south, west]), np.array([rows, columns])
    paths: list[ParkPath] = []
    for axis, word, every in ((1, "Path N", 3), (0, "Allée ", 4)):
        for k in range(far[axis] + 1):
            ends = np.array([[0, 0], far])
            ends[:, axis] = k
            width_m = _NARROW_M if k % every else _WIDE_M
            paths.append(ParkPath(f"{word}{k + 1}", corner + cell * ends, width_m))
    hydrants: dict[str, Array] = {}  # beside every second crossing of a wide path
    for row in range(0, rows + 1, 2):
        for column in range(row % 4 // 2, columns + 1, 3):
            center = np.array([south + row * cell + 2.6, west + column * cell + 2.4])
            hydrants[f"Hydrant {len(hydrants) + 1}"] = center
    lamps: list[Lamp] = []
    for _ in range(45):
        north = rng.uniform(south, north_end)
        column = round((rng.uniform(west, east_end) - west) / cell)
        east = west + cell * column + rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.9)
        radius_m, warmth = rng.uniform(0.2, 0.45), rng.uniform(0.6, 1.0)
        lamps.append(Lamp(np.array([north, east]), radius_m, warmth))
    return Park(beds, paths, hydrants, lamps)


def _bed(rng: np.random.Generator, scenario: ParkScenario, row: int, column: int) -> Bed:
    # The bed stays inside the paths around its cell.
    size = 0.5 * scenario.cell_m - _WIDE_M / 2 - 0.5
    outline, holes = _shape(rng)
    angle = (math.pi / 2) * rng.integers(4) + math.radians(rng.uniform(-9, 9))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    scale = size * rng.uniform(0.7, 0.88, 2)
    corner = np.array([scenario.north_m[0], scenario.east_m[0]])
    center = corner + (np.array([row, column]) + 0.5) * scenario.cell_m
    warmth = rng.choice([-1.0, 1.0]) * rng.uniform(0.45, 1.0)
    name = f"{_FLOWERS[(row + 3 * column) % len(_FLOWERS)]} {chr(65 + row % 26)}{column + 1}"
    placed = [center + (ring * scale) @ turn.T for ring in (outline, *holes)]
    return Bed(name, placed[0], tuple(placed[1:]), float(warmth))


def _shape(rng: np.random.Generator) -> tuple[Array, list[Array]]:
    """Return outline and holes in a square from -1 to 1, clockwise seen from above."""
    square = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])  # north comes first
    ring: Any
    holes: list[Array] = []
    match int(rng.integers(7)):
        case 0:  # a rectangle with one corner cut off
            cut = rng.uniform(0.4, 0.9)
            ring = [[1, -1], [1, 1 - cut], [1 - cut, 1], [-1, 1], [-1, -1]]
        case 1:  # an L
            a, b = rng.uniform(-0.3, 0.3, 2)
            ring = [[1, -1], [1, a], [b, a], [b, 1], [-1, 1], [-1, -1]]
        case 2:  # a T
            a, b = rng.uniform(0.25, 0.5), rng.uniform(-0.2, 0.4)
            ring = [[1, -1], [1, 1], [b, 1], [b, a], [-1, a], [-1, -a], [b, -a], [b, -1]]
        case 3:  # a trapezoid
            a, b = rng.uniform(0.35, 0.85, 2)
            ring = [[1, -a], [1, b], [-1, 1], [-1, -1]]
        case 4:  # a star of five points
            radii = np.where(np.arange(10) % 2 == 0, 1.0, rng.uniform(0.45, 0.6))
            ring = radii[:, None] * _regular(10)
        case 5:  # a hexagon around a square lawn
            ring, holes = _regular(6), [rng.uniform(0.3, 0.45) * square]
        case _:  # a rectangle around a rectangular basin
            ring, holes = square, [square * rng.uniform(0.35, 0.6, 2)]
    return np.array(ring), holes


def _regular(corners: int) -> Array:
    """Return a regular polygon (corners, 2), its first corner at the north."""
    angles = np.arange(corners) * 2 * math.pi / corners
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def map_text(park: Park, plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the park's map with heights above the ellipsoid."""
    features = []
    for bed in park.beds:
        # RFC 7946, 3.1.6: outer ring counterclockwise and holes clockwise, all closed
        rings = [_clockwise(bed.outline)[::-1], *map(_clockwise, bed.holes)]
        closed = [_positions(np.vstack([ring, ring[:1]]), plane, relief) for ring in rings]
        features.append(_feature({"name": bed.name, "kind": "bed"}, "Polygon", closed))
    for path in park.paths:
        line = _positions(path.line, plane, relief)
        features.append(_feature({"name": path.name, "kind": "path"}, "LineString", line))
    for name, center in park.hydrants.items():
        features.append(point_feature({"name": name, "kind": "hydrant"}, center, plane, relief))
    return collection(features)


def collection(features: Sequence[Mapping[str, object]]) -> str:
    """Return a FeatureCollection, with one feature per line."""
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def point_feature(
    properties: Mapping[str, object], place: Array, plane: TangentPlane, relief: Relief
) -> dict[str, object]:
    """Return a GeoJSON Point on the ground at north, east (2,)."""
    return _feature(properties, "Point", _positions(place[None, :], plane, relief)[0])


def _feature(
    properties: Mapping[str, object], kind: str, coordinates: object
) -> dict[str, object]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": dict(properties), "geometry": geometry}


def _clockwise(ring: Array) -> Array:
    """Return a ring of north, east (N, 2) in clockwise order seen from above."""
    north, east = ring.T
    twice_area = np.sum(north * np.roll(east, -1) - np.roll(north, -1) * east)
    return ring if twice_area > 0 else ring[::-1]


def _positions(points: Array, plane: TangentPlane, relief: Relief) -> list[list[float]]:
    """Return longitude, latitude (deg), height (m) of ground points (N, 2)."""
    lat, lon, height = plane.geodetic_from_ned(relief.places(points))
    degrees = np.round(np.degrees(np.stack([lon, lat], -1)), 9)  # a tenth of a millimetre
    positions: list[list[float]] = np.column_stack([degrees, np.round(height, 4)]).tolist()
    return positions
