"""Paint the park in grey levels, as a thermal camera sees the ground from above.

It is night after a warm day: paving and kerbs are warm, grass is cool, beds are either. Copies of
lower resolution serve for what is far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.tools.simulate.park import Park, Spot
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.scenario_ground import ParkScenario

#: Grey level of the grass, and grey levels per kelvin.
GRASS, GREY_PER_K = 92.0, 10.0
_PAVING, _KERB, _SOIL = 158.0, 192.0, 118.0
_BED_SPAN, _PLANT_SPAN, _SHRUB_SPAN, _HOT = 58.0, 16.0, 34.0, 150.0
_KERB_M, _SLAB_M = 0.2, 2.0
_LEVELS = 4
_SHIFT = 4  # drawing to a sixteenth of a cell
#: Size of grain (m) and its standard deviation (grey levels), from weather to tufts.
_GRAINS = ((40.0, 5.0), (9.0, 5.0), (2.5, 4.0), (0.7, 4.0), (0.2, 4.0))


class Ground(NamedTuple):
    """Hold the painted ground: level k has cells of ``resolution_m`` times 2^k."""

    levels: list[Pixels]  # rows from north to south, columns from west to east
    north_edge_m: float
    west_edge_m: float
    resolution_m: float


def paint(park: Park, scenario: ParkScenario, seed: int) -> Ground:
    """Paint a park with its texture."""
    canvas = _Canvas(scenario)
    for path in park.paths:
        canvas.line(path.line, path.width_m + 2 * _KERB_M, _KERB)
    for path in park.paths:
        canvas.line(path.line, path.width_m, _PAVING)
    _lay_slabs(canvas, park, generator(seed, "slabs"))
    for bed in park.beds:
        # The map's outline is the border between bed and kerb.
        rings = [bed.outline, *bed.holes]
        for ring in rings:
            canvas.line(ring, 2 * _KERB_M, _KERB, closed=True)
        canvas.fill(rings, _SOIL + _BED_SPAN * bed.warmth)
    for plant in park.plants:
        canvas.tint(plant, _PLANT_SPAN * plant.warmth)
    for shrub in park.shrubs:
        canvas.disc(shrub, GRASS + _SHRUB_SPAN * shrub.warmth)
    for hydrant in park.hydrants:
        canvas.disc(Spot(hydrant.center, 0.3, 0.0), 30.0)
    for spot in park.hot:
        canvas.disc(spot, 105.0 + _HOT * spot.warmth)
    levels = [_textured(canvas.grey, scenario, seed)]
    for _ in range(_LEVELS - 1):
        finer = levels[-1]
        half = cv2.resize(finer, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        levels.append(half.astype(np.uint8))
    return Ground(levels, canvas.north_edge_m, canvas.west_edge_m, scenario.resolution_m)


def _lay_slabs(canvas: _Canvas, park: Park, rng: np.random.Generator) -> None:
    """Paint the paving as slabs with different grey levels."""
    for path in park.paths:
        ahead = path.line[1] - path.line[0]
        length_m = float(np.linalg.norm(ahead))
        along, width = ahead / length_m, 0.5 * path.width_m
        aside = np.array([-along[1], along[0]]) * width
        for at in np.arange(0.0, length_m - _SLAB_M, _SLAB_M):
            first, last = path.line[0] + along * at, path.line[0] + along * (at + _SLAB_M - 0.1)
            slab = np.array([first - aside, first + aside, last + aside, last - aside])
            canvas.fill([slab], _PAVING + rng.normal(0.0, 5.0))


class _Canvas:
    """Draw on a picture with ground coordinates, to a sixteenth of a cell."""

    def __init__(self, scenario: ParkScenario) -> None:
        (south, north), (west, east) = scenario.north_m, scenario.east_m
        self.resolution_m = scenario.resolution_m
        self.north_edge_m = north + scenario.margin_m
        self.west_edge_m = west - scenario.margin_m
        side = 2 * scenario.margin_m
        # Whole cells at every level, so that the levels are exactly aligned.
        step = 2 ** (_LEVELS - 1)
        rows = step * round((north - south + side) / self.resolution_m / step)
        columns = step * round((east - west + side) / self.resolution_m / step)
        self.grey: Pixels = np.full((rows, columns), round(GRASS), np.uint8)

    def _cells(self, points: Array) -> npt.NDArray[np.int32]:
        """Return ground points (N, 2) in sixteenths of a cell, columns first, 0 = the middle."""
        columns = (points[:, 1] - self.west_edge_m) / self.resolution_m - 0.5
        rows = (self.north_edge_m - points[:, 0]) / self.resolution_m - 0.5
        cells = np.round(np.stack([columns, rows], -1) * 2**_SHIFT)
        return np.asarray(cells, np.int32)

    def fill(self, rings: Sequence[Array], grey: float) -> None:
        """Fill the first ring except the others, which are inside it."""
        cells = [self._cells(ring) for ring in rings]
        cv2.fillPoly(self.grey, cells, grey, cv2.LINE_AA, _SHIFT)

    def line(self, line: Array, width_m: float, grey: float, *, closed: bool = False) -> None:
        width = max(1, round(width_m / self.resolution_m))
        cv2.polylines(self.grey, [self._cells(line)], closed, grey, width, cv2.LINE_AA, _SHIFT)

    def tint(self, spot: Spot, change: float) -> None:
        """Lighten or darken a disc by a change in grey."""
        column, row = self._cells(spot.center[None, :])[0] >> _SHIFT
        under = float(self.grey[row, column])
        self.disc(spot, min(max(under + change, 0.0), 255.0))

    def disc(self, spot: Spot, grey: float) -> None:
        center = self._cells(spot.center[None, :])[0]
        radius = round(spot.radius_m / self.resolution_m * 2**_SHIFT)
        x, y = int(center[0]), int(center[1])
        cv2.circle(self.grey, (x, y), radius, min(grey, 255.0), -1, cv2.LINE_AA, _SHIFT)


def _textured(grey: Pixels, scenario: ParkScenario, seed: int) -> Pixels:
    """Return the painting with grain of several sizes."""
    rng = generator(seed, "grain")
    rows, columns = grey.shape
    total = np.zeros((rows, columns), np.int16)  # hundredths of a grey level
    for size_m, std in _GRAINS:
        cell = max(1.0, size_m / scenario.resolution_m)
        coarse = rng.standard_normal((int(rows / cell) + 2, int(columns / cell) + 2), np.float32)
        grain = cv2.resize(coarse * (100 * std), (columns, rows), interpolation=cv2.INTER_CUBIC)
        total += grain.astype(np.int16)
    total //= 100
    total += grey
    return np.asarray(np.clip(total, 0, 255), np.uint8)
