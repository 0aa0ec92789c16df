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
"""Check RTK against itself: the path between two fixes is the integral of its velocities.

Both are of one antenna, so the comparison needs neither a lever arm nor the IMU. Where the two
contradict each other for long, although each passes its gate, the path by the IMU shows which of
them is wrong, and that one is refused while the contradiction lasts. A step of either is left to
the gates. The records are part of ``AidStatus``, so late measurements are judged the same way.
"""

from __future__ import annotations

import bisect
import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins.kalman import chi_square_limit
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample

#: Fixes and velocities are compared over the window. The pairs of the time before it give the
#: mean velocity with which the IMU's path is continued.
WINDOW_NS = 2_000_000_000
_BEFORE_NS = 1_000_000_000
#: Fix and velocity are of one epoch if their stamps differ by less.
_SAME_NS = 5_000_000
#: With fewer intervals in a window a step cannot be told from a lasting difference.
_LEAST_INTERVALS = 4
_LONGEST_GAP_NS = 1_000_000_000
#: A contradiction begins above the first squared distance and ends below the second.
_BEGIN, _END = chi_square_limit(5.0, 3), chi_square_limit(3.0, 3)
#: Fixes hold the position, so a larger distance is needed to refuse them.
_BEGIN_AGAINST_FIXES = chi_square_limit(6.0, 3)
_VELOCITY_PAIRS, _FIX_PAIRS = 2, 3  # pairs whose mean decides
#: If the two largest intervals hold more than this share of a change, it is a step, not a drift.
_STEP_SHARE = 0.7
#: Share of the contradiction by which the velocities have left the IMU's path: above the first
#: value they are wrong, below the second the fixes. The IMU is wrong if the share is outside 0 to
#: 1 by more than the first value.
_LEAST_LEFT, _MOST_STAYED = 0.6, 0.4
#: Before the window the two may have drifted apart by this share of the contradiction.
_MOST_BEFORE = 0.25
#: Time for which the two must have agreed before one is blamed, its upper limit, and the factor by
#: which disagreement reduces it faster. So no source is blamed for a difference that exists from
#: the start, or comes and goes. Even from the limit, a source can be blamed only in the first
#: 1.3 s of a contradiction: later the window holds too little of the time before it.
_AGREED_NS, _LONGEST_AGREED_NS, _FORGET = 3_000_000_000, 7_000_000_000, 3
#: Longest time for which fixes are refused and velocities and the IMU carry the position.
_LONGEST_AGAINST_FIXES_NS = 20_000_000_000
#: Bounds of a variance: the lower covers the rounding of sums that have grown large.
_LEAST_M2, _MOST_M2 = 1e-8, 1e4
#: Prior sigma of the latency of velocities, which receivers smooth, and its lower limit.
_LAG_S, _LEAST_LAG_S = 0.05, 0.01
_ZERO = np.zeros(3)


class FixPair(NamedTuple):
    """Hold fix and velocity of one epoch, and sums over all epochs up to it; arrays (3,)."""

    fix: PositionSample
    fix_m2: Array  # variances of the fix
    velocity_n: Array  # m/s
    against_imu_n: Array  # m/s, velocity less that of the IMU alone
    slope_n: Array = _ZERO  # m/s2, of the velocities since the pair before
    drift_n: Array = _ZERO  # m, path between fixes less the integral of the velocities
    left_n: Array = _ZERO  # m, integral of ``against_imu_n``
    spread_m2: Array = _ZERO  # variances of the integral of the velocities

    @property
    def stamp_ns(self) -> int:
        """Return the time stamp of the fix."""
        return self.fix.stamp_ns

    def after(self, before: FixPair, variances: Array, *, second: bool) -> FixPair:
        """Return the pair with its sums; ``variances`` (m2/s2) are those of its velocity.

        The trapezoidal rule errs by step^2 / 12 times the change of slope across the interval.
        """
        step_s = (self.stamp_ns - before.stamp_ns) * 1e-9
        slope_n = (self.velocity_n - before.velocity_n) / step_s
        bend_m = 0.0 if second else step_s * step_s / 12 * (slope_n - before.slope_n)
        way_n = 0.5 * step_s * (before.velocity_n + self.velocity_n)
        left_n = 0.5 * step_s * (before.against_imu_n + self.against_imu_n)
        return self._replace(
            slope_n=slope_n,
            drift_n=before.drift_n + path_n(before.fix, self.fix) - way_n,
            left_n=before.left_n + left_n,
            spread_m2=before.spread_m2 + step_s * step_s * variances + bend_m * bend_m,
        )


class Lag(NamedTuple):
    """Hold the latency of the velocities, learned while they agree with the fixes."""

    mean_s: float = 0.0
    variance_s2: float = _LAG_S**2
    learned_ns: int = 0  # the newest pair used

    def learned(self, first: FixPair, last: FixPair) -> Lag:
        """Return the latency after one more window; unchanged if it overlaps the last one used."""
        if first.stamp_ns < self.learned_ns:
            return self
        change = last.velocity_n - first.velocity_n
        weights = change / _variances(first, last)
        off_n = last.drift_n - first.drift_n - self.mean_s * change
        variance = 1 / (1 / self.variance_s2 + float(weights @ change))
        mean_s = self.mean_s + variance * float(weights @ off_n)
        return Lag(mean_s, max(variance, _LEAST_LAG_S**2), last.stamp_ns)


class Consistency(NamedTuple):
    """Hold the newest pairs of fix and velocity, and which source is refused."""

    fix: PositionSample | None = None  # waits for the velocity of its epoch
    fix_m2: Array = _ZERO
    pairs: tuple[FixPair, ...] = ()
    lag: Lag = Lag()
    agreed_ns: int = 0  # for how long fixes and velocities have agreed lately
    since_ns: int = 0  # stamp of the first contradicting pair; 0: they agree
    against: Source | None = None
    shares: tuple[float, ...] = ()  # shares of blame (see ``_blame``), by contradicting pair
    off_m_s: float = 0.0  # the newest contradiction over its time

    def reason(self, source: Source) -> str:
        """Return why a measurement of a source is refused, or an empty string."""
        if source is not self.against:
            return ""
        other = "rtk/vel" if source is Source.RTK_POSITION else "the differences of rtk/fix"
        return f"{self.off_m_s:.2f} m/s off {other}"

    def with_fix(self, sample: PositionSample, noise: Array) -> Consistency:
        """Return a copy with a position, ``noise`` (3, 3) m2; one not fixed clears the records."""
        if sample.status is not FixStatus.FIXED:
            return Consistency(lag=self.lag)
        return self._replace(fix=sample, fix_m2=np.minimum(noise.diagonal(), _MOST_M2))

    def with_velocity(
        self, sample: VelocitySample, noise: Array, against_imu_n: Vector
    ) -> Consistency:
        """Return a copy with a velocity, compared if it has a fix; ``noise`` (3, 3) m2/s2.

        ``against_imu_n`` (m/s) is the velocity less that of the IMU alone, without corrections.
        """
        fix, pairs = self.fix, self.pairs
        if fix is None or abs(sample.stamp_ns - fix.stamp_ns) > _SAME_NS:
            return self
        pair = FixPair(fix, self.fix_m2, sample.velocity_n, np.array(against_imu_n))
        if not pairs or not 0 < fix.stamp_ns - pairs[-1].stamp_ns <= _LONGEST_GAP_NS:
            return Consistency(fix, self.fix_m2, (pair,), self.lag)
        variances = np.minimum(noise.diagonal(), _MOST_M2)
        pair = pair.after(pairs[-1], variances, second=len(pairs) == 1)
        drop = _first_index(pairs, fix.stamp_ns - WINDOW_NS - _BEFORE_NS)
        return self._replace(pairs=(*pairs[drop:], pair)).judged()

    def judged(self) -> Consistency:
        """Return a copy after the comparison over the window that ends with the newest pair."""
        pairs = self.pairs
        last_ns = pairs[-1].stamp_ns
        window = pairs[_first_index(pairs, last_ns - WINDOW_NS) :]
        if len(window) <= _LEAST_INTERVALS:
            return self
        squared, off_n = distance(window[0], window[-1], self.lag)
        step_ns = last_ns - pairs[-2].stamp_ns
        limit, share = (_END, 1.0) if self.since_ns else (_BEGIN, _STEP_SHARE)
        if squared <= limit or not _grows_steadily(window, off_n, share):
            agrees = squared <= _END
            agreed_ns = self.agreed_ns + (step_ns if agrees else -_FORGET * step_ns)
            return self._replace(
                lag=self.lag.learned(window[0], window[-1]) if agrees else self.lag,
                agreed_ns=min(max(agreed_ns, 0), _LONGEST_AGREED_NS),
                since_ns=0,
                against=None,
                shares=(),
            )
        off_m_s = math.hypot(*off_n) / ((last_ns - window[0].stamp_ns) * 1e-9)
        contradicted = self._replace(since_ns=self.since_ns or last_ns, off_m_s=off_m_s)
        if self.against is None:
            left = _blame(pairs[0], window, off_n) if self.agreed_ns >= _AGREED_NS else None
            return contradicted.blaming(left, step_ns, clearly=squared > _BEGIN_AGAINST_FIXES)
        long = last_ns - contradicted.since_ns > _LONGEST_AGAINST_FIXES_NS
        if long and self.against is Source.RTK_POSITION:
            return Consistency(self.fix, self.fix_m2, lag=self.lag)
        return contradicted

    def blaming(self, left: float | None, step_ns: int, *, clearly: bool) -> Consistency:
        """Return a copy with one more share ``left``; fixes are blamed only if ``clearly``."""
        agreed_ns = max(self.agreed_ns - _FORGET * step_ns, 0)
        shares, against = self.shares, None
        if left is not None and -_LEAST_LEFT < left < 1 + _LEAST_LEFT:
            shares = (*shares, left)
        if len(shares) >= _VELOCITY_PAIRS and sum(shares) > _LEAST_LEFT * len(shares):
            against = Source.RTK_VELOCITY
        elif len(shares) >= _FIX_PAIRS and clearly and sum(shares) < _MOST_STAYED * len(shares):
            against = Source.RTK_POSITION
        return self._replace(agreed_ns=agreed_ns, shares=shares, against=against)


def _first_index(pairs: tuple[FixPair, ...], begin_ns: int) -> int:
    """Return the index of the first pair that is not older than a stamp."""
    return bisect.bisect_left(pairs, begin_ns - _SAME_NS, key=lambda pair: pair.stamp_ns)


def _grows_steadily(window: tuple[FixPair, ...], off_n: Array, share: float) -> bool:
    """Return whether a contradiction has grown over the whole window, not in two intervals."""
    along = np.array([pair.drift_n for pair in window]) @ off_n
    return bool(np.sort(np.diff(along))[-2:].sum() < share * (along[-1] - along[0]))


def _blame(oldest: FixPair, window: tuple[FixPair, ...], off_n: Array) -> float | None:
    """Return the share of a contradiction by which the velocities have left the IMU's path.

    Zero means that the fixes have left it. The IMU's path continues with the mean velocity that
    the receiver had before the window. None if fixes and velocities disagreed then, too.
    """
    begin, last = window[0], window[-1]
    before_ns = begin.stamp_ns - oldest.stamp_ns
    squared = float(off_n @ off_n)
    if before_ns < 0.5 * _BEFORE_NS:
        return None
    if abs(off_n @ (begin.drift_n - oldest.drift_n)) > _MOST_BEFORE * squared:
        return None
    ratio = (last.stamp_ns - begin.stamp_ns) / before_ns
    left_n = last.left_n - begin.left_n - ratio * (begin.left_n - oldest.left_n)
    return float(-off_n @ left_n) / squared


def distance(first: FixPair, last: FixPair, lag: Lag) -> tuple[float, Array]:
    """Return the squared distance of two paths (3 degrees of freedom) and their difference.

    The difference (m) is the path between the fixes of two epochs less the integral of the
    velocities. Velocities that are late by ``lag`` change it by lag times their change l. With the
    lag's variance s, the variance is D + s l l'; its inverse is by Sherman and Morrison's formula.
    """
    change = last.velocity_n - first.velocity_n
    off_n = last.drift_n - first.drift_n - lag.mean_s * change
    weighted = off_n / (variances := _variances(first, last))
    along, weight = weighted @ change, change @ (change / variances)
    return float(off_n @ weighted - along * along / (1 / lag.variance_s2 + weight)), off_n


def _variances(first: FixPair, last: FixPair) -> Array:
    """Return the variances of the difference, per axis (m2), without the latency's."""
    spread_m2 = last.spread_m2 - first.spread_m2
    return np.maximum(first.fix_m2 + last.fix_m2 + spread_m2, _LEAST_M2)


def path_n(a: PositionSample | NavState, b: PositionSample) -> Vector:
    """Return the path from ``a`` to ``b``, NED m."""
    meridian, transverse = radii_of_curvature(a.latitude_rad)
    east = (b.longitude_rad - a.longitude_rad + math.pi) % (2 * math.pi) - math.pi
    middle = 0.5 * (b.latitude_rad + a.latitude_rad)
    return (
        (b.latitude_rad - a.latitude_rad) * (meridian + a.height_m),
        east * (transverse + a.height_m) * math.cos(middle),
        a.height_m - b.height_m,
    )
