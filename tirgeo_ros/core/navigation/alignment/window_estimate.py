"""Fit the measurements of a window: convert them to observations, integrate the IMU, solve.

The fit is linear in the biases. Where those it finds turn the window by much, the window is
integrated again with them subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.alignment.batch_least_squares import (
    AlignmentObservation,
    WindowFit,
    fit,
)
from tirgeo_ros.core.navigation.alignment.consistency_checks import NotAlignedError, agreeing
from tirgeo_ros.core.navigation.alignment.imu_preintegration import (
    Biases,
    PreintegratedImu,
    integrate,
)
from tirgeo_ros.core.navigation.alignment.observations import (
    autopilot_attitude,
    autopilot_gyro_bias,
    autopilot_observation,
    autopilot_observations,
    heading_observations,
    position_observation,
    velocity_observation,
)
from tirgeo_ros.core.navigation.ins_error_model import NoisePowers
from tirgeo_ros.core.navigation.vibration_noise import Powers, mean_powers
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    VelocitySample,
)

_PASSES = 5
#: A change of the biases that turns the window by less needs no new integration: the linear fit
#: errs by half the square of the turn.
_TURN_RAD = 0.03


class Measured(NamedTuple):
    """Hold a window's samples. Without readings of antennas the autopilot gives the heading."""

    imu: Sequence[ImuSample]
    positions: Sequence[PositionSample]
    velocities: Sequence[VelocitySample]
    readings: Sequence[HeadingSample]
    needs_heading: str  # the reason given where there is no heading

    @property
    def last_ns(self) -> int:
        """Return the newest stamp of a position or velocity: that of the state."""
        stamps = [s.stamp_ns for s in self.positions] + [s.stamp_ns for s in self.velocities]
        return max(stamps)

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane of the fit: at the newest position."""
        newest = self.positions[-1]
        return TangentPlane(newest.latitude_rad, newest.longitude_rad, newest.height_m)


class Fitted(NamedTuple):
    """Hold a window with its fit."""

    window: PreintegratedImu
    hint_nb: Array | None  # (3, 3) the autopilot's attitude at the window's end
    gyro_bias_b: Array | None  # (3,) by the autopilot's attitudes, rad/s
    seen: list[AlignmentObservation]
    fit: WindowFit
    vibration: Powers


def fitted(
    measured: Measured,
    config: EkfConfig,
    biases: Biases,
    taken: Array,
    *,
    gyros_unknown: bool = False,
) -> Fitted:
    """Fit a window; ``taken`` (6,) are the biases to subtract first, ``biases`` their prior.

    With ``gyros_unknown`` and without antennas, the autopilot's headings over the window observe
    its turn. Raises NotAlignedError.
    """
    vibration = mean_powers(measured.imu)
    powers = NoisePowers(config.imu).under((0.0, 0.0, 0.0, *vibration[3:]))
    plane = measured.plane
    gravity_m_s2 = gravity_down(plane.latitude_rad, plane.height_m)
    motion = [position_observation(s, plane, config) for s in measured.positions]
    motion += [velocity_observation(s, config) for s in measured.velocities]
    stamps = [s.stamp_ns for s in motion] + [s.stamp_ns for s in measured.readings]
    for _ in range(_PASSES):
        window = integrate(measured.imu, stamps, taken)
        hint_nb = autopilot_attitude(window, measured.imu)
        headings = _headings(measured, config, hint_nb, gyros_unknown=gyros_unknown)
        headings, start_nb = agreeing(window, headings)
        seen = motion + headings
        found = fit(window, seen, start_nb, gravity_m_s2, biases, powers)
        turned = np.abs(found.biases - taken)[:3].max() * window.before_s[0]
        if turned < _TURN_RAD:
            break
        taken = found.biases
    gyro_bias_b = autopilot_gyro_bias(window, measured.imu)
    return Fitted(window, hint_nb, gyro_bias_b, seen, found, vibration)


def _headings(
    measured: Measured, config: EkfConfig, hint_nb: Array | None, *, gyros_unknown: bool
) -> list[AlignmentObservation]:
    if measured.readings:
        return heading_observations(measured.readings, config)
    if gyros_unknown:
        first = measured.positions[0].stamp_ns, *(s.stamp_ns for s in measured.velocities[:1])
        found = autopilot_observations(
            measured.imu, min(first), measured.last_ns, config.autopilot
        )
        if found:
            return found
    if hint_nb is None:
        raise NotAlignedError(measured.needs_heading, 3)
    return [autopilot_observation(hint_nb, measured.last_ns, config.autopilot)]
