"""Simulate the samples of the aircraft's sensors, each with its errors and its delay.

Every function returns ``(arrival_ns, sample)`` pairs in order of arrival; a sample's stamp is the
time of its measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.heading import azimuths, wrap_pi
from tirgeo_ros.core.frames.rotations import (
    euler_from_matrix,
    quat_from_euler,
)
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
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
from tirgeo_ros.tools.simulate.imu_errors import ImuBias, imu_white
from tirgeo_ros.tools.simulate.processes import Spline, gauss_markov, generator, scaled_noise
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.trajectory import Motion, Trajectory, geodetic_state, local_axes

#: Number of instants that represent the interval over which an IMU averages.
_PARTS = 8

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
        pilot, length_s = scenario.autopilot, scenario.duration_s
        self._heading: Spline = scaled_noise(
            generator(seed, "autopilot heading"),
            length_s,
            pilot.heading_time_s,
            math.radians(pilot.heading_rms_deg),
        )
        self._tilt: Spline = scaled_noise(
            generator(seed, "autopilot tilt"),
            length_s,
            pilot.tilt_time_s,
            np.radians(pilot.tilt_rms_deg),
        )

    def errors_rad(self, t_s: Array) -> Array:
        """Return reported minus true roll, pitch, yaw (N, 3)."""
        return np.concatenate([self._tilt(t_s), self._heading(t_s)], axis=-1)

    def euler_rad(self, motion: Motion, rotation_nb: Array) -> Array:
        """Return the reported roll, pitch, yaw (N, 3)."""
        return euler_from_matrix(rotation_nb) + self.errors_rad(motion.t_s)


def imu_samples(
    scenario: Scenario, seed: int, trajectory: Trajectory, pilot: Autopilot, bias: ImuBias
) -> list[Arrival]:
    """Return ``imu/data``: force and rate with white noise and bias; the autopilot's attitude.

    Force and rate are those of the stamp, or means over the interval before it, as the scenario
    says.
    """
    epochs = Epochs.at_rate(scenario, scenario.imu.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    averages = scenario.imu.averages
    force, rate = _means(scenario, trajectory, epochs) if averages else trajectory.inertial(motion)
    white = imu_white(scenario.imu, seed, len(epochs.stamp_ns))
    rate, force = rate + bias.gyro_b + white[0], force + bias.accel_b + white[1]
    rotation_nb = _rotation_nb(trajectory, motion)
    q_nb = quat_from_euler(*pilot.euler_rad(motion, rotation_nb).T)
    return [
        (stamp, ImuSample(stamp, f, w, q))
        for stamp, f, w, q in zip(epochs.stamp_ns, force, rate, q_nb, strict=True)
    ]


def _means(scenario: Scenario, trajectory: Trajectory, epochs: Epochs) -> tuple[Array, Array]:
    """Return force and rate (N, 3): means over the interval that ends with each epoch."""
    # Midpoint rule: with eight parts, the error from the motion's curvature is 1/64 of that with
    # one part.
    shares = (np.arange(_PARTS) + 0.5) / _PARTS
    times = epochs.t_s[:, None] - shares / scenario.imu.rate_hz
    motion = trajectory.motion(np.maximum(times, 0.0).ravel())  # the flight begins at 0
    force, rate = (x.reshape(-1, _PARTS, 3).mean(axis=1) for x in trajectory.inertial(motion))
    return force, rate


def _rotation_nb(trajectory: Trajectory, motion: Motion) -> Array:
    """Return the rotations (N, 3, 3) from body to north, east, down at the aircraft.

    Near a pole those axes differ from the site's.
    """
    lat, lon, _ = trajectory.plane.geodetic_from_ned(motion.position_p)
    return np.asarray(local_axes(trajectory.plane, lat, lon) @ motion.rotation_pb)


def rtk_samples(scenario: Scenario, seed: int, trajectory: Trajectory) -> list[Arrival]:
    """Return ``rtk/fix``, ``rtk/vel`` and ``rtk/heading`` of the same epochs."""
    rtk = scenario.rtk
    epochs = Epochs.at_rate(scenario, rtk.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    delay_ns = round(rtk.arrival_delay_s * 1e9)
    rng = generator(seed, "rtk")
    draws = rng.standard_normal((2, len(epochs.stamp_ns), 3))
    sigmas = np.array(rtk.position_sigma_m), np.array(rtk.velocity_sigma_m_s)
    fixes = _fixes(
        trajectory,
        epochs,
        (motion, scenario.aircraft.rtk_lever_b),
        (draws[0] * sigmas[0], draws[1] * sigmas[1]),
        (np.diag(sigmas[0] ** 2), np.diag(sigmas[1] ** 2)),
        (Source.RTK_POSITION, Source.RTK_VELOCITY),
        FixStatus.FIXED,
    )
    headings = _headings(scenario, seed, _rotation_nb(trajectory, motion), epochs)
    return [
        (sample.stamp_ns + delay_ns, sample)
        for epoch in zip(*fixes, headings, strict=True)
        for sample in epoch
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
    baseline_n = rotation_nb @ baseline_b
    heading_deg = np.degrees(azimuths(baseline_n))
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
    gps = scenario.gps
    epochs = Epochs.at_rate(scenario, gps.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    slow = scaled_noise(
        generator(seed, "gps position"),
        scenario.duration_s,
        gps.position_time_s,
        np.array(gps.position_rms_m),
    )
    draws = generator(seed, "gps velocity").standard_normal((len(epochs.t_s), 3))
    positions, velocities = _fixes(
        trajectory,
        epochs,
        (motion, scenario.aircraft.gps_lever_b),
        (slow(epochs.t_s), gps.velocity_sigma_m_s * draws),
        (np.diag(np.array(gps.position_rms_m) ** 2), np.eye(3) * gps.velocity_sigma_m_s**2),
        (Source.GPS_POSITION, Source.GPS_VELOCITY),
        FixStatus.SINGLE,
    )
    delay_ns = round(gps.arrival_delay_s * 1e9)
    pairs = zip(positions, velocities, strict=True)
    return [(sample.stamp_ns + delay_ns, sample) for pair in pairs for sample in pair]


def barometer_samples(scenario: Scenario, seed: int, trajectory: Trajectory) -> list[Arrival]:
    """Return ``baro/pressure``: the standard atmosphere's at a height with errors; or nothing."""
    barometer = scenario.barometer
    if not barometer.rate_hz:
        return []
    epochs = Epochs.at_rate(scenario, barometer.rate_hz)
    position_p = trajectory.motion(epochs.t_s).position_p
    height_m = trajectory.plane.geodetic_from_ned(position_p)[2]
    count, step_s = len(epochs.t_s), 1 / barometer.rate_hz
    rng = generator(seed, "barometer")
    white, steps = rng.standard_normal((2, count))
    wander = gauss_markov(
        rng, count, step_s, np.array([barometer.wander_time_s]), np.array([barometer.wander_rms_m])
    )
    drift_m = barometer.drift * math.sqrt(step_s) * np.cumsum(steps)
    errors_m = barometer.offset_m + barometer.noise_m * white + wander[:, 0] + drift_m
    return [
        (stamp, PressureSample(stamp, standard_pressure_pa(height), 0.0))
        for stamp, height in zip(epochs.stamp_ns, (height_m + errors_m).tolist(), strict=True)
    ]


def _fixes(
    trajectory: Trajectory,
    epochs: Epochs,
    antenna: tuple[Motion, Array],
    errors_n: tuple[Array, Array],
    covariances_n: tuple[Array, Array],
    sources: tuple[Source, Source],
    status: FixStatus,
) -> tuple[list[PositionSample], list[VelocitySample]]:
    """Return position and velocity of the antenna ``(motion, arm_b)``, with errors (N, 3), NED."""
    motion, arm_b = antenna
    position_p, velocity_p = motion.at_arm(arm_b)
    lat, lon, height, velocity_n, _ = geodetic_state(
        trajectory.plane, position_p, velocity_p, motion.rotation_pb
    )
    lat, lon, height = _shifted(lat, lon, height, errors_n[0])
    velocity_n = velocity_n + errors_n[1]
    positions = [
        PositionSample(
            stamp, sources[0], status, float(lat[k]), float(lon[k]), float(height[k]),
            covariances_n[0],
        )
        for k, stamp in enumerate(epochs.stamp_ns)
    ]  # fmt: skip
    velocities = [
        VelocitySample(stamp, sources[1], velocity_n[k], covariances_n[1])
        for k, stamp in enumerate(epochs.stamp_ns)
    ]
    return positions, velocities


def _shifted(lat: Array, lon: Array, height: Array, error_n: Array) -> tuple[Array, Array, Array]:
    """Return positions moved by (N, 3) metres north, east, down."""
    # Errors are metres, the site some hundred metres: one point's radii are accurate to 1e-5 of
    # the error.
    meridian, transverse = radii_of_curvature(float(lat[0]))
    return (
        lat + error_n[:, 0] / (meridian + height),
        wrap_pi(lon + error_n[:, 1] / ((transverse + height) * np.cos(lat))),
        height - error_n[:, 2],
    )
