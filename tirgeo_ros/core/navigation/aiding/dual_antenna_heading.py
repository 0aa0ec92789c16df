"""The heading of two antennas (Eq. 7 and 9, with the row that the full attitude gives)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid_status import Control, Track
from tirgeo_ros.core.navigation.aiding.filter_state import Aid, Belief
from tirgeo_ros.core.navigation.ins_error_model import heading_error, states_of
from tirgeo_ros.core.navigation.kalman import Measurement
from tirgeo_ros.core.navigation.strapdown import Rotation, Vector, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, Source

#: The error function's own rounding; a reading less likely than that says nothing by its tails.
_LEAST_LIKELY = 1e-12
#: No gyroscope turns by this unseen, and few compasses err by it: it is the antennas.
LARGE_TURN_RAD = math.radians(20.0)
#: Below this horizontal share a baseline has no heading worth the name (75 deg of tilt).
_LEAST_HORIZONTAL = 0.25
#: Of the newest innovation in the running mean: the mean is one of about twenty.
_MEAN_SHARE = 0.1
_MEAN_GATE_SIGMA = 5.0


class Baseline(NamedTuple):
    """From the first antenna to the second, and what the receiver says of it."""

    direction_b: Vector  # unit vector, FRD
    reported_less_azimuth_rad: float  # what the receiver has added to the baseline's azimuth

    @classmethod
    def from_config(cls, aircraft: AircraftConfig) -> Baseline:
        """Return the baseline between the two antennas; with one, level along the nose.

        What is reported is the azimuth less the baseline's own direction in a level body. Raises
        ConfigError where the two antennas give no heading.
        """
        baseline_b = aircraft.baseline_b
        if baseline_b is None:
            return cls((1.0, 0.0, 0.0), 0.0)
        x, y, z = (baseline_b / np.linalg.norm(baseline_b)).tolist()
        return cls((x, y, z), -math.atan2(y, x))


def azimuth(direction_n: Vector) -> float:
    """Azimuth of a NED vector, radians from north, clockwise."""
    return math.atan2(direction_n[1], direction_n[0])


def wrapped(angle_rad: float) -> float:
    """The same direction in -pi to pi."""
    return math.remainder(angle_rad, 2 * math.pi)


def heading_innovation(
    rotation_nb: Rotation, heading_rad: float, baseline: Baseline
) -> tuple[float, Vector]:
    """Reported minus predicted heading (rad), and the baseline in ``n``."""
    u = rotate(rotation_nb, baseline.direction_b)
    predicted = azimuth(u) + baseline.reported_less_azimuth_rad
    return wrapped(heading_rad - predicted), u


def heading_design(states: int, u: Vector) -> Array | None:
    """H (1, states) of a baseline ``u`` in ``n``, or None where it stands upright.

    With ``u = R u_b`` and ``du = phi x u`` the azimuth moves by
    ``phi_D - u_D (u_N phi_N + u_E phi_E) / (u_N^2 + u_E^2)``; with a baseline along the nose it is
    ``[tan(pitch) cos(yaw), tan(pitch) sin(yaw), 1] phi``.
    """
    horizontal = u[0] * u[0] + u[1] * u[1]
    if horizontal < _LEAST_HORIZONTAL**2:
        return None
    design = np.zeros((1, states))
    design[0, :3] = -u[2] * u[0] / horizontal, -u[2] * u[1] / horizontal, 1.0
    at = heading_error(states)
    if at is not None:
        design[0, at] = 1.0
    return design


def interval_measurement(
    innovation: float, predicted: float, noise: float, resolution: float
) -> tuple[float, float]:
    """The innovation and its variance that stand for a reading in steps of ``resolution``.

    Heading plus noise lay within half a step of the reading. The linear measurement is given that
    leaves behind the mean and variance of that: those of a doubly truncated normal (Johnson, Kotz
    and Balakrishnan, Continuous Univariate Distributions 1, chapter 13). ``predicted``, ``noise``:
    variances; rad, rad2. The innovation is infinite where the interval is too far out to compute.
    """
    spread = math.sqrt(predicted + noise)
    low = (abs(innovation) - 0.5 * resolution) / spread
    high = (abs(innovation) + 0.5 * resolution) / spread
    share = 0.5 * (math.erfc(low * math.sqrt(0.5)) - math.erfc(high * math.sqrt(0.5)))
    if share < _LEAST_LIKELY:
        return math.inf, noise
    at_low, at_high = (math.exp(-0.5 * x * x) / math.sqrt(math.tau) for x in (low, high))
    mean = (at_low - at_high) / share
    # The share of the variance that the interval takes away; next to none where its ends are far.
    told = max(mean * mean - (low * at_low - high * at_high) / share, _LEAST_LIKELY)
    return math.copysign(spread * mean / told, innovation), spread * spread / told - predicted


class Headings:
    """Makes measurements of the headings, as the parameters say."""

    def __init__(self, config: EkfConfig) -> None:
        self._heading = config.heading
        self._states = states_of(config)
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)
        self._baseline = Baseline.from_config(config.aircraft)
        self._floor_rad2 = math.radians(config.heading.sigma_floor_deg) ** 2
        self._resolution_rad = math.radians(config.heading.resolution_deg)

    def obstacle(self, sample: HeadingSample, control: Control) -> str:
        """Why a heading is not for use now, or empty; start and continue have own conditions."""
        now_ns = sample.stamp_ns
        if control.status is not FixStatus.FIXED:
            return "rtk/fix is not fixed"
        if now_ns - control.status_ns > self._timeout_ns:
            return "rtk/fix is silent"
        going_on = control.track(Source.RTK_HEADING).recent(now_ns, self._timeout_ns)
        fixed_s = (now_ns - control.fixed_since_ns) * 1e-9
        if not going_on and fixed_s < self._heading.start_after_s:
            return f"rtk/fix is fixed for {fixed_s:.1f} s only"
        return ""

    def aid(self, sample: HeadingSample, belief: Belief) -> Aid | None:
        """The measurement, or None where the baseline stands upright."""
        reported = sample.heading_rad - belief.control.receivers.heading_error_rad
        rotation = rotation_of(belief.state.q_nb)
        innovation, u = heading_innovation(rotation, reported, self._baseline)
        design = heading_design(self._states, u)
        if design is None:
            return None
        rounding = self._resolution_rad**2 / 12
        variance = max(sample.variance_rad2 - rounding, self._floor_rad2) + rounding
        gate_sigma = self._heading.gate_sigma
        noise = np.array(((variance,),))
        measurement = Measurement(np.array((innovation,)), design, noise, gate_sigma)
        if rounding:
            measurement = self._interval(measurement, belief.covariance)
        invariant = (math.cos(innovation), math.sin(innovation))
        slack = 1.5 * gate_sigma * math.sqrt(variance)
        return Aid(Source.RTK_HEADING, sample.stamp_ns, measurement, invariant, (1.0, 0.0), slack)

    def _interval(self, plain: Measurement, covariance: Array) -> Measurement:
        """What a reading in steps says; the plain one where either is beyond the gate.

        So gates and resets see the reading as it is, and one that contradicts the state by less
        than the plain gate still draws on it.
        """
        innovation, variance = float(plain.innovation[0]), float(plain.noise[0, 0])
        predicted = float((plain.design @ covariance @ plain.design.T)[0, 0])
        noise = variance - self._resolution_rad**2 / 12
        told = interval_measurement(innovation, predicted, noise, self._resolution_rad)
        for off, spread in ((innovation, variance), told):
            if off * off > plain.gate_sigma**2 * (predicted + spread):
                return plain
        return plain._replace(innovation=np.array((told[0],)), noise=np.array(((told[1],),)))

    def averaged(
        self, track: Track, measurement: Measurement, predicted: Array, reason: str
    ) -> tuple[Track, str]:
        """The record with one more innovation in its mean, and why a heading is refused.

        One heading that is off by less than the gate passes; the mean of many that are off by as
        much is far outside of what the mean of good ones can be.
        """
        noise, own = float(measurement.noise[0, 0]), float(predicted[0, 0])
        off = float(measurement.innovation[0])
        if abs(off) > 2 * measurement.gate_sigma * math.sqrt(own + noise):
            return track, reason  # a flip is no small error that lasts
        mean = track.mean_rad + _MEAN_SHARE * (off - track.mean_rad)
        scatter = math.sqrt(own + noise * _MEAN_SHARE / (2 - _MEAN_SHARE))
        if not reason and abs(mean) > _MEAN_GATE_SIGMA * scatter:
            reason = f"off by {math.degrees(mean):+.1f} deg in the mean"
        return track._replace(mean_rad=mean), reason
