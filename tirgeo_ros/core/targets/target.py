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
"""Define a target, its clicks, and the average of the clicks."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.ground.ground_point import MOST_M2, Located, enu_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TargetError, cut

# The average of clicks.
#: Share of a click's variance that is common to all clicks of a flight. From 60 m up, looking
#: 45 deg down, the default sigmas of ground and lens give 0.11 m along the ray, the filter 0.1 m.
#: The gimbal's north, boresight and focal length have one error in all clicks, which clicks from
#: opposite sides cancel: where these are not calibrated, look from several sides.
COMMON = 0.5
#: Correlation time of the rest, the filter's error: over simulated flights, on the ground, it is
#: correlated by 0.7 after 8 s, 0.4 after 30 s, 0.2 after 60 s (test/core/targets/test_target.py).
MEMORY_S = 30.0
#: Clicks disagree if independent errors would differ that much in one case of a thousand
#: (standard deviations, one tail).
_RARE_SIGMA = 3.09
#: Least standard deviation that a weight is computed from, m, and as a share of the largest one.
_LEAST_M, _LEAST_SHARE = 0.01, 0.05
#: Chi-square of two degrees of freedom, 99 %: places nearer than this can be the same.
_SAME_PLACE = 9.21
# A target.
#: Kind -> its colour, "#" and red, green, blue, of the palette of ATAK's spots, on the page and in
#: the team's programs.
COLOURS = {
    "person": "#ff0000",
    "fire": "#ff7700",
    "vehicle": "#ff00ff",
    "hydrant": "#00ffff",
    "building": "#ffff00",
    "other": "#ffffff",
}
KINDS = (*COLOURS,)
NEW = "new"  # the status that a target begins with
STATUSES = (NEW, "checked", "found", "dismissed")
MOST_TARGETS = 2000  # in a file, and drawn
_LONGEST_LABEL = 60  # characters


class Combined(NamedTuple):
    """Hold the average of several positions."""

    position: Array  # (3,) m
    covariance: Array  # (3, 3) m2
    test_ratio: float  # squared differences over their limit: above 1 the positions disagree


def combined(positions: Array, covariances: Array, times_s: Array) -> Combined:
    """Return the average of positions (n, 3), m, with covariances (n, 3, 3), m2, at times (n,).

    n is 2 or more. Where the positions disagree, their own scatter is added to the covariance.
    """
    values, vectors = np.linalg.eigh(covariances)  # ascending
    values = np.maximum(values, 0.0)
    least = np.maximum(_LEAST_M**2, _LEAST_SHARE**2 * values[:, 2:])

    def of_values(changed: Array) -> Array:
        return np.asarray((vectors * changed[:, None, :]) @ vectors.transpose(0, 2, 1))

    moment = np.exp(-np.abs(times_s[:, None] - times_s) / MEMORY_S)
    information = of_values(1 / np.maximum(values, least))
    weighted = information / moment.sum(axis=1)[:, None, None]
    weights = np.linalg.solve(weighted.sum(axis=0), weighted)
    # Averaged relative to the first position, so that only the differences are rounded.
    position = positions[0] + np.einsum("nij,nj->i", weights, positions - positions[0])
    parts = weights @ of_values(np.sqrt(values))
    shares = COMMON + (1 - COMMON) * moment
    covariance = np.einsum("nm,nij,mkj->ik", shares, parts, parts)
    off = positions - position
    squared = float(np.einsum("ni,nij,nj->", off, information, off))
    degrees = 3 * (len(positions) - 1)
    ratio = squared / _limit(degrees)
    if ratio > 1:
        covariance += off.T @ off / (len(off) - 1)
    return Combined(position, 0.5 * (covariance + covariance.T), ratio)


def _limit(degrees: int) -> float:
    """Return the chi-square exceeded once in a thousand; Wilson and Hilferty, within 1 %."""
    spread = 2 / (9 * degrees)
    return degrees * (1 - spread + _RARE_SIGMA * math.sqrt(spread)) ** 3


@dataclass(frozen=True, slots=True)
class Target:
    """Hold a target: its clicks, at least one, and the operator's description."""

    id: str  # 32 hexadecimal digits; the same through all edits and exports
    number: int  # 1, 2, ...; never used again
    name: str
    kind: str  # one of KINDS
    note: str
    aircraft: str  # whose video was clicked; "" for the only one
    created_ns: int
    changed_ns: int
    clicks: tuple[Located, ...]
    status: str = NEW  # one of STATUSES

    def __post_init__(self) -> None:
        """Raise TargetError for a click that cannot be a point on the ground."""
        for click in self.clicks:
            check(click)

    @property
    def place(self) -> Located:
        """Return the average of the clicks."""
        return averaged(self.clicks)

    @property
    def clicks_agree(self) -> bool:
        """Return whether the clicks can be of the same place, by their covariances."""
        return disagreement(self.clicks) <= 1

    @property
    def title(self) -> str:
        """Return the name, or number and kind if it has no name."""
        return self.name or f"{self.number} {self.kind}"

    @property
    def label(self) -> str:
        """Return the text beside its mark: number, kind and name."""
        name = f": {self.name}" if self.name else ""
        return cut(f"{self.number} {self.kind}{name}", _LONGEST_LABEL)


def averaged(clicks: Sequence[Located]) -> Located:
    """Return the average of clicks, at least one, with its covariance, as ``combined`` does.

    The order of the clicks does not matter; one click is returned as it is. The stamp is the
    newest one. If the clicks disagree, the covariance is larger. Raises TargetError if the clicks
    are so far apart that their average is not a point on the ground.
    """
    return _average(tuple(clicks))[0]


def disagreement(clicks: Sequence[Located]) -> float:
    """Return the clicks' squared differences divided by the limit: above 1 they disagree."""
    return _average(tuple(clicks))[1]


@functools.lru_cache(maxsize=4096)  # a page asks for each target at each change
def _average(clicks: tuple[Located, ...]) -> tuple[Located, float]:
    if len(clicks) == 1:
        return clicks[0], 0.0
    clicks = tuple(sorted(clicks, key=_numbers))  # for the same rounding in any order
    plane = clicks[0].plane
    turns = [
        plane.rotation_from_local(click.latitude_rad, click.longitude_rad) for click in clicks
    ]
    latitudes = np.radians([click.latitude_deg for click in clicks])
    longitudes = np.radians([click.longitude_deg for click in clicks])
    heights_m = np.array([click.height_m for click in clicks])
    average = combined(
        plane.ned_from_geodetic(latitudes, longitudes, heights_m),
        np.array([r @ click.covariance_n @ r.T for r, click in zip(turns, clicks, strict=True)]),
        np.array([(click.stamp_ns - clicks[0].stamp_ns) * 1e-9 for click in clicks]),
    )
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(average.position))
    turn = plane.rotation_from_local(latitude, longitude)
    covariance = np.clip(enu_of(turn.T @ average.covariance @ turn), -MOST_M2, MOST_M2)
    place = (math.degrees(latitude), math.degrees(longitude), height_m)
    middle = Located(clicks[-1].stamp_ns, *place, tuple(covariance.tolist()))
    check(middle)
    return middle, average.test_ratio


def near(place: Located, targets: Sequence[Target]) -> list[Target]:
    """Return the targets that can be at a place, by both horizontal covariances, nearest first."""
    if not targets:
        return []
    others = [target.place for target in targets]
    latitudes = np.radians([p.latitude_deg for p in others])
    longitudes = np.radians([p.longitude_deg for p in others])
    heights_m = np.array([p.height_m for p in others])
    off = place.plane.ned_from_geodetic(latitudes, longitudes, heights_m)[:, :2]
    sums = np.array([p.covariance_n[:2, :2] for p in others]) + place.covariance_n[:2, :2]
    sums += np.eye(2) * _LEAST_M**2
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(sums, off[..., None])[..., 0])
    order = np.argsort(np.hypot(*off.T), kind="stable")
    return [targets[i] for i in order.tolist() if squared[i] <= _SAME_PLACE]


def known_status(text: object) -> str:
    """Return a status as another version or program wrote it, NEW for an unknown one."""
    return text if isinstance(text, str) and text in STATUSES else NEW


def check(click: Located) -> None:
    """Raise TargetError for numbers that cannot be a point on the ground."""
    if click.fault:
        raise TargetError(click.fault)


def _numbers(click: Located) -> tuple[object, ...]:
    place = click.latitude_deg, click.longitude_deg, click.height_m
    return click.stamp_ns, *place, click.covariance_enu
