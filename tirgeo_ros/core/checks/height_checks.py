"""Check heights above ground: at rest, in flight, below the ground.

An aircraft at rest stands on the ground. It counts as at rest only if it was still for some
seconds and no part of the flight was lower: a hovering aircraft moves by centimetres, and flies
lower before or after. A flight that neither begins nor ends on the ground gives no such finding.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import attitude_of
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.streams.sanity_checks import pose_fault
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

_EVERY_NS = 250_000_000
_LONGEST_GAP_NS = 1_000_000_000
_REST_S = 3.0
_STILL_M_S = 0.05  # filtered RTK noise is slower; a hover of half a minute is faster
_STILL_M = 0.05  # distance from where the rest began
_CLIMBS_M = 5.0  # height range of the flight that proves that the rest was not a hover
_LOWER_M = 0.5  # the rest is no more than this above the flight's lowest point
#: Plausible heights of the body above ground at rest, by legs, roofs and errors of the ground.
_RESTS_M = (-2.0, 3.0)
_RESTS_ON_TERRAIN_M = (-6.0, 8.0)  # for elevation models from satellites
_BELOW_M = 2.0
_LASTS = 8  # consecutive samples: two seconds
_LARGEST_UNDULATION_M = 110.0


def ground_parameter(ground: Ground | None) -> str:
    """Return the parameter that sets the ground's height."""
    terrain = isinstance(ground, Terrain)
    return "overlay_node dem, dem_undulation_m" if terrain else "overlay_node ground_height_m"


class HeightChecks:
    """Check poses in ``plane`` over a ground."""

    def __init__(self, ground: Ground | None) -> None:
        self.plane: TangentPlane | None = None
        self.above_m = math.nan
        self._ground = ground
        self._sampled: tuple[int, Array] | None = None
        self._rest: tuple[int, Array, float] | None = None  # start, position, height above ground
        self._rested: tuple[float, float] | None = None  # height in the plane, height above ground
        self._lowest_m, self._highest_m = math.inf, -math.inf  # in the plane
        self._below = 0  # number of the newest samples that are below the ground
        self._below_m = math.nan

    def pose(self, pose: BodyPose | CameraPose) -> None:
        """Take a pose, in order of time."""
        before = self._sampled
        if before is not None and 0 <= pose.stamp_ns - before[0] < _EVERY_NS:
            return
        if pose_fault(pose.position_n, attitude_of(pose), pose.covariance):
            return
        self._sampled = pose.stamp_ns, pose.position_n
        if self.plane is None or self._ground is None:
            return
        self.above_m = self._above_m(self.plane, pose.position_n)
        if before is None or not 0 < pose.stamp_ns - before[0] < _LONGEST_GAP_NS:
            self._rest = None
            return
        way_m = float(np.linalg.norm(pose.position_n - before[1]))
        speed_m_s = way_m / ((pose.stamp_ns - before[0]) * 1e-9)
        self._update_rest(pose.stamp_ns, pose.position_n, speed_m_s)
        sigma_m = math.sqrt(max(float(pose.covariance[2, 2]), 0.0))
        is_below = self.above_m < -_BELOW_M - 4 * sigma_m
        self._below = self._below + 1 if is_below else 0
        if self._below == _LASTS:
            self._below_m = -self.above_m

    def _above_m(self, plane: TangentPlane, position_n: Array) -> float:
        latitude, longitude, height_m = plane.geodetic_from_ned(position_n)
        if isinstance(self._ground, Terrain):
            return float(height_m - self._ground.height_m(latitude, longitude))
        return float(height_m) - (math.nan if self._ground is None else self._ground)

    def _update_rest(self, stamp_ns: int, position_n: Array, speed_m_s: float) -> None:
        height_m = -float(position_n[2])
        self._lowest_m = min(self._lowest_m, height_m)
        self._highest_m = max(self._highest_m, height_m)
        rest = self._rest
        still = speed_m_s < _STILL_M_S
        if not still or rest is None or np.abs(position_n - rest[1]).max() > _STILL_M:
            self._rest = (stamp_ns, position_n, self.above_m) if still else None
            return
        if stamp_ns - rest[0] >= _REST_S * 1e9 and height_m <= self._lowest_m + _LOWER_M:
            self._rested = height_m, self.above_m

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if not math.isnan(self._below_m):
            evidence = f"{self._below_m:.1f} m below the ground"
            found.append(self._finding("below_ground", Severity.STOP, evidence, self._below_m))
        climbed = self._highest_m - self._lowest_m >= _CLIMBS_M
        if climbed and self._rested and self._rested[0] <= self._lowest_m + _LOWER_M:
            above_m = self._rested[1]
            terrain = isinstance(self._ground, Terrain)
            low, high = _RESTS_ON_TERRAIN_M if terrain else _RESTS_M
            if above_m < low or above_m > high:
                severity = Severity.STOP if above_m < 0 or terrain else Severity.CAUTION
                evidence = f"at rest, at the flight's lowest place, {above_m:.1f} m above ground"
                found.append(self._finding("height_at_rest", severity, evidence, above_m))
        return found

    def _finding(self, check: str, severity: Severity, evidence: str, off_m: float) -> Finding:
        name = "dem_undulation_m" if isinstance(self._ground, Terrain) else "ground_height_m"
        mend = f"see that the ground's height is that of this place, and {name} is ellipsoidal"
        if 5.0 < abs(off_m) < _LARGEST_UNDULATION_M:
            geoid = "one above sea level is off by the geoid's height"
            mend = f"{name}: heights are ellipsoidal; {geoid}"
        return Finding(check, severity, evidence, ground_parameter(self._ground), mend)
