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
"""Simulate the samples of the aircraft's sensors and of its gimbal, with their errors and delays.

Every function ``*_samples`` returns ``(arrival_ns, sample)`` pairs in order of arrival; a sample's
stamp is the time of its measurement.

The gimbal follows the nose with a lag and holds roll and pitch imperfectly: the camera drifts by
Table 8's amounts. The encoders measure this drift, the flight controller does not. The north of
the reported attitude may differ from the autopilot's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from tirgeo_ros.core.frames.rotations import (
    Q_BODY_OPTICAL,
    azimuths,
    euler_from_matrix,
    flu_from_frd,
    matrix_from_euler,
    quat_from_euler,
    quat_from_matrix,
    quat_multiply,
    wrap_pi,
)
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.gimbal.camera_pose import joint_angles
from tirgeo_ros.core.navigation.aiding.barometer import standard_pressure_pa
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    NavigationInput,
    PositionSample,
    PressureSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.processes import Spline, gauss_markov, generator, scaled_noise
from tirgeo_ros.tools.simulate.scenario import ImuScenario, Scenario
from tirgeo_ros.tools.simulate.trajectory import Motion, Trajectory, geodetic_state

#: Correlation times of the autopilot's errors of heading and tilt.
_HEADING_TIME_S, _TILT_TIME_S = 30.0, 10.0
#: Error of a barometer by wind and rotor wash: rms, as a height, and correlation time.
_WASH_M, _WASH_TIME_S = 0.5, 20.0
#: Correlation time of the camera's roll and pitch errors.
ERROR_TIME_S = 2.5
#: Speeds of the rotors, and how far they wander, as a share (rms).
_ROTORS_HZ, _ROTOR_WANDER = np.array([51.0, 54.0, 57.0, 59.0]), 0.01
#: White share of the power of a vibration: gyroscopes, accelerometers. Of a P4 RTK they are the
#: squares of 0.3 and 0.7, as the filter's parameters have them.
_WHITE_SHARES = np.array([0.1, 0.5]).reshape(2, 1, 1)
_KNOT_S = 0.05  # of the spline of the camera's heading
_TILTING_S = 1.0  # duration of a change of the commanded pitch

Sample = NavigationInput | JointSample | CameraAttitudeSample
Arrival = tuple[int, Sample]


@dataclass(frozen=True)
class Epochs:
    """Hold the instants at which one sensor measures."""

    stamp_ns: list[int]
    t_s: Array  # (N,) from the start of the flight

    @staticmethod
    def at_rate(scenario: Scenario, rate_hz: float, less_s: float = 0.0) -> Epochs:
        """Return instants from the first of the flight to its last, or to ``less_s`` before it."""
        count = max(0, math.floor((scenario.duration_s - less_s) * rate_hz + 1e-9) + 1)
        offsets = [round(k * 1e9 / rate_hz) for k in range(count)]
        return Epochs([scenario.start_ns + x for x in offsets], np.array(offsets) / 1e9)


class Autopilot:
    """Simulate the autopilot's own attitude: the truth plus slow errors of the three angles."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Draw the errors of the whole flight."""
        errors, length_s = scenario.autopilot, scenario.duration_s
        heading, tilt = (generator(seed, f"autopilot {name}") for name in ("heading", "tilt"))
        heading_rad = math.radians(errors.heading_rms_deg)
        self._heading = scaled_noise(heading, length_s, _HEADING_TIME_S, heading_rad)
        self._tilt = scaled_noise(tilt, length_s, _TILT_TIME_S, np.radians(errors.tilt_rms_deg))

    def euler_rad(self, motion: Motion, rotation_nb: Array) -> Array:
        """Return the reported roll, pitch, yaw (N, 3)."""
        errors = np.concatenate([self._tilt(motion.t_s), self._heading(motion.t_s)], axis=-1)
        return np.asarray(euler_from_matrix(rotation_nb) + errors)


def imu_samples(
    scenario: Scenario, seed: int, trajectory: Trajectory, pilot: Autopilot, bias: ImuBias
) -> list[Arrival]:
    """Return ``imu/data``: force and rate with noise and bias, and the autopilot's attitude."""
    epochs = Epochs.at_rate(scenario, scenario.imu.rate_hz)
    motion = trajectory.motion(epochs.t_s - scenario.imu.stamp_delay_s)
    force, rate = trajectory.inertial(motion)
    white = imu_white(scenario.imu, seed, len(epochs.stamp_ns))
    shaken = vibration(scenario, seed, epochs.t_s)
    rate = rate + bias.gyro_b + white[0] + shaken[0]
    force = force + bias.accel_b + white[1] + shaken[1]
    q_nb = quat_from_euler(*pilot.euler_rad(motion, trajectory.rotation_nb(motion)).T)
    rows = zip(epochs.stamp_ns, force, rate, q_nb, strict=True)
    return [(row[0], ImuSample(*row)) for row in rows]


def rtk_samples(scenario: Scenario, seed: int, trajectory: Trajectory) -> list[Arrival]:
    """Return ``rtk/fix``, ``rtk/vel`` and ``rtk/heading`` of the same epochs."""
    rtk, sources = scenario.rtk, (Source.RTK_POSITION, Source.RTK_VELOCITY)
    epochs = Epochs.at_rate(scenario, rtk.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    draws = generator(seed, "rtk").standard_normal((2, len(epochs.stamp_ns), 3))
    sigmas = np.array([rtk.position_sigma_m, rtk.velocity_sigma_m_s])
    antenna = motion.at_arm(scenario.aircraft.rtk_lever_b)
    at_antenna = geodetic_state(trajectory.plane, *antenna, motion.rotation_pb)
    fixes = _fixes(epochs, at_antenna, draws * sigmas[:, None], sigmas, sources, FixStatus.FIXED)
    headings = _headings(scenario, seed, trajectory.rotation_nb(motion), epochs)
    delay_ns = round(rtk.arrival_delay_s * 1e9)
    both = zip(fixes, headings, strict=True)
    return [
        (sample.stamp_ns + delay_ns, sample) for fix, heading in both for sample in (*fix, heading)
    ]


def _headings(
    scenario: Scenario, seed: int, rotation_nb: Array, epochs: Epochs
) -> list[HeadingSample]:
    """Return headings from the baseline's azimuth with white noise, rounded to steps.

    The direction of the baseline in the body is subtracted.
    """
    config, aircraft = scenario.heading, scenario.aircraft
    baseline_b, direction_deg = aircraft.baseline_b, aircraft.baseline_deg
    assert baseline_b is not None  # a scenario has two antennas
    assert direction_deg is not None
    heading_deg = np.degrees(azimuths(rotation_nb @ baseline_b))
    noise = generator(seed, "rtk heading").standard_normal(len(heading_deg))
    heading_deg = heading_deg + config.sigma_deg * noise
    if config.step_deg > 0:
        heading_deg = config.step_deg * np.round(heading_deg / config.step_deg)
    # The variance of rounding is a twelfth of the step's square.
    variance = math.radians(1) ** 2 * (config.sigma_deg**2 + config.step_deg**2 / 12)
    return [
        HeadingSample(stamp, math.radians((value - direction_deg) % 360.0), variance)
        for stamp, value in zip(epochs.stamp_ns, heading_deg, strict=True)
    ]


def gps_samples(scenario: Scenario, seed: int, trajectory: Trajectory) -> list[Arrival]:
    """Return ``gps/fix`` and ``gps/vel``, with slowly varying position errors.

    Their rms over this flight is that of Table 1.
    """
    gps, sources = scenario.gps, (Source.GPS_POSITION, Source.GPS_VELOCITY)
    epochs = Epochs.at_rate(scenario, gps.rate_hz)
    rng, rms = generator(seed, "gps position"), np.array(gps.position_rms_m)
    slow = scaled_noise(rng, scenario.duration_s, gps.position_time_s, rms)
    draws = generator(seed, "gps velocity").standard_normal((len(epochs.t_s), 3))
    errors = np.array([slow(epochs.t_s), gps.velocity_sigma_m_s * draws])
    sigmas = np.array([rms, [gps.velocity_sigma_m_s] * 3])
    motion = trajectory.motion(epochs.t_s)
    antenna = motion.at_arm(scenario.aircraft.gps_lever_b)
    at_antenna = geodetic_state(trajectory.plane, *antenna, motion.rotation_pb)
    fixes = _fixes(epochs, at_antenna, errors, sigmas, sources, FixStatus.SINGLE)
    delay_ns = round(gps.arrival_delay_s * 1e9)
    return [(sample.stamp_ns + delay_ns, sample) for fix in fixes for sample in fix]


def barometer_samples(scenario: Scenario, seed: int, trajectory: Trajectory) -> list[Arrival]:
    """Return ``baro/pressure``: standard pressures at heights with errors; [] without a rate."""
    barometer = scenario.barometer
    if not barometer.rate_hz:
        return []
    epochs = Epochs.at_rate(scenario, barometer.rate_hz)
    position_p = trajectory.motion(epochs.t_s).position_p
    height_m = trajectory.plane.geodetic_from_ned(position_p)[2]
    count, step_s = len(epochs.t_s), 1 / barometer.rate_hz
    rng = generator(seed, "barometer")
    white, steps = rng.standard_normal((2, count))
    wash_m = gauss_markov(rng, count, step_s, np.array([_WASH_TIME_S]), np.array([_WASH_M]))[:, 0]
    drift_m = barometer.drift * math.sqrt(step_s) * np.cumsum(steps)
    errors_m = barometer.offset_m + barometer.noise_m * white + wash_m + drift_m
    return [
        (stamp, PressureSample(stamp, standard_pressure_pa(height), 0.0))
        for stamp, height in zip(epochs.stamp_ns, (height_m + errors_m).tolist(), strict=True)
    ]


def _fixes(
    epochs: Epochs,
    at_antenna: tuple[Array, ...],
    errors_n: Array,
    sigmas_n: Array,
    sources: tuple[Source, Source],
    status: FixStatus,
) -> list[tuple[PositionSample, VelocitySample]]:
    """Return position and velocity with errors (2, N, 3), and their sigmas (2, 3), NED.

    ``at_antenna`` is the ``geodetic_state`` of the antenna.
    """
    lat, lon, height, velocity_n, _ = at_antenna
    north, east, down = errors_n[0].T
    # Errors are some metres, and the site is some hundred metres wide: the radii of one point are
    # accurate to 1e-5 of the error.
    meridian, transverse = radii_of_curvature(float(lat[0]))
    lon = wrap_pi(lon + east / ((transverse + height) * np.cos(lat)))
    places = np.stack([lat + north / (meridian + height), lon, height - down], -1).tolist()
    covariance, of_velocity = (np.diag(sigma**2) for sigma in sigmas_n)
    rows = zip(epochs.stamp_ns, places, velocity_n + errors_n[1], strict=True)
    return [
        (
            PositionSample(stamp, sources[0], status, phi, lam, h, covariance),
            VelocitySample(stamp, sources[1], velocity, of_velocity),
        )
        for stamp, (phi, lam, h), velocity in rows
    ]


@dataclass(frozen=True)
class ImuBias:
    """Hold the true biases (N, 3) of the IMU at its samples, FRD."""

    gyro_b: Array  # rad/s
    accel_b: Array  # m/s2


def imu_bias(scenario: ImuScenario, seed: int, count: int) -> ImuBias:
    """Return a constant bias plus a Gauss-Markov part by Table 5 (sigma and time).

    The constant is the sum of the planted bias and a random one.
    """
    noise, step_s = scenario.noise, 1 / scenario.rate_hz
    rng = generator(seed, "imu bias")
    turn_on = rng.standard_normal((2, 3))
    gyro = gauss_markov(rng, count, step_s, noise.gyro_bias_time_s, noise.gyro_bias_instability)
    accel = gauss_markov(rng, count, step_s, noise.accel_bias_time_s, noise.accel_bias_instability)
    gyro += scenario.gyro_turn_on_bias_rad_s * turn_on[0]
    accel += scenario.accel_turn_on_bias_m_s2 * turn_on[1]
    planted = flu_from_frd(np.array([scenario.gyro_bias_rad_s, scenario.accel_bias_m_s2]))
    scale = scenario.noise_scale
    return ImuBias(scale * gyro + planted[0], scale * accel + planted[1])


def vibration(scenario: Scenario, seed: int, t_s: Array) -> Array:
    """Return what the running engine adds to rate (rad/s) and force (m/s2), (2, N, 3), FRD.

    Each rotor has a line, at a frequency that wanders; the IMU's sampling folds it.
    """
    imu, way = scenario.imu, scenario.route
    rms = np.array([imu.gyro_vibration_rad_s, imu.accel_vibration_m_s2]).reshape(2, 1, 1)
    if not rms.any():
        return np.zeros((2, 1, 3))
    rng, count, rotors = generator(seed, "vibration"), len(t_s), len(_ROTORS_HZ)
    wander = gauss_markov(rng, count, 1 / imu.rate_hz, [2.0] * rotors, [_ROTOR_WANDER] * rotors)
    turns = np.cumsum(_ROTORS_HZ * (1 + wander), axis=0) / imu.rate_hz
    phases = 2 * np.pi * (turns[:, :, None, None] + rng.random((rotors, 2, 3)))
    lines = math.sqrt(2 / rotors) * np.einsum("nrcx->cnx", np.sin(phases))
    white = np.sqrt(_WHITE_SHARES) * rng.standard_normal((2, count, 3))
    running = t_s >= way.standing_s - way.engine_before_s
    return np.asarray(rms * running[:, None] * (np.sqrt(1 - _WHITE_SHARES) * lines + white))


def imu_white(scenario: ImuScenario, seed: int, count: int) -> tuple[Array, Array]:
    """Return white noise (count, 3) of rate (rad/s) and specific force (m/s2), FRD.

    Its random walks are those of Table 5.
    """
    # A random walk of N per root second is white noise of N / sqrt(dt) per sample.
    scale = scenario.noise_scale * math.sqrt(scenario.rate_hz)
    draws = scale * generator(seed, "imu white").standard_normal((2, count, 3))
    walks = scenario.noise.angle_random_walk, scenario.noise.velocity_random_walk
    return draws[0] * np.array(walks[0]), draws[1] * np.array(walks[1])


class SimulatedGimbal:
    """Compute the true attitude and position of the camera as functions of time.

    The boresight turns the camera away from the gimbal's axes; neither the encoders nor the flight
    controller measure it.
    """

    def __init__(self, scenario: Scenario, seed: int, trajectory: Trajectory) -> None:
        """Draw the camera's drift, and let its heading follow that of the aircraft."""
        self._scenario, self._places = scenario.gimbal, scenario.aircraft
        self._trajectory = trajectory
        boresight = quat_from_euler(*scenario.gimbal.boresight_rpy_rad)
        self._q_gc = quat_multiply(boresight, Q_BODY_OPTICAL)
        knots_s = np.arange(0.0, scenario.duration_s + 2 * _KNOT_S, _KNOT_S)
        nose = trajectory.motion(knots_s).heading_rad
        kept = math.exp(-_KNOT_S / scenario.gimbal.lag_s)  # share of the lag after one knot
        lagging = lfilter([1 - kept], [1.0, -kept], nose, zi=[kept * nose[0]])[0]
        self._heading = Spline(lagging[:, None], _KNOT_S)
        rms = np.radians(scenario.gimbal.error_rms_deg)
        rng = generator(seed, "gimbal")
        #: True minus commanded camera roll and pitch (N, 2), rad, at times (N,).
        self.wander_rad: Spline = scaled_noise(rng, scenario.duration_s, ERROR_TIME_S, rms)

    def commanded_pitch_rad(self, t_s: Array) -> Array:
        """Return the camera pitch (N,) that the gimbal is commanded to hold."""
        changed = np.clip((t_s - self._scenario.pitch_step_s) / _TILTING_S, 0.0, 1.0)
        return np.radians(self._scenario.pitch_deg + self._scenario.pitch_step_deg * changed)

    def rotation_pg(self, t_s: Array) -> Array:
        """Return the true camera attitude (N, 3, 3) in the plane of the site."""
        roll, pitch = self.wander_rad(t_s).T
        pitch = pitch + self.commanded_pitch_rad(t_s)
        return matrix_from_euler(roll, pitch, self._heading(t_s)[:, 0])

    def camera(self, t_s: npt.ArrayLike) -> tuple[Array, Array]:
        """Return position (N, 3) and quaternion ``q_pc`` (N, 4) of the optical frame in ``p``."""
        times = np.atleast_1d(np.asarray(t_s, float))
        motion = self._trajectory.motion(times)
        rotation = self.rotation_pg(times)
        pivot_p, _ = motion.at_arm(self._places.pivot_lever_b)
        q_pc = quat_multiply(quat_from_matrix(rotation), self._q_gc)
        return pivot_p + rotation @ self._places.camera_from_pivot_g, q_pc


def gimbal_samples(
    scenario: Scenario,
    seed: int,
    trajectory: Trajectory,
    pilot: Autopilot,
    gimbal: SimulatedGimbal,
) -> list[Arrival]:
    """Return ``gimbal/joint_states`` and ``gimbal/attitude``, which arrive without delay.

    The reported attitude has the commanded roll and pitch; its heading is the autopilot's plus the
    encoders' yaw and the north bias.
    """
    epochs = Epochs.at_rate(scenario, scenario.gimbal.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    rotation_pg = gimbal.rotation_pg(epochs.t_s)
    noise = generator(seed, "encoders").standard_normal((len(epochs.t_s), 3))
    noise *= math.radians(scenario.gimbal.encoder_sigma_deg)
    rotation_bg = np.swapaxes(motion.rotation_pb, 1, 2) @ rotation_pg
    joints = joint_angles(rotation_bg, scenario.gimbal.joint_order) + noise
    nose = pilot.euler_rad(motion, trajectory.rotation_nb(motion))[:, 2]
    camera = euler_from_matrix(rotation_pg)[:, 2]
    encoder_yaw = camera - euler_from_matrix(motion.rotation_pb)[:, 2] + noise[:, 0]
    config, t_s = scenario.gimbal, epochs.t_s
    bias_deg = config.north_bias_deg + config.north_drift_deg_s * t_s
    bias_deg = bias_deg + config.north_step_deg * (t_s >= config.north_step_s)
    heading = nose + encoder_yaw + np.radians(bias_deg)
    reported = quat_from_euler(0.0, gimbal.commanded_pitch_rad(epochs.t_s), heading)
    samples: list[Arrival] = []
    for stamp, (yaw, roll, pitch), q_ng in zip(epochs.stamp_ns, joints, reported, strict=True):
        samples.append((stamp, JointSample(stamp, float(yaw), float(roll), float(pitch))))
        samples.append((stamp, CameraAttitudeSample(stamp, q_ng)))
    return samples
