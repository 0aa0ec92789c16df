"""Define the targets of a search: people, fires and vehicles, their positions and warmth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.map_file import collection, point_feature
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.relief import LEVEL, Relief
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.warm_spots import Patch

#: Ranges for seeded targets: contrast to the grass (K) and size (m).
_SEEDED = {
    "person": ((10.0, 14.0), (0.45, 0.55)),
    "fire": ((300.0, 500.0), (1.0, 3.0)),
    "vehicle": ((3.0, 6.0), (4.3, 4.7)),
}
_BONNET_K, _BONNET = 8.0, 0.28  # contrast to the rest of a vehicle, and its share of the length
_WIDTH = 2.0 / 4.5  # of a vehicle, per length


@dataclass(frozen=True, eq=False)
class Target:
    """Hold a warm object on the ground."""

    id: str  # ``person 1``
    kind: str  # person, fire, vehicle
    center: Array  # (2,) m, north and east of the site's origin
    warmer_k: float  # contrast to the grass
    size_m: float  # side of a person, diameter of a fire, length of a vehicle
    heading_rad: float

    def patches(self) -> list[Patch]:
        """Return the patches that the thermal camera sees."""
        half = self.size_m / 2
        if self.kind != "vehicle":
            is_fire = self.kind == "fire"
            return [Patch(self.center, (half, half), self.heading_rad, self.warmer_k, is_fire)]
        ahead = np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])
        aside, bonnet = half * _WIDTH, half * _BONNET
        front = self.center + (half - bonnet) * ahead
        return [
            Patch(self.center, (half, aside), self.heading_rad, self.warmer_k),
            Patch(front, (bonnet, aside), self.heading_rad, self.warmer_k + _BONNET_K),
        ]


def targets_of(scenario: Scenario, seed: int) -> list[Target]:
    """Return the targets of a scenario: of each kind the given ones, then the seeded ones."""
    scene = scenario.scene
    wanted = {
        "person": (scene.people_at, scene.people),
        "fire": (scene.fires_at, scene.fires),
        "vehicle": (scene.vehicles_at, scene.vehicles),
    }
    return [
        target
        for kind, (given, count) in wanted.items()
        for target in _of_kind(scenario, seed, kind, np.reshape(given, (-1, 4)), count)
    ]


def _of_kind(
    scenario: Scenario, seed: int, kind: str, given: Array, count: int
) -> Iterator[Target]:
    park = scenario.park
    low, high = np.transpose([park.north_m, park.east_m])
    for number in range(1, len(given) + count + 1):
        # Each target has its own generator, so that one more does not move the others.
        rng = generator(seed, f"{kind} {number}")
        heading = rng.uniform(0.0, 2 * math.pi)
        row = np.array([*rng.uniform(low, high), *(rng.uniform(*of) for of in _SEEDED[kind])])
        if number <= len(given):
            row = given[number - 1]
        yield Target(f"{kind} {number}", kind, row[:2], float(row[2]), float(row[3]), heading)


def targets_text(targets: list[Target], plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the targets as GeoJSON points with ``id``, ``kind``, contrast (K) and size (m)."""
    return collection([_feature(target, plane, relief) for target in targets])


def _feature(target: Target, plane: TangentPlane, relief: Relief) -> dict[str, object]:
    about = {
        "id": target.id,
        "kind": target.kind,
        "warmer_k": round(target.warmer_k, 3),
        "size_m": round(target.size_m, 3),
    }
    return point_feature(about, target.center, plane, relief)
