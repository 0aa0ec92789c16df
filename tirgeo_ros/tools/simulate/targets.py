"""Place the targets of a search, people, fires and vehicles, and draw them at pixels' size.

A pixel shows a target by the share of its ground that the target covers. So one smaller than a
pixel is correspondingly faint, and its middle is where the camera projects it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.ground import GRASS, GREY_PER_K
from tirgeo_ros.tools.simulate.map_file import collection, point_feature
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.relief import LEVEL, Relief
from tirgeo_ros.tools.simulate.scenario import Scenario

Floats = npt.NDArray[np.float32]

#: Ranges for seeded targets: contrast to the grass (K) and size (m).
_SEEDED = {
    "person": ((10.0, 14.0), (0.45, 0.55)),
    "fire": ((300.0, 500.0), (1.0, 3.0)),
    "vehicle": ((3.0, 6.0), (4.3, 4.7)),
}
_VEHICLE_WIDTH = 2.0 / 4.5  # per length
_PARTS = 8  # of a pixel, in each direction
_COARSEST_M = 5.0  # pixels that cover more ground than this show no target
_OFFSETS = (np.arange(_PARTS, dtype=np.float32) + 0.5) / _PARTS - 0.5


@dataclass(frozen=True, eq=False)
class Target:
    """Hold a warm object on the ground: a square, for a fire a disc, for a vehicle a rectangle."""

    id: str  # ``person 1``
    kind: str  # person, fire, vehicle
    center: Array  # (2,) m, north and east of the site's origin
    warmer_k: float  # contrast to the grass
    size_m: float  # side of a person, diameter of a fire, length of a vehicle
    heading_rad: float

    def covers(self, along: Floats, across: Floats) -> npt.NDArray[np.bool_]:
        """Return whether it covers places, m along and across its heading from its middle."""
        if self.kind == "fire":
            return np.asarray(along**2 + across**2 < (self.size_m / 2) ** 2)
        width_m = self.size_m * (_VEHICLE_WIDTH if self.kind == "vehicle" else 1)
        return np.asarray((np.abs(along) < self.size_m / 2) & (np.abs(across) < width_m / 2))


def targets_of(scenario: Scenario, seed: int) -> list[Target]:
    """Return the targets of a scenario: of each kind the given ones, then the seeded ones."""
    scene, park = scenario.scene, scenario.park
    low, high = np.transpose([park.north_m, park.east_m])
    targets = []
    for kind, given, count in (
        ("person", scene.people_at, scene.people),
        ("fire", scene.fires_at, scene.fires),
        ("vehicle", scene.vehicles_at, scene.vehicles),
    ):
        rows = list(np.reshape(given, (-1, 4)))
        for number in range(len(rows) + count):
            # Each target has its own generator, so that one more does not move the others.
            rng = generator(seed, f"{kind} {number + 1}")
            heading = rng.uniform(0.0, 2 * math.pi)
            drawn = [*rng.uniform(low, high), *(rng.uniform(*of) for of in _SEEDED[kind])]
            row = np.array(rows[number] if number < len(rows) else drawn)
            warmer_k, size_m = row[2:].tolist()
            name = f"{kind} {number + 1}"
            targets.append(Target(name, kind, row[:2], warmer_k, size_m, heading))
    return targets


def targets_text(targets: list[Target], plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the targets as GeoJSON points with ``id``, ``kind``, contrast (K) and size (m)."""
    features = []
    for one in targets:
        about: dict[str, object] = {
            "id": one.id,
            "kind": one.kind,
            "warmer_k": round(one.warmer_k, 3),
            "size_m": round(one.size_m, 3),
        }
        features.append(point_feature(about, one.center, plane, relief))
    return collection(features)


def draw_targets(picture: Floats, targets: Sequence[Target], north: Floats, east: Floats) -> None:
    """Draw targets into a picture (h, w) of grey levels, later ones over earlier ones.

    ``north`` and ``east`` (h, w) are the ground position that each pixel's middle sees, m.
    """
    if not targets:
        return
    middle = slice(picture.shape[1] // 2, picture.shape[1] // 2 + 2)
    pixel_m = _pixel_m(north[:, middle], east[:, middle])
    for target in targets:
        reach_m = pixel_m + target.size_m
        near = np.abs(north - target.center[0]) < reach_m
        near &= np.abs(east - target.center[1]) < reach_m
        near &= pixel_m < _COARSEST_M
        if near.any():
            rows, columns = (_around(near.any(axis=axis)) for axis in (1, 0))
            seen = picture[rows, columns]
            share = _share(target, north[rows, columns], east[rows, columns])
            seen += share * (GRASS + GREY_PER_K * target.warmer_k - seen)


def _pixel_m(north: Floats, east: Floats) -> Floats:
    """Return the longest extent (h, 1), m, on the ground of a pixel of each row."""
    sides = [np.hypot(*(np.gradient(of, axis=axis) for of in (north, east))) for axis in (0, 1)]
    return np.asarray((sides[0] + sides[1])[:, :1])


def _around(marked: npt.NDArray[np.bool_]) -> slice:
    """Return the range of the marked items, with one more on either side."""
    found = np.flatnonzero(marked)
    return slice(max(int(found[0]) - 1, 0), int(found[-1]) + 2)


def _share(target: Target, north: Floats, east: Floats) -> Floats:
    """Return the share (h, w) of each pixel that the target covers."""
    cos, sin = np.cos(target.heading_rad), np.sin(target.heading_rad)
    n, e = north - target.center[0], east - target.center[1]
    inside = target.covers(_in_parts(cos * n + sin * e), _in_parts(cos * e - sin * n))
    return np.asarray(inside.mean(axis=(0, 1)), np.float32)


def _in_parts(values: Floats) -> Floats:
    """Return values (parts, parts, h, w) over each pixel, linear there."""
    by_row, by_column = np.gradient(values)
    rows, columns = np.meshgrid(_OFFSETS, _OFFSETS, indexing="ij")
    return np.asarray(
        values + rows[..., None, None] * by_row + columns[..., None, None] * by_column
    )
