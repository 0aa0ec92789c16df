"""Propagate state and covariance through an interval between two IMU samples.

The covariance follows the state at a lower rate, and at every measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ATTITUDE,
    POSITION,
    STILL,
    VELOCITY,
    CovariancePropagation,
    Powers,
    VibrationMeter,
)
from tirgeo_ros.core.navigation.ins.kalman import Change, Mark
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Rates, propagate, rotate
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample

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


E = TypeVar("E", bound="Epoch")


class Propagated(NamedTuple):
    """Hold a state, and a covariance that is older by ``lag_s`` and is propagated later."""

    state: NavState
    covariance: Array
    lag_s: float = 0.0
    start: NavState | None = None  # the state at the covariance's time
    rates: Rates | None = None  # near the middle of the lag
    vibration: Powers = STILL  # IMU noise of the last seconds
    trail: Mark | None = None  # what led to the covariance, where a smoother needs it


@dataclass(slots=True, eq=False)
class Epoch:
    """Hold an IMU sample, the interval that ends with it, and the state at its stamp."""

    stamp_ns: int
    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    propagated: Propagated
    step_s: float = 0.0  # length of the interval
    mean_force_b: Vector = (0.0, 0.0, 0.0)
    mean_rate_b: Vector = (0.0, 0.0, 0.0)
    vibration: Powers = STILL
    autopilot_q_nb: Array | None = None

    @classmethod
    def first(cls: type[E], stamp_ns: int, sample: ImuSample, start: Propagated) -> E:
        """Return the first epoch; ``sample`` is the newest one up to its stamp."""
        force, rate = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        return cls(stamp_ns, tuple(force), tuple(rate), start)

    @classmethod
    def after(cls: type[E], before: Epoch, sample: ImuSample, meter: VibrationMeter) -> E:
        """Return the epoch of the next sample; its own state is computed later."""
        force: Vector = tuple(sample.specific_force_b.tolist())
        rate: Vector = tuple(sample.angular_rate_b.tolist())
        step_s = (sample.stamp_ns - before.stamp_ns) * 1e-9
        fx, fy, fz = force
        wx, wy, wz = rate
        gx, gy, gz = before.force_b
        vx, vy, vz = before.rate_b
        return cls(
            sample.stamp_ns,
            force,
            rate,
            before.propagated,
            step_s,
            (0.5 * (gx + fx), 0.5 * (gy + fy), 0.5 * (gz + fz)),
            (0.5 * (vx + wx), 0.5 * (vy + wy), 0.5 * (vz + wz)),
            meter.add(step_s, force, rate),
            sample.autopilot_q_nb,
        )


def between(start: Epoch, end: Epoch, stamp_ns: int) -> tuple[Vector, Vector]:
    """Return specific force (m/s2) and angular rate (rad/s) in ``b``, interpolated linearly."""
    share = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
    (x, y, z), (p, q, r) = start.force_b, start.rate_b
    (fx, fy, fz), (wx, wy, wz) = end.force_b, end.rate_b
    force_b = x + share * (fx - x), y + share * (fy - y), z + share * (fz - z)
    return force_b, (p + share * (wx - p), q + share * (wy - q), r + share * (wz - r))


class Propagation:
    """Propagate the filter's state between IMU samples."""

    def __init__(self, config: EkfConfig) -> None:
        self._propagation = CovariancePropagation(config)

    def whole(self, now: Propagated, start: Epoch, end: Epoch) -> Propagated:
        """Propagate through a whole interval without measurements."""
        if end.step_s <= _LARGEST_STEP_S:
            return self._stepped(now, end, end.mean_force_b, end.mean_rate_b, end.step_s)
        return self.part(now, start, end, start.stamp_ns, end.stamp_ns)

    def part(
        self, now: Propagated, start: Epoch, end: Epoch, from_ns: int, to_ns: int
    ) -> Propagated:
        """Propagate through a part of an interval; readings are linear between two samples."""
        steps = -(-(to_ns - from_ns) // round(_LARGEST_STEP_S * 1e9))
        for step in range(steps):
            middle_ns = from_ns + (to_ns - from_ns) * (2 * step + 1) // (2 * steps)
            step_s = (to_ns - from_ns) * 1e-9 / steps
            now = self._stepped(now, end, *between(start, end, middle_ns), step_s)
        if steps and to_ns == end.stamp_ns and end.step_s > _LOST_SAMPLES_S:
            return self._bridged(now, start, end)
        return now

    def _stepped(
        self, now: Propagated, end: Epoch, force_b: Vector, rate_b: Vector, step_s: float
    ) -> Propagated:
        state, rates = propagate(now.state, force_b, rate_b, step_s)
        middle, lag_s = now.rates, now.lag_s
        if middle is None or lag_s <= 0.5 * _COVARIANCE_STEP_S:
            middle = rates
        lag_s += step_s
        start = now.start or now.state
        fields = (state, now.covariance, lag_s, start, middle, end.vibration, now.trail)
        lagging: Propagated = tuple.__new__(Propagated, fields)  # half of Propagated(...)
        return self.followed(lagging) if lag_s >= _COVARIANCE_STEP_S else lagging

    def followed(self, now: Propagated) -> Propagated:
        """Return ``now`` with its covariance propagated to the state's time."""
        lag_s, start, rates, trail = now.lag_s, now.start, now.rates, now.trail
        if start is None or rates is None:
            return now
        (n0, e0, d0), (n1, e1, d1) = start.velocity_n, now.state.velocity_n
        # Mean specific force: the change of velocity over time, less gravity.
        force_n = (n1 - n0) / lag_s, (e1 - e0) / lag_s, (d1 - d0) / lag_s - rates.gravity_m_s2
        covariance = self._propagation.step(
            now.covariance, start, rates, force_n, lag_s, now.vibration
        )
        if trail is not None:
            change = Change(covariance, self._propagation.transition.copy(), step_s=lag_s)
            trail = Mark(change, trail)
        return Propagated(now.state, covariance, trail=trail)

    def _bridged(self, now: Propagated, start: Epoch, end: Epoch) -> Propagated:
        """Return ``now`` with a covariance enlarged for a gap between two samples.

        Unseen motion may have happened in the gap. The gap may also not exist: a clock that was
        set forward looks the same. The share of the motion that took place is then uncertain
        between none and all.
        """
        followed = self.followed(now)
        state, covariance = followed.state, followed.covariance
        covariance, before, gap_s = covariance.copy(), start.propagated.state, end.step_s
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
