"""Lay out a park of flower beds: shapes with corners, paths, hydrants, and unmapped things.

Coordinates are metres north and east of the site's origin, on its plane. The same scenario and
seed give the same park.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.scenario_ground import ParkScenario

_FLOWERS = (
    *("Peony", "Iris", "Päonie", "牡丹", "Lavande d'été", "Chrysanthemum", "芍药"),
    "Grünfläche",
)
_WIDE_M, _NARROW_M = 4.0, 1.6  # paths
_PLANT_M = 0.75  # distance between plants


class Bed(NamedTuple):
    """Hold a flower bed within its kerb."""

    name: str
    outline: Array  # (N, 2) north, east; clockwise seen from above, not closed
    holes: tuple[Array, ...]  # each like the outline
    warmth: float  # -1 cold to 1 warm


class ParkPath(NamedTuple):
    """Hold a paved path along a line."""

    name: str
    line: Array  # (N, 2) north, east
    width_m: float


class Spot(NamedTuple):
    """Hold a round object: a tree's crown, a lamp, a person, a hydrant."""

    center: Array  # (2,) north, east
    radius_m: float
    warmth: float


class Hydrant(NamedTuple):
    """Hold a point of the map."""

    name: str
    center: Array  # (2,) north, east


class Park(NamedTuple):
    """Hold everything on the ground."""

    beds: list[Bed]
    paths: list[ParkPath]
    hydrants: list[Hydrant]
    plants: list[Spot]  # inside beds
    shrubs: list[Spot]
    hot: list[Spot]


def lay_out(scenario: ParkScenario, seed: int) -> Park:
    """Lay beds in the cells of a grid, paths between some of them, the rest at random."""
    rng = generator(seed, "park")
    rows = max(1, int((scenario.north_m[1] - scenario.north_m[0]) / scenario.cell_m))
    columns = max(1, int((scenario.east_m[1] - scenario.east_m[0]) / scenario.cell_m))
    beds = [_bed(rng, scenario, row, column) for row in range(rows) for column in range(columns)]
    return Park(
        beds,
        _paths(scenario, rows, columns),
        _hydrants(scenario, rows, columns),
        [plant for bed in beds for plant in _plants(rng, bed)],
        _shrubs(rng, scenario),
        _spots(rng, scenario, 45, (0.2, 0.45), (0.6, 1.0)),
    )


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


def _plants(rng: np.random.Generator, bed: Bed) -> list[Spot]:
    """Return plants in an irregular lattice inside a bed, clear of its kerb."""
    low, high = bed.outline.min(axis=0), bed.outline.max(axis=0)
    counts = np.ceil((high - low) / _PLANT_M).astype(int)
    lattice = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 2)
    places = low + _PLANT_M * (lattice + rng.uniform(-0.3, 0.3, lattice.shape))
    radii = rng.uniform(0.15, 0.38, len(places))
    warmth = rng.uniform(-1.0, 1.0, len(places))
    return [
        Spot(place, float(radius), float(warm))
        for place, radius, warm in zip(places, radii, warmth, strict=True)
        if _within(bed, place, 0.2 + radius)
    ]


def _within(bed: Bed, place: Array, clear_m: float) -> bool:
    rings = [ring.astype(np.float32).reshape(-1, 1, 2) for ring in (bed.outline, *bed.holes)]
    point = (float(place[0]), float(place[1]))
    inside = [cv2.pointPolygonTest(ring, point, measureDist=True) for ring in rings]
    return inside[0] > clear_m and all(distance < -clear_m for distance in inside[1:])


def _shrubs(rng: np.random.Generator, scenario: ParkScenario) -> list[Spot]:
    """Return clumps of crowns on the grass around the beds, and small ones along the paths."""
    clumps = _spots(rng, scenario, 60, (0.3, 0.7), (-1.0, -0.2))
    (south, north), (west, east) = scenario.north_m, scenario.east_m
    edge = np.array([[south, west], [north, east]])
    for _ in range(70):
        center = rng.uniform(edge[0] - 35.0, edge[1] + 35.0)
        if ((center < edge[0] - 5.0) | (center > edge[1] + 5.0)).any():
            clumps.append(Spot(center, rng.uniform(1.0, 2.2), rng.uniform(-1.0, 0.6)))
    return [crown for clump in clumps for crown in _crowns(rng, clump)]


def _crowns(rng: np.random.Generator, clump: Spot) -> list[Spot]:
    count = int(rng.integers(8, 20))
    places = clump.center + rng.normal(0.0, 0.55 * clump.radius_m, (count, 2))
    radii = clump.radius_m * rng.uniform(0.25, 0.6, count)
    warmth = np.clip(clump.warmth + rng.normal(0.0, 0.35, count), -1.0, 1.0)
    return [Spot(p, float(r), float(w)) for p, r, w in zip(places, radii, warmth, strict=True)]


def _paths(scenario: ParkScenario, rows: int, columns: int) -> list[ParkPath]:
    south, west, cell = scenario.north_m[0], scenario.east_m[0], scenario.cell_m
    north, east = south + rows * cell, west + columns * cell
    found: list[ParkPath] = []
    for k in range(columns + 1):
        line = np.array([[south, west + k * cell], [north, west + k * cell]])
        found.append(ParkPath(f"Path N{k + 1}", line, _NARROW_M if k % 3 else _WIDE_M))
    for k in range(rows + 1):
        line = np.array([[south + k * cell, west], [south + k * cell, east]])
        found.append(ParkPath(f"Allée {k + 1}", line, _NARROW_M if k % 4 else _WIDE_M))
    return found


def _hydrants(scenario: ParkScenario, rows: int, columns: int) -> list[Hydrant]:
    """Return a hydrant beside every other crossing of a wide path."""
    found: list[Hydrant] = []
    for row in range(0, rows + 1, 2):
        for column in range(row % 4 // 2, columns + 1, 3):
            north = scenario.north_m[0] + row * scenario.cell_m + 2.6
            east = scenario.east_m[0] + column * scenario.cell_m + 2.4
            found.append(Hydrant(f"Hydrant {len(found) + 1}", np.array([north, east])))
    return found


def _spots(
    rng: np.random.Generator,
    scenario: ParkScenario,
    count: int,
    radii_m: tuple[float, float],
    warmth: tuple[float, float],
) -> list[Spot]:
    """Return round objects along the paths that run north."""
    found: list[Spot] = []
    (south, north_end), (west, east_end) = scenario.north_m, scenario.east_m
    cell = scenario.cell_m
    for _ in range(count):
        north = rng.uniform(south, north_end)
        column = round((rng.uniform(west, east_end) - west) / cell)
        east = west + cell * column + rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.9)
        spot = Spot(np.array([north, east]), float(rng.uniform(*radii_m)), rng.uniform(*warmth))
        found.append(spot)
    return found


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
