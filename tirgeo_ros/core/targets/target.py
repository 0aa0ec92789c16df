"""Define a target, its clicks, and the average of the clicks."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Ellipse, Located, ellipse_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TargetError, shown

#: Share of a click's variance that is common to all clicks of a flight. From 60 m up, seen 45 deg
#: down, the default sigmas of ground and lens give 0.11 m along the ray, the filter gives 0.1 m.
COMMON = 0.5
#: The filter's part: over simulated flights its error on the ground is correlated by 0.7 after
#: 8 s, 0.4 after 30 s and 0.2 after 60 s (``test/core/targets/test_filter_memory.py``).
MEMORY_S = 30.0
#: Clicks disagree where independent errors would differ so much once in a thousand times
#: (standard deviations of one tail).
_RARE_SIGMA = 3.09
#: The least standard deviation in Q_i, m, and as a share of the largest one.
_LEAST_M, _LEAST_SHARE = 0.01, 0.05


class Combined(NamedTuple):
    """Hold the average of some positions."""

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
    # From the first one on, so that rounding is that of the differences.
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
    """Return the chi-square that is exceeded rarely; Wilson and Hilferty, within 1 %."""
    spread = 2 / (9 * degrees)
    return degrees * (1 - spread + _RARE_SIGMA * math.sqrt(spread)) ** 3


KINDS = ("person", "fire", "vehicle", "hydrant", "building", "other")
#: Corners of an ellipse as a polygon: it lies within 0.15 % of the curve.
CORNERS = 60
_MOST_M, _MOST_M2 = 1e5, 1e8  # height, variance: beyond, it is no click on the ground
_NS = 1 << 63
#: North, east, down from east, north, up, and back.
_SWAP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


@dataclass(frozen=True, slots=True)
class Fixing:
    """Hold one located click, or the average of some.

    Raises TargetError for numbers that are no place.
    """

    stamp_ns: int  # of the clicked picture
    latitude_deg: float
    longitude_deg: float
    height_m: float  # WGS84, ellipsoidal
    covariance_enu: tuple[float, ...]  # 9 numbers, m2, row by row: east, north, up at the point

    def __post_init__(self) -> None:
        """Refuse what is no place on the ground."""
        if not (
            abs(self.stamp_ns) < _NS
            and abs(self.latitude_deg) <= 90
            and abs(self.longitude_deg) <= 180
            and abs(self.height_m) <= _MOST_M
            and len(self.covariance_enu) == 9
            and all(abs(number) <= _MOST_M2 for number in self.covariance_enu)
            and min(self.covariance_enu[::4]) >= 0
        ):
            raise TargetError(f"not a located point: {shown(astuple(self), 300)}")

    @property
    def covariance_n(self) -> Array:
        """Return the covariance (3, 3), m2, in north, east, down."""
        return np.asarray(_SWAP @ np.reshape(self.covariance_enu, (3, 3)) @ _SWAP)

    @property
    def ellipse(self) -> Ellipse:
        """Return the horizontal 95 % ellipse."""
        return ellipse_of(self.covariance_n)

    def outline(self, corners: int = CORNERS) -> list[tuple[float, float]]:
        """Return the 95 % ellipse as ``corners`` + 1 places (latitude, longitude), deg.

        Anticlockwise seen from above, closed, rounded to a tenth of a millimetre.
        """
        ellipse = self.ellipse
        turn = np.linspace(0, -2 * math.pi, corners + 1)
        along, across = ellipse.major_m * np.cos(turn), ellipse.minor_m * np.sin(turn)
        cos, sin = math.cos(ellipse.azimuth_rad), math.sin(ellipse.azimuth_rad)
        offsets_n = np.stack([along * cos - across * sin, along * sin + across * cos, 0 * turn], 1)
        offsets_n[-1] = offsets_n[0]
        latitude, longitude, _ = _plane(self).geodetic_from_ned(offsets_n)
        places = np.round(np.degrees(np.stack([latitude, longitude], axis=1)), 9)
        return [(north, east) for north, east in places.tolist()]


@dataclass(frozen=True, slots=True)
class Target:
    """Hold a target: its clicks, one at least, and what the operator says of it."""

    id: str  # 32 hexadecimal digits; the same through all edits and exports
    number: int  # 1, 2, ...; never given again
    name: str
    kind: str  # one of KINDS
    note: str
    aircraft: str  # whose video was clicked; "" for the only one
    created_ns: int
    changed_ns: int
    fixings: tuple[Fixing, ...]

    @property
    def place(self) -> Fixing:
        """Return the average of the clicks."""
        return averaged(self.fixings)

    @property
    def clicks_agree(self) -> bool:
        """Return whether the clicks can be of one place, by their covariances."""
        return disagreement(self.fixings) <= 1

    @property
    def title(self) -> str:
        """Return the name, or number and kind where there is none."""
        return self.name or f"{self.number} {self.kind}"


def fixing_of(found: Located) -> Fixing:
    """Return a located point as a click."""
    degrees = math.degrees(found.latitude_rad), math.degrees(found.longitude_rad)
    covariance = (_SWAP @ found.covariance_n @ _SWAP).ravel().tolist()
    return Fixing(found.stamp_ns, *degrees, found.height_m, tuple(covariance))


def averaged(fixings: Sequence[Fixing]) -> Fixing:
    """Return the average of clicks, one at least, with an honest covariance.

    See ``averaging``. The order of the clicks does not matter; one click is returned as it is.
    The stamp is the newest one. Where the clicks disagree, the covariance is wider.
    """
    return _average(tuple(fixings))[0]


def disagreement(fixings: Sequence[Fixing]) -> float:
    """Return the squared differences of the clicks over their limit: above 1 they disagree."""
    return _average(tuple(fixings))[1]


@functools.lru_cache(maxsize=4096)  # a page asks for each target at each change
def _average(fixings: tuple[Fixing, ...]) -> tuple[Fixing, float]:
    if len(fixings) == 1:
        return fixings[0], 0.0
    fixings = tuple(sorted(fixings, key=astuple))  # for the same rounding in any order
    plane = _plane(fixings[0])
    axes = [_axes(plane, one) for one in fixings]
    latitudes = np.radians([one.latitude_deg for one in fixings])
    longitudes = np.radians([one.longitude_deg for one in fixings])
    heights_m = np.array([one.height_m for one in fixings])
    found = combined(
        plane.ned_from_geodetic(latitudes, longitudes, heights_m),
        np.array([turn @ f.covariance_n @ turn.T for turn, f in zip(axes, fixings, strict=True)]),
        np.array([(one.stamp_ns - fixings[0].stamp_ns) * 1e-9 for one in fixings]),
    )
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(found.position))
    turn = plane.rotation_from_local(latitude, longitude) @ _SWAP
    covariance_enu = np.clip(turn.T @ found.covariance @ turn, -_MOST_M2, _MOST_M2)
    covariance = tuple(covariance_enu.ravel().tolist())
    place = (math.degrees(latitude), math.degrees(longitude), height_m)
    return Fixing(fixings[-1].stamp_ns, *place, covariance), found.test_ratio


def _plane(fixing: Fixing) -> TangentPlane:
    latitude, longitude = math.radians(fixing.latitude_deg), math.radians(fixing.longitude_deg)
    return TangentPlane(latitude, longitude, fixing.height_m)


def _axes(plane: TangentPlane, fixing: Fixing) -> Array:
    """Return the rotation (3, 3) from north, east, down at a click to the plane's axes."""
    latitude, longitude = math.radians(fixing.latitude_deg), math.radians(fixing.longitude_deg)
    return plane.rotation_from_local(latitude, longitude)
