"""Propagate state and covariance through an interval between two IMU samples.

The covariance follows the state at a lower rate, and at every measurement.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.delayed_measurements import Carried, Epoch, between
from tirgeo_ros.core.navigation.ins_error_model import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    CovariancePropagation,
)
from tirgeo_ros.core.navigation.smoothing.trail import Change, Mark
from tirgeo_ros.core.navigation.strapdown import propagate, rotate
from tirgeo_ros.core.types.arrays import Vector

#: Longest single step of the state.
_LARGEST_STEP_S = 0.02
#: Shortest step of the covariance; it gives steps of 50 ms at IMU rates of 100 to 400 Hz.
_COVARIANCE_STEP_S = 0.0495
#: An interval longer than that of the slowest IMU, with jitter, has lost samples.
_LOST_SAMPLES_S = 0.035
#: Motion possible in such an interval beyond what the samples around it show.
_UNSEEN_RATE_RAD_S = 0.03
_UNSEEN_FORCE_M_S2 = 0.2
#: Rms of a number uniform in 0 to 1: the unknown share of the motion that did not take place.
_UNIFORM_RMS = 0.58


class Propagation:
    """Propagate the filter's state between IMU samples."""

    def __init__(self, config: EkfConfig) -> None:
        self._propagation = CovariancePropagation(config)

    def whole(self, carried: Carried, start: Epoch, end: Epoch) -> Carried:
        """Propagate through a whole interval without measurements."""
        if end.step_s <= _LARGEST_STEP_S:
            return self._stepped(carried, end, end.mean_force_b, end.mean_rate_b, end.step_s)
        return self.part(carried, start, end, start.stamp_ns, end.stamp_ns)

    def part(
        self, carried: Carried, start: Epoch, end: Epoch, from_ns: int, to_ns: int
    ) -> Carried:
        """Propagate through a part of an interval; readings are linear between two samples."""
        steps = -(-(to_ns - from_ns) // round(_LARGEST_STEP_S * 1e9))
        for step in range(steps):
            middle_ns = from_ns + (to_ns - from_ns) * (2 * step + 1) // (2 * steps)
            step_s = (to_ns - from_ns) * 1e-9 / steps
            carried = self._stepped(carried, end, *between(start, end, middle_ns), step_s)
        if steps and to_ns == end.stamp_ns and end.step_s > _LOST_SAMPLES_S:
            return self._bridged(carried, start, end)
        return carried

    def _stepped(
        self, carried: Carried, end: Epoch, force_b: Vector, rate_b: Vector, step_s: float
    ) -> Carried:
        before, covariance, control, lag_s, start, middle, _, trail = carried
        state, rates = propagate(before, force_b, rate_b, step_s)
        if start is None:
            start = before
        if middle is None or lag_s <= 0.5 * _COVARIANCE_STEP_S:
            middle = rates
        lag_s += step_s
        lagging = (state, covariance, control, lag_s, start, middle, end.vibration, trail)
        carried = tuple.__new__(Carried, lagging)  # half the time of Carried(...)
        return self.followed(carried) if lag_s >= _COVARIANCE_STEP_S else carried

    def followed(self, carried: Carried) -> Carried:
        """Return ``carried`` with its covariance propagated to the state's time."""
        state, covariance, control, lag_s, start, rates, vibration, trail = carried
        if start is None or rates is None:
            return carried
        (n0, e0, d0), (n1, e1, d1) = start.velocity_n, state.velocity_n
        # Mean specific force: the change of velocity over time, less gravity.
        force_n = (n1 - n0) / lag_s, (e1 - e0) / lag_s, (d1 - d0) / lag_s - rates.gravity_m_s2
        covariance = self._propagation.step(covariance, start, rates, force_n, lag_s, vibration)
        if trail is not None:
            change = Change(covariance, self._propagation.transition.copy(), step_s=lag_s)
            trail = Mark(change, trail)
        return Carried(state, covariance, control, trail=trail)

    def _bridged(self, carried: Carried, start: Epoch, end: Epoch) -> Carried:
        """Return ``carried`` with a covariance enlarged for a gap between two samples.

        Unseen motion may have happened in the gap. The gap may also not exist: a clock that was
        set forward looks the same. The share of the motion that took place is then uncertain
        between none and all.
        """
        followed = self.followed(carried)
        state, covariance, _ = followed[:3]
        covariance, before, gap_s = covariance.copy(), start.carried.state, end.step_s
        rate = 0.5 * math.dist(start.rate_b, end.rate_b) + _UNSEEN_RATE_RAD_S
        force = 0.5 * math.dist(start.force_b, end.force_b) + _UNSEEN_FORCE_M_S2
        turn = rotate(rotation_of(state.q_nb), end.mean_rate_b)
        change = np.subtract(state.velocity_n, before.velocity_n)
        for block, sigma, motion in (
            (ATTITUDE, rate * gap_s, gap_s * np.array(turn)),
            (VELOCITY, force * gap_s, change),
            (POSITION, 0.5 * force * gap_s * gap_s, gap_s * np.array(state.velocity_n)),
        ):
            uncertainty = _UNIFORM_RMS**2 * np.outer(motion, motion)
            covariance[block, block] += sigma * sigma * np.eye(3) + uncertainty
        trail = followed.trail and Mark(Change(covariance), followed.trail)
        return followed._replace(covariance=covariance, trail=trail)
