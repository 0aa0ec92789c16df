"""Define the parameters of ekf_node and of the filter in ``tirgeo process``, each default once.

Defaults for the IMU are Table 5 of Ren et al. 2022.
"""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft import AircraftConfig
from tirgeo_ros.core.config.filter_aiding import (
    BarometerConfig,
    GpsConfig,
    HeadingConfig,
    RtkConfig,
)
from tirgeo_ros.core.config.frames import TransformsConfig
from tirgeo_ros.core.config.schema import group, param

METHODS = ("raw", "rtk", "ekf", "ekf_heading")


@dataclass(frozen=True, slots=True)
class ImuNoiseConfig:
    """Noise of the IMU: white noise and a first-order Gauss-Markov bias on each axis (x, y, z)."""

    angle_random_walk: tuple[float, ...] = param(
        (1.6828e-4, 1.9601e-4, 1.6542e-4), "gyroscope white noise", ("rad/sqrt(s)", 0, 1)
    )
    velocity_random_walk: tuple[float, ...] = param(
        (1.2917e-2, 1.2996e-2, 1.2921e-2), "accelerometer white noise", ("m/s/sqrt(s)", 0, 10)
    )
    gyro_bias_instability: tuple[float, ...] = param(
        (1.5289e-6, 3.7010e-5, 2.2793e-6), "sigma of the gyroscope bias", ("rad/s", 0, 1)
    )
    gyro_bias_time_s: tuple[float, ...] = param(
        (7000.0, 100.0, 9000.0), "correlation time of that bias", ("s", 1e-3, 1e9)
    )
    accel_bias_instability: tuple[float, ...] = param(
        (6.0546e-3, 2.8561e-3, 7.9284e-3), "sigma of the accelerometer bias", ("m/s2", 0, 10)
    )
    accel_bias_time_s: tuple[float, ...] = param(
        (20.0, 600.0, 10000.0), "correlation time of that bias", ("s", 1e-3, 1e9)
    )
    gyro_turn_on_bias: float = param(
        7e-3, "sigma of the gyroscope bias at start, every axis", ("rad/s", 0, 1)
    )
    accel_turn_on_bias: float = param(
        2e-2, "sigma of the accelerometer bias at start, every axis", ("m/s2", 0, 10)
    )


@dataclass(frozen=True, slots=True)
class ImuConfig(ImuNoiseConfig):
    """The IMU: its noise on each axis, what vibration adds to it, and its delay."""

    gyro_vibration_share: float = param(
        0.3,
        "share of the vibration measured in flight (density of the second differences of the "
        "readings) that counts as white noise of the gyroscope; 0 = the configured noise alone",
        ("", 0, 10),
    )
    accel_vibration_share: float = param(
        0.7,
        "share of the measured vibration that counts as white noise of the accelerometer; 0 = "
        "the configured noise alone",
        ("", 0, 10),
    )
    delay_s: float = param(
        0.0,
        "delay of the IMU stamps: stamp minus time of measurement. Half the sample interval for "
        "an IMU that averages over it and stamps at its end (0.005 at 100 Hz). Poses carry the "
        "corrected time",
        ("s", -0.5, 0.5),
    )


@dataclass(frozen=True, slots=True)
class AutopilotConfig:
    """The autopilot's own attitude, which the methods ``raw`` and ``rtk`` take as it is."""

    attitude_sigma_deg: tuple[float, ...] = param(
        (0.5, 0.5, 1.7972), "sigma of roll, pitch, heading", ("deg", 1e-3, 180)
    )


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """Finding the first attitude."""

    duration_s: float = param(
        1.0, "time over which accelerometer and velocity are compared", ("s", 0.2, 30)
    )
    wait_s: float = param(
        5.0,
        "longest wait for RTK and its heading before the ordinary GPS or the autopilot's "
        "heading is used to start",
        ("s", 0, 3600),
    )


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When an aid counts as missing, and when the state counts as lost."""

    aid_timeout_s: float = param(
        1.5, "time without a used measurement until an aid counts as missing", ("s", 0.1, 60)
    )
    lost_position_sigma_m: float = param(
        10.0,
        "standard deviation of the position beyond which it counts as lost; raised to 1.5 times "
        "what the receivers report, where that is more",
        ("m", 0.1, 1e4),
    )
    lost_heading_sigma_deg: float = param(
        10.0, "sigma of the heading beyond which it counts as lost", ("deg", 0.1, 180)
    )


@dataclass(frozen=True, slots=True)
class EkfConfig(TransformsConfig):
    """Parameters of ekf_node."""

    method: str = param(
        "ekf_heading",
        "raw (autopilot's GPS and attitude), rtk (RTK position, autopilot's attitude), ekf (the "
        "filter without heading) or ekf_heading (the filter with the heading of the two "
        "antennas)",
        choices=METHODS,
    )
    position_update: str = param(
        "fused",
        "fused (a full update), or rtk_direct (the position is the RTK's, after the median "
        "filter, as in Ren et al. 2022)",
        choices=("fused", "rtk_direct"),
    )
    publish_rate_hz: float = param(100.0, "highest rate of tirgeo/odometry", ("Hz", 0.1, 1000))
    fix_rate_hz: float = param(10.0, "highest rate of tirgeo/fix", ("Hz", 0.1, 1000))
    max_delay_s: float = param(
        0.5, "largest delay behind the IMU at which a measurement is still used", ("s", 0, 5)
    )
    max_imu_gap_s: float = param(
        0.2, "longest gap between IMU samples that is bridged", ("s", 1e-3, 5)
    )
    origin_lat_lon_h: tuple[float, ...] = param(
        (),
        "origin of the frame map: latitude, longitude (deg), ellipsoidal height (m); empty = "
        "the first accepted RTK position",
        sizes=(0, 3),
    )
    imu: ImuConfig = group(ImuConfig)
    rtk: RtkConfig = group(RtkConfig)
    heading: HeadingConfig = group(HeadingConfig)
    gps: GpsConfig = group(GpsConfig)
    barometer: BarometerConfig = group(BarometerConfig)
    autopilot: AutopilotConfig = group(AutopilotConfig)
    alignment: AlignmentConfig = group(AlignmentConfig)
    trust: TrustConfig = group(TrustConfig)
    aircraft: AircraftConfig = group(AircraftConfig)
