"""Compare two paths of the RTK antenna: between its fixes, and by the integral of its velocities.

Sums along the flight make a comparison over any window the difference of two records.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.strapdown import Vector
from tirgeo_ros.core.types.arrays import Array

#: Bounds of a variance: the lower covers the rounding of sums that have grown large.
_LEAST_M2 = 1e-8
_MOST_M2 = 1e4
#: Prior sigma of a receiver's velocity latency, for it smooths, and the least sigma it may reach.
_LAG_S, _LEAST_LAG_S = 0.05, 0.01
_ZERO: Vector = (0.0, 0.0, 0.0)


class Fix(NamedTuple):
    """Hold a fixed position that waits for the velocity of its epoch."""

    stamp_ns: int
    latitude_rad: float
    longitude_rad: float
    height_m: float
    variances: Vector  # m2


class FixPair(NamedTuple):
    """Hold fix and velocity of one epoch, and sums over the velocities up to it."""

    fix: Fix
    velocity_n: Vector  # m/s
    against_imu_n: Vector  # m/s, velocity less that which the IMU alone would have
    slope_n: Vector = _ZERO  # m/s2, of the velocities since the pair before
    drift_n: Vector = _ZERO  # m, path between fixes less the integral of the velocities
    left_n: Vector = _ZERO  # m, integral of ``against_imu_n``
    spread: Vector = _ZERO  # m2, variance of the integral of the velocities

    @property
    def stamp_ns(self) -> int:
        """Return the time stamp of the fix."""
        return self.fix.stamp_ns


class Lag(NamedTuple):
    """Hold the latency of the velocities, learned where they agree with the fixes."""

    mean_s: float = 0.0
    variance_s2: float = _LAG_S**2
    learned_ns: int = 0  # the newest pair used

    def learned(self, first: FixPair, last: FixPair) -> Lag:
        """Return the latency after one more window; one that overlaps the last changes nothing."""
        if first.stamp_ns < self.learned_ns:
            return self
        change = _difference(last.velocity_n, first.velocity_n)
        off_n, variances = _difference(last.drift_n, first.drift_n), _variances(first, last)
        told = sum(c * c / v for c, v in zip(change, variances, strict=True))
        asks = sum(
            c * (o - self.mean_s * c) / v for c, o, v in zip(change, off_n, variances, strict=True)
        )
        variance = 1 / (1 / self.variance_s2 + told)
        mean_s = self.mean_s + variance * asks
        return Lag(mean_s, max(variance, _LEAST_LAG_S**2), last.stamp_ns)


def distance(first: FixPair, last: FixPair, lag: Lag) -> tuple[float, Vector]:
    """Return the squared distance (3 degrees of freedom) of two paths, and their difference.

    The difference (m) is the path between the fixes of two epochs less the integral of the
    velocities. Velocities that are late by ``lag`` change it by lag times their change l. With the
    lag's variance s, the variance is D + s l l'; its inverse is by Sherman and Morrison's formula.
    """
    change = _difference(last.velocity_n, first.velocity_n)
    x, y, z = _difference(last.drift_n, first.drift_n)
    off_n = (
        x - lag.mean_s * change[0],
        y - lag.mean_s * change[1],
        z - lag.mean_s * change[2],
    )
    squared = along = told = 0.0
    for off, late, variance in zip(off_n, change, _variances(first, last), strict=True):
        squared += off * off / variance
        along += off * late / variance
        told += late * late / variance
    return squared - along * along / (1 / lag.variance_s2 + told), off_n


def _variances(first: FixPair, last: FixPair) -> Vector:
    """Return the variances of the difference, per axis (m2), without the latency's."""
    a, b, early, late = first.fix.variances, last.fix.variances, first.spread, last.spread
    return (
        max(a[0] + b[0] + late[0] - early[0], _LEAST_M2),
        max(a[1] + b[1] + late[1] - early[1], _LEAST_M2),
        max(a[2] + b[2] + late[2] - early[2], _LEAST_M2),
    )


def with_sums(before: FixPair, pair: FixPair, variances: Vector, *, first: bool) -> FixPair:
    """Return a pair with its sums, from the pair before."""
    step_s = (pair.stamp_ns - before.stamp_ns) * 1e-9
    half = 0.5 * step_s
    slope, drift, left, spread = [], [], [], []
    way_n = _path_n(before.fix, pair.fix)
    for i in range(3):
        v, w = before.velocity_n[i], pair.velocity_n[i]
        rise = (w - v) / step_s
        # The trapezoid's own error is step^2 / 12 times the change of slope across the interval.
        bend = 0.0 if first else step_s * step_s / 12 * (rise - before.slope_n[i])
        slope.append(rise)
        drift.append(before.drift_n[i] + way_n[i] - half * (v + w))
        left.append(before.left_n[i] + half * (before.against_imu_n[i] + pair.against_imu_n[i]))
        spread.append(before.spread[i] + step_s * step_s * variances[i] + bend * bend)
    sums = tuple(slope), tuple(drift), tuple(left), tuple(spread)
    return FixPair(pair.fix, pair.velocity_n, pair.against_imu_n, *sums)  # type: ignore[arg-type]


def _path_n(a: Fix, b: Fix) -> Vector:
    """Return the path from one fix to another, NED m."""
    meridian, transverse = radii_of_curvature(a.latitude_rad)
    east = math.remainder(b.longitude_rad - a.longitude_rad, 2 * math.pi)
    cosine = math.cos(0.5 * (a.latitude_rad + b.latitude_rad))
    return (
        (b.latitude_rad - a.latitude_rad) * (meridian + a.height_m),
        east * (transverse + a.height_m) * cosine,
        a.height_m - b.height_m,
    )


def _difference(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def diagonal(noise: Array) -> Vector:
    """Return the variances of a covariance (3, 3), bounded to keep the sums precise."""
    a, b, c = noise[0, 0], noise[1, 1], noise[2, 2]
    return min(float(a), _MOST_M2), min(float(b), _MOST_M2), min(float(c), _MOST_M2)
