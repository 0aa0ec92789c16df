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
"""Convert the samples of a window to observations, integrate the IMU, and fit the state.

The errors of a float solution and of ordinary GPS last longer than the window: many positions do
not average them away, but their differences give the velocity. Headings in whole degrees average
only as far as they scatter.

The fit is linear in the biases. If the fitted biases turn the window by much, it is integrated
again with them subtracted. The measurements of a window must agree, so that one wrong measurement
spoils no alignment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AutopilotConfig, EkfConfig
from tirgeo_ros.core.frames.rotations import (
    azimuth,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.aiding.aid import floored
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import LARGE_TURN_RAD, Baseline
from tirgeo_ros.core.navigation.aiding.nose_heading import set_variance_rad2
from tirgeo_ros.core.navigation.aiding.satellite_velocity import split_velocity_noise
from tirgeo_ros.core.navigation.alignment.batch_least_squares import (
    AlignmentObservation,
    Biases,
    ObservationKind,
    PreintegratedImu,
    WindowFit,
    fit,
    integrate,
)
from tirgeo_ros.core.navigation.ins.propagation import NoisePowers, Powers, mean_powers
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array, BoolArray, Vector
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    SetHeading,
    Source,
    VelocitySample,
)

#: Error of the autopilot's azimuth: white part, and correlation time of the rest (as simulated).
_AZIMUTH_NOISE_RAD = np.radians(0.3)
_AZIMUTH_TIME_S = 30.0
_WHOLE_DEG = 1e-3  # error of whole degrees after a message in single precision
_PASSES = 5
#: A change of the biases that turns the window by less needs no new integration: the linear fit
#: errs by half the square of the turn.
_TURN_RAD = 0.03
_PICKED = 9  # attitudes of the autopilot, spread over the window
_AUTOPILOT_APART_RAD = np.radians(5.0)
#: Largest squared misfit per degree of freedom: six sigma is not chance.
_LARGEST_DISTANCE = 36.0
#: Up to this tilt error a linear filter is right: its second-order error is a hundredth of it.
_LARGEST_TILT_SIGMA_RAD = np.radians(1.0)
#: Headings are compared before the tilt is known: ten times the default sigma floor.
_HEADINGS_APART_RAD = np.radians(6.0)
#: Mean force over a second or more of flight: between half of gravity and twice gravity.
_LEAST_FORCE_M_S2, _LARGEST_FORCE_M_S2 = 4.9, 19.6
_AUTOPILOT_TILT_RAD = np.radians(10.0)  # possible error of an autopilot in a hard turn
_AUTOPILOT_SIGMAS = 5.0
_DOUBT_ENDS_NS = 1_000_000_000
_LOOK_AT_ANTENNAS = (
    ": are the antennas swapped, or aircraft.second_antenna_m wrong? (for a compass with such "
    "errors set autopilot.attitude_sigma_deg)"
)
#: Stage of an alignment that lacks only motion, and of one whose measurements disagree.
MOTION_STAGE, CONTRADICTION = 5, 6
#: Stages of an alignment that lacks a heading.
HEADING_STAGES = (2, 3)


class Measured(NamedTuple):
    """Hold a window's samples. Without heading ``readings`` the autopilot gives the heading."""

    imu: Sequence[ImuSample]
    positions: Sequence[PositionSample]
    velocities: Sequence[VelocitySample]
    readings: Sequence[HeadingSample | SetHeading]  # of one kind
    needs_heading: str  # the reason to report if there is no heading

    @property
    def last_ns(self) -> int:
        """Return the newest stamp of a position or velocity: that of the state."""
        return max(s.stamp_ns for track in (self.positions, self.velocities) for s in track)

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane of the fit: at the newest position."""
        newest = self.positions[-1]
        return TangentPlane(newest.latitude_rad, newest.longitude_rad, newest.height_m)


class FittedWindow(NamedTuple):
    """Hold a window with its fit."""

    window: PreintegratedImu
    hint_nb: Array | None  # (3, 3) the autopilot's attitude at the window's end
    gyro_bias_b: Array | None  # (3,) by the autopilot's attitudes, rad/s
    observations: list[AlignmentObservation]
    fit: WindowFit
    vibration: Powers


def fit_window(
    measured: Measured,
    config: EkfConfig,
    biases: Biases,
    taken: Array,
    *,
    gyros_unknown: bool = False,
) -> FittedWindow:
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
        observations = motion + headings
        result = fit(window, observations, start_nb, gravity_m_s2, biases, powers)
        turned = np.abs(result.biases - taken)[:3].max() * window.before_s[0]
        if turned < _TURN_RAD:
            break
        taken = result.biases
    gyro_bias_b = autopilot_gyro_bias(window, measured.imu)
    return FittedWindow(window, hint_nb, gyro_bias_b, observations, result, vibration)


def position_observation(
    sample: PositionSample, plane: TangentPlane, config: EkfConfig
) -> AlignmentObservation:
    """Return an antenna's position in the axes of ``plane``."""
    variances = np.diag(sample.covariance_n)
    if sample.source is Source.GPS_POSITION:
        absent = bool(np.any(variances <= 0))
        slow = np.array(config.gps.position_sigma_m) if absent else np.sqrt(variances)
        white, time_s = np.eye(3) * config.gps.position_noise_m**2, config.gps.position_time_s
    elif sample.status is FixStatus.FIXED:
        white = floored(sample.covariance_n, config.rtk.position_sigma_floor_m)
        slow, time_s = np.zeros(3), np.inf
    else:  # the white share of a float solution's error differs by receiver: half is assumed
        halves = 0.5 * np.maximum(variances, config.rtk.float_sigma_m**2)
        white, slow, time_s = np.diag(halves), np.sqrt(halves), config.rtk.float_time_s
    own = sample.stamp_ns, sample.source.topic, ObservationKind.POSITION
    place_n = plane.ned_from_geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
    arm_b = config.aircraft.antenna_b(sample.source)
    return AlignmentObservation(*own, place_n, arm_b, white, slow, time_s)


def velocity_observation(sample: VelocitySample, config: EkfConfig) -> AlignmentObservation:
    """Return an antenna's velocity."""
    own = sample.stamp_ns, sample.source.topic, ObservationKind.VELOCITY, sample.velocity_n
    arm_b = config.aircraft.antenna_b(sample.source)
    if sample.source is Source.GPS_VELOCITY:
        white, beyond = split_velocity_noise(sample, config.gps)
        slow = np.sqrt(beyond + config.gps.velocity_error_m_s**2)
        return AlignmentObservation(*own, arm_b, white, slow, config.gps.position_time_s)
    white = floored(sample.covariance_n, config.rtk.velocity_sigma_floor_m_s)
    return AlignmentObservation(*own, arm_b, white, np.zeros(3))


def heading_observations(
    samples: Sequence[HeadingSample | SetHeading], config: EkfConfig
) -> list[AlignmentObservation]:
    """Return the azimuths of the antenna baseline, or of the nose if a person has set it.

    Rounding to whole degrees errs by 1/sqrt(12) deg. If readings spread by s degrees (by noise or
    a turn), averaging multiplies that error by ``exp(-2 pi^2 s^2)`` (Widrow and Kollar,
    Quantization Noise, chapter 5).
    """
    set_by_hand = [s for s in samples if isinstance(s, SetHeading)]
    if set_by_hand:
        return [_azimuth(s, s.heading_rad, set_variance_rad2(s, config)) for s in set_by_hand]
    direction_b, less_rad = Baseline.from_config(config.aircraft)
    floor = np.radians(config.heading.sigma_floor_deg) ** 2
    headings_rad = np.array([s.heading_rad for s in samples])
    spread_deg = np.degrees(wrap_pi(headings_rad - headings_rad[0]))
    shared_rad = 0.0  # rounding error, if the headings are in whole degrees
    if np.abs(spread_deg - np.round(spread_deg)).max() <= _WHOLE_DEG:
        before_rounding = max(float(np.var(spread_deg)) - 1 / 12, 0.0)
        shared_rad = float(np.radians(np.sqrt(1 / 12) * np.exp(-2 * np.pi**2 * before_rounding)))
    return [
        _azimuth(s, s.heading_rad - less_rad, max(s.variance_rad2, floor), shared_rad, direction_b)
        for s in samples
    ]


def _headings(
    measured: Measured, config: EkfConfig, hint_nb: Array | None, *, gyros_unknown: bool
) -> list[AlignmentObservation]:
    """Return the azimuths of the antennas or, without headings, of the autopilot's nose.

    The autopilot's errors last, so one azimuth is enough. With ``gyros_unknown``, several over the
    window show how fast the aircraft turns.
    """
    if measured.readings:
        return heading_observations(measured.readings, config)
    slow = np.radians(config.autopilot.attitude_sigma_deg[2])
    if gyros_unknown:
        first_ns = min(
            s.stamp_ns for track in (measured.positions, measured.velocities) for s in track
        )
        usable = usable_samples(measured.imu, first_ns, measured.last_ns)
        if usable:
            white, time_s = _AZIMUTH_NOISE_RAD**2, _AZIMUTH_TIME_S
            turned = zip(usable, rotations_of(usable), strict=True)
            return [_azimuth(s, azimuth(r[:, 0]), white, slow, time_s=time_s) for s, r in turned]
    if hint_nb is None:
        raise NotAlignedError(measured.needs_heading, 3)
    last = replace(measured.imu[-1], stamp_ns=measured.last_ns)
    return [_azimuth(last, azimuth(hint_nb[:, 0]), slow**2)]


def _azimuth(
    sample: ImuSample | HeadingSample | SetHeading,
    azimuth_rad: float,
    variance: float,
    slow: float = 0.0,
    direction_b: Vector = (1.0, 0.0, 0.0),
    time_s: float = np.inf,
) -> AlignmentObservation:
    """Return the azimuth of a direction in the body, the nose by default."""
    own = sample.stamp_ns, sample.source.topic, ObservationKind.AZIMUTH, np.array([azimuth_rad])
    noise = np.array([[variance]]), np.array([slow]), time_s
    return AlignmentObservation(*own, np.array(direction_b), *noise)


def usable_samples(imu: Sequence[ImuSample], first_ns: int, last_ns: int) -> list[ImuSample]:
    """Return up to nine samples of a window that have an attitude, evenly spaced."""
    usable = [
        s for s in imu if first_ns <= s.stamp_ns <= last_ns and usable_attitude(s.autopilot_q_nb)
    ]
    last = len(usable) - 1
    return [usable[k] for k in np.unique(np.linspace(0, last, _PICKED, dtype=int)) if usable]


def rotations_of(samples: Sequence[ImuSample]) -> Array:
    """Return the autopilot's attitudes (n, 3, 3)."""
    return matrix_from_quat(np.array([s.autopilot_q_nb for s in samples], float).reshape(-1, 4))


def _autopilot_at_end(window: PreintegratedImu, imu: Sequence[ImuSample]) -> tuple[Array, Array]:
    """Return attitudes (n, 3, 3) of the autopilot at the window's end, and their ages (n,), s."""
    picked = usable_samples(imu, *window.stamps_ns[[0, -1]].tolist())
    at = window.at([s.stamp_ns for s in picked])
    return rotations_of(picked) @ window.to_end[at].swapaxes(1, 2), window.before_s[at]


def autopilot_gyro_bias(window: PreintegratedImu, imu: Sequence[ImuSample]) -> Array | None:
    """Return the gyroscope bias (3,), rad/s, from autopilot attitudes; None if they are too few.

    Carried to the window's end, each attitude is turned by the bias times the time to the end.
    """
    at_end, before_s = _autopilot_at_end(window, imu)
    if len(at_end) < _PICKED:
        return None
    turned = np.array([rotvec_from_quat(quat_from_matrix(at_end[-1].T @ r)) for r in at_end])
    before_s = before_s - before_s.mean()
    return np.asarray(before_s @ turned / (before_s @ before_s) + window.taken[:3])


def autopilot_attitude(window: PreintegratedImu, imu: Sequence[ImuSample]) -> Array | None:
    """Return the autopilot's attitude (3, 3) at the window's end, if most of its attitudes agree.

    The gyroscopes carry some attitudes of the window to its end. More than half of them must be
    within 5 deg of the central one, so that they follow the body's turn.
    """
    at_end, _ = _autopilot_at_end(window, imu)
    if not len(at_end):
        return None
    cosines = 0.5 * (np.einsum("aij,bij->ab", at_end, at_end) - 1)
    middle, near = central(np.arccos(np.clip(cosines, -1, 1)), _AUTOPILOT_APART_RAD)
    return np.asarray(at_end[middle]) if near.sum() * 2 > len(at_end) else None


class NotAlignedError(Exception):
    """Report why a window gives no alignment, and the stage that it reached.

    A stage is named by what is missing: 0 velocity, 1 position, 2 rtk/heading, 3 any heading,
    4 precision, 5 motion. At 6 the measurements disagree; ``lasting``: waiting does not help.
    """

    def __init__(self, reason: str, stage: int = CONTRADICTION, *, lasting: bool = False) -> None:
        super().__init__(reason)
        self.stage, self.lasting = stage, lasting


class Recurrence:
    """Measure for how long a doubt has recurred, with pauses of a second at most."""

    def __init__(self) -> None:
        self._since_ns = self._latest_ns = NEVER_NS

    def again_s(self, now_ns: int) -> float:
        """Record the doubt; return for how long it has recurred, s."""
        if now_ns - self._latest_ns > _DOUBT_ENDS_NS:
            self._since_ns = now_ns
        self._latest_ns = now_ns
        return (now_ns - self._since_ns) * 1e-9


def furthest(errors: Sequence[NotAlignedError]) -> NotAlignedError:
    """Return the error of the highest stage; of equal ones the first."""
    return max(errors, key=lambda error: error.stage)


def central(apart: Array, limit: float) -> tuple[int, BoolArray]:
    """Return the index of the most central of n things ``apart`` (n, n), and which are near."""
    middle = int(np.argmin(np.median(apart, axis=1)))
    return middle, apart[middle] < limit


def agreeing(
    window: PreintegratedImu, headings: Sequence[AlignmentObservation]
) -> tuple[list[AlignmentObservation], Array]:
    """Return the headings that agree with most others, and a first attitude (3, 3) with them.

    The attitude assumes an aircraft at rest. Raises NotAlignedError if fewer than two thirds
    agree, or the mean force is not gravity.
    """
    against_b, length_s = -window.velocity[0], float(window.before_s[0])  # the mean force
    force = float(np.linalg.norm(against_b)) / length_s
    if not _LEAST_FORCE_M_S2 < force < _LARGEST_FORCE_M_S2:
        raise NotAlignedError(f"imu/data: a mean force of {force:.1f} m/s2 is not gravity")
    down_b = against_b / np.linalg.norm(against_b)
    level_nb = _shortest_turn(down_b, np.array([0.0, 0.0, 1.0]))
    at = window.at([o.stamp_ns for o in headings])
    turned = [level_nb @ window.to_end[k] @ o.arm_b for k, o in zip(at, headings, strict=True)]
    turns = [o.value[0] - azimuth(d) for o, d in zip(headings, turned, strict=True)]
    apart = np.abs(wrap_pi(np.subtract.outer(turns, turns)))
    middle, near = central(apart, _HEADINGS_APART_RAD)
    if near.sum() * 3 < 2 * len(near):
        raise NotAlignedError("the headings of rtk/heading disagree with each other")
    start_nb = matrix_from_rotvec(np.array([0.0, 0.0, turns[middle]])) @ level_nb
    return [o for o, good in zip(headings, near, strict=True) if good], start_nb


def _shortest_turn(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that takes unit vector ``a`` to unit vector ``b``."""
    across = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(across), a @ b)
    if np.linalg.norm(across) < 1e-9:  # parallel or opposite: take any axis across
        across = np.cross(a, [1.0, 0, 0] if abs(a[0]) < 0.9 else [0, 1.0, 0])
    return matrix_from_rotvec(angle * across / np.linalg.norm(across))


def checked(fitted: FittedWindow) -> FittedWindow:
    """Return the window if its fit is near all measurements, with a good tilt; NotAlignedError."""
    result = fitted.fit
    worst = int(np.argmax(result.distances))
    if result.distances[worst] > _LARGEST_DISTANCE:
        wrong, size = fitted.observations[worst], float(np.linalg.norm(result.residuals[worst]))
        size = np.degrees(size) if wrong.kind is ObservationKind.AZIMUTH else size
        off = f"{size:.2g} {wrong.kind.value} ({np.sqrt(result.distances[worst]):.0f} sigma)"
        raise NotAlignedError(f"imu/data and {wrong.name} differ by {off}")
    if not result.settled:
        raise NotAlignedError("imu/data does not fit the measured motion")
    if result.rotation_nb[2, 2] <= 0:
        raise NotAlignedError("imu/data is upside down: check its axes and signs")
    if result.tilt_sigma_rad > _LARGEST_TILT_SIGMA_RAD:
        raise NotAlignedError("the motion is not measured well enough to find the tilt", 4)
    return fitted


def tilt_between(a_nb: Array, b_nb: Array) -> float:
    """Return the angle between the verticals of two attitudes (3, 3), rad."""
    return float(np.arccos(np.clip(a_nb[2] @ b_nb[2], -1, 1)))


def differences(
    result: WindowFit, hint_nb: Array, autopilot: AutopilotConfig
) -> dict[str, NotAlignedError]:
    """Return doubts on "tilt" and "heading" if they differ from the autopilot's (3, 3)."""
    tilt = tilt_between(result.rotation_nb, hint_nb)
    heading = abs(float(wrap_pi(azimuth(result.rotation_nb[:, 0]) - azimuth(hint_nb[:, 0]))))
    own = np.sqrt(result.covariance[2, 2])
    sigma = np.hypot(np.radians(autopilot.attitude_sigma_deg[2]), own)
    text = "{} and the orientation in imu/data differ by {:.0f} deg"
    out = {}
    if tilt > _AUTOPILOT_TILT_RAD:
        out["tilt"] = NotAlignedError(text.format("the estimated tilt", np.degrees(tilt)))
    if heading > _AUTOPILOT_SIGMAS * sigma:
        words = text.format("rtk/heading", np.degrees(heading)) + _LOOK_AT_ANTENNAS
        out["heading"] = NotAlignedError(words, lasting=heading > LARGE_TURN_RAD)
    return out
