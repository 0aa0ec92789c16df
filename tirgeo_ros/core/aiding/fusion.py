"""A sample into the state: the right measurement, its noise, its gate, its verdict."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.aiding.heading import baseline_b, heading_measurement
from tirgeo_ros.core.aiding.position import innovation_n, position_measurement
from tirgeo_ros.core.aiding.velocity import velocity_measurement
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import POSITION, feedback
from tirgeo_ros.core.kalman import Measurement, update
from tirgeo_ros.core.samples import (
    Array,
    FixStatus,
    HeadingSample,
    Outcome,
    PositionSample,
    Source,
    VelocitySample,
    Verdict,
)
from tirgeo_ros.core.strapdown import NavState

Aiding = PositionSample | VelocitySample | HeadingSample
#: A float or differential solution is believed no better than this, per axis.
_FLOAT_SIGMA_M = 0.3


class Fused(NamedTuple):
    """The state after a sample, changed or not, and why."""

    verdict: Verdict
    state: NavState
    covariance: Array  # (15, 15)


class Fusion:
    """Turns samples into measurements and fuses them, as the parameters say."""

    def __init__(self, config: EkfConfig) -> None:
        self._rtk = config.rtk
        self._heading = config.heading
        self._lever_b = config.rtk.lever_arm_b
        self._baseline_b = baseline_b(config.heading.offset_deg)
        self._direct = config.position_update == "rtk_direct"

    def offset_n(self, state: NavState, sample: PositionSample) -> Array:
        """(3,) antenna as measured, from the path that the IMU alone has taken, NED metres.

        A median of positions would lag behind an aircraft in motion. The median filter therefore
        takes these offsets: a jump of one position disturbs them as it would the plain median,
        motion not at all.
        """
        free = np.array(state.correction_n)
        return np.asarray(innovation_n(state, sample, self._lever_b) + free)

    def fuse(
        self,
        sample: Aiding,
        state: NavState,
        covariance: Array,
        angular_rate_b: Array,
        window: list[Array],
    ) -> Fused:
        """The state with a sample in it.

        ``angular_rate_b`` (3,) rad/s has its bias removed; ``window`` holds the newest offsets
        (see ``offset_n``), this sample's last, where the sample is a position.
        """
        source = source_of(sample)
        measurement = self._measurement(sample, state, angular_rate_b, window)
        if measurement is None:
            verdict = Verdict(source, Outcome.INVALID, "the antenna baseline stands upright")
            return Fused(verdict, state, covariance)
        result = update(covariance, measurement)
        innovation = tuple(measurement.innovation.tolist())
        if result.error is None or result.covariance is None:
            verdict = Verdict(source, Outcome.GATED, "innovation", result.test_ratio, innovation)
            return Fused(verdict, state, covariance)
        error, covariance = result.error, result.covariance
        if self._direct and source is Source.RTK_POSITION:
            error, covariance = _position_taken(error, covariance, measurement)
        verdict = Verdict(source, Outcome.USED, "", result.test_ratio, innovation)
        return Fused(verdict, feedback(state, error), covariance)

    def _measurement(
        self, sample: Aiding, state: NavState, angular_rate_b: Array, window: list[Array]
    ) -> Measurement | None:
        if isinstance(sample, HeadingSample):
            return self._heading_measurement(sample, state)
        gate_sigma = self._rtk.gate_sigma
        if isinstance(sample, VelocitySample):
            noise = floored(sample.covariance_n, self._rtk.velocity_sigma_floor_m_s)
            return velocity_measurement(
                state, sample.velocity_n, noise, angular_rate_b, self._lever_b, gate_sigma
            )
        fixed = sample.status is FixStatus.FIXED
        sigma_m = self._rtk.position_sigma_floor_m if fixed else _FLOAT_SIGMA_M
        middle = window[0] if len(window) == 1 else np.median(window, axis=0)
        innovation = middle - np.array(state.correction_n)
        noise = floored(sample.covariance_n, sigma_m)
        return position_measurement(state, innovation, noise, self._lever_b, gate_sigma)

    def _heading_measurement(self, sample: HeadingSample, state: NavState) -> Measurement | None:
        variance = max(sample.variance_rad2, np.radians(self._heading.sigma_floor_deg) ** 2)
        gate_sigma = self._heading.gate_sigma
        return heading_measurement(
            state, sample.heading_rad, variance, self._baseline_b, gate_sigma
        )


def _position_taken(
    error: Array, covariance: Array, measurement: Measurement
) -> tuple[Array, Array]:
    """The paper's cycle (section 3.3): RTK's position as it stands, the rest filtered."""
    error, covariance = error.copy(), covariance.copy()
    error[POSITION] = measurement.innovation
    covariance[POSITION, :] = 0.0
    covariance[:, POSITION] = 0.0
    covariance[POSITION, POSITION] = measurement.noise
    return error, covariance


def source_of(sample: Aiding) -> Source:
    """Where an aiding sample comes from."""
    return Source.RTK_HEADING if isinstance(sample, HeadingSample) else sample.source


def floored(covariance: Array, sigma: float) -> Array:
    """A covariance (3, 3) whose axes are believed no better than ``sigma``.

    Where variances are absent (zero or negative) the floor stands for them.
    """
    variances = np.diag(covariance)
    if np.any(variances <= 0):
        return np.diag(np.maximum(variances, sigma**2))
    return np.asarray(covariance + np.diag(np.maximum(sigma**2 - variances, 0.0)))
