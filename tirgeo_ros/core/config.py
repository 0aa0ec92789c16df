"""The parameters of the nodes and of ``tirgeo process``, each default once.

Defaults for the IMU are Table 5 of Ren et al. 2022. Lever arms here are in ROS's axes
(``base_link``: forward, left, up) as the user writes them; properties give them in the core's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames import flu_from_frd
from tirgeo_ros.core.parameter import group, param
from tirgeo_ros.core.samples import Array

METHODS = ("raw", "rtk", "ekf", "ekf_heading")
_LARGE = 1e3


@dataclass(frozen=True, slots=True)
class ImuConfig:
    """Noise of the IMU: white noise and a first-order Gauss-Markov bias on each axis (x, y, z)."""

    angle_random_walk: tuple[float, ...] = param(
        (1.6828e-4, 1.9601e-4, 1.6542e-4),
        "gyroscope white noise",
        unit="rad/sqrt(s)",
        low=0,
        high=1,
    )
    velocity_random_walk: tuple[float, ...] = param(
        (1.2917e-2, 1.2996e-2, 1.2921e-2),
        "accelerometer white noise",
        unit="m/s/sqrt(s)",
        low=0,
        high=10,
    )
    gyro_bias_instability: tuple[float, ...] = param(
        (1.5289e-6, 3.7010e-5, 2.2793e-6),
        "standard deviation of the gyroscope bias",
        unit="rad/s",
        low=0,
        high=1,
    )
    gyro_bias_time_s: tuple[float, ...] = param(
        (7000.0, 100.0, 9000.0),
        "correlation time of the gyroscope bias",
        unit="s",
        low=1e-3,
        high=1e9,
    )
    accel_bias_instability: tuple[float, ...] = param(
        (6.0546e-3, 2.8561e-3, 7.9284e-3),
        "standard deviation of the accelerometer bias",
        unit="m/s2",
        low=0,
        high=10,
    )
    accel_bias_time_s: tuple[float, ...] = param(
        (20.0, 600.0, 10000.0),
        "correlation time of the accelerometer bias",
        unit="s",
        low=1e-3,
        high=1e9,
    )
    gyro_turn_on_bias: float = param(
        1e-3, "standard deviation of the gyroscope bias at start", unit="rad/s", low=0, high=1
    )
    accel_turn_on_bias: float = param(
        2e-2, "standard deviation of the accelerometer bias at start", unit="m/s2", low=0, high=10
    )


@dataclass(frozen=True, slots=True)
class RtkConfig:
    """The RTK receiver's position and velocity."""

    lever_arm_m: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "antenna from the IMU, base_link axes (forward, left, up)",
        unit="m",
        low=-_LARGE,
        high=_LARGE,
    )
    median_window: int = param(
        1, "number of positions in the median filter; 1 = off", low=1, high=99
    )
    delay_s: float = param(
        0.0,
        "time from measurement to stamp, for receivers that stamp at arrival",
        unit="s",
        low=0,
        high=2,
    )
    position_sigma_floor_m: float = param(
        0.01,
        "smallest standard deviation believed of a position, per axis",
        unit="m",
        low=1e-4,
        high=100,
    )
    velocity_sigma_floor_m_s: float = param(
        0.02,
        "smallest standard deviation believed of a velocity, per axis",
        unit="m/s",
        low=1e-4,
        high=100,
    )
    gate_sigma: float = param(
        5.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )
    float_sigma_m: float = param(
        0.3, "smallest standard deviation believed of a float position", unit="m", low=0, high=100
    )
    float_time_s: float = param(
        20.0, "correlation time of a float position's error", unit="s", low=1e-3, high=1e5
    )
    reset_after_s: float = param(
        2.0,
        "positions or velocities that agree with each other but are refused for so long set the "
        "state",
        unit="s",
        low=0.1,
        high=3600,
    )

    @property
    def lever_arm_b(self) -> Array:
        """(3,) antenna from the IMU, FRD, m."""
        return flu_from_frd(np.array(self.lever_arm_m))


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The heading of the two RTK antennas."""

    offset_deg: float = param(
        0.0,
        "direction that rtk/heading reports, from the nose, clockwise from above",
        unit="deg",
        low=-360,
        high=360,
    )
    sigma_floor_deg: float = param(
        0.6, "smallest standard deviation believed of a heading", unit="deg", low=1e-3, high=180
    )
    resolution_deg: float = param(
        0.0,
        "headings are read as intervals of this width, sigma_floor_deg being the least noise "
        "before the rounding; 0 = as numbers with noise",
        unit="deg",
        low=0,
        high=90,
    )
    gate_sigma: float = param(
        4.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )
    baseline_m: tuple[float, ...] = param(
        (),
        "second antenna from the first, base_link axes (forward, left, up); empty = level, in the "
        "direction of offset_deg",
        unit="m",
        low=-_LARGE,
        high=_LARGE,
        sizes=(0, 3),
    )
    start_after_s: float = param(
        1.0, "rtk/fix must be fixed for so long before headings are used", unit="s", low=0, high=60
    )
    reset_after_s: float = param(
        5.0,
        "headings that agree with each other but are refused for at least so long set the state",
        unit="s",
        low=0.1,
        high=3600,
    )
    bias_sigma_deg: float = param(
        0.0,
        "standard deviation of a slow error of the headings that is estimated; 0 = none",
        unit="deg",
        low=0,
        high=30,
    )
    bias_time_s: float = param(600.0, "correlation time of that error", unit="s", low=1, high=1e9)


@dataclass(frozen=True, slots=True)
class GpsConfig:
    """The autopilot's ordinary GPS."""

    lever_arm_m: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "antenna from the IMU, base_link axes (forward, left, up)",
        unit="m",
        low=-_LARGE,
        high=_LARGE,
    )
    position_sigma_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017),
        "north, east, down standard deviation where the message has none",
        unit="m",
        low=1e-3,
        high=1e4,
    )
    position_time_s: float = param(
        45.0, "correlation time of the position's error", unit="s", low=0.1, high=1e6
    )
    position_noise_m: float = param(
        0.05, "part of the position's error that is new in each fix", unit="m", low=1e-3, high=100
    )
    velocity_sigma_floor_m_s: float = param(
        0.1,
        "smallest standard deviation believed of a velocity, per axis",
        unit="m/s",
        low=1e-3,
        high=100,
    )
    delay_s: float = param(
        0.0,
        "time from measurement to stamp, for receivers that stamp at arrival",
        unit="s",
        low=0,
        high=2,
    )
    gate_sigma: float = param(
        5.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )

    @property
    def lever_arm_b(self) -> Array:
        """(3,) antenna from the IMU, FRD, m."""
        return flu_from_frd(np.array(self.lever_arm_m))


@dataclass(frozen=True, slots=True)
class AutopilotConfig:
    """The autopilot's own attitude, which the methods ``raw`` and ``rtk`` take as it is."""

    attitude_sigma_deg: tuple[float, ...] = param(
        (0.5, 0.5, 1.7972),
        "roll, pitch, heading standard deviation",
        unit="deg",
        low=1e-3,
        high=180,
    )


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """Finding the first attitude."""

    duration_s: float = param(
        1.0,
        "time over which the accelerometer and the velocity are compared",
        unit="s",
        low=0.2,
        high=30,
    )
    wait_s: float = param(
        5.0,
        "RTK and its heading are waited for so long before ordinary GPS or the autopilot's "
        "heading serve to start",
        unit="s",
        low=0,
        high=3600,
    )


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When an aid counts as missing, and when the state is not to be trusted any more."""

    aid_timeout_s: float = param(
        1.5, "an aid that was not used for longer is missing", unit="s", low=0.1, high=60
    )
    lost_position_sigma_m: float = param(
        10.0, "the position is lost beyond this standard deviation", unit="m", low=0.1, high=1e4
    )
    lost_heading_sigma_deg: float = param(
        10.0, "the heading is lost beyond this standard deviation", unit="deg", low=0.1, high=180
    )


@dataclass(frozen=True, slots=True)
class EkfConfig:
    """Parameters of ekf_node."""

    method: str = param("ekf_heading", "raw, rtk, ekf or ekf_heading", choices=METHODS)
    position_update: str = param(
        "fused", "fused, or rtk_direct (Ren et al. 2022)", choices=("fused", "rtk_direct")
    )
    publish_rate_hz: float = param(
        100.0, "highest rate of tirgeo/odometry", unit="Hz", low=0.1, high=1000
    )
    fix_rate_hz: float = param(10.0, "highest rate of tirgeo/fix", unit="Hz", low=0.1, high=1000)
    max_delay_s: float = param(
        0.5, "a measurement may come this much later than it was made", unit="s", low=0, high=5
    )
    max_imu_gap_s: float = param(
        0.2, "longest gap between IMU samples that is bridged", unit="s", low=1e-3, high=5
    )
    origin_lat_lon_h: tuple[float, ...] = param(
        (),
        "origin of map: latitude, longitude (deg), ellipsoidal height (m); empty = first position",
        sizes=(0, 3),
    )
    imu: ImuConfig = group(ImuConfig)
    rtk: RtkConfig = group(RtkConfig)
    heading: HeadingConfig = group(HeadingConfig)
    gps: GpsConfig = group(GpsConfig)
    autopilot: AutopilotConfig = group(AutopilotConfig)
    alignment: AlignmentConfig = group(AlignmentConfig)
    trust: TrustConfig = group(TrustConfig)


@dataclass(frozen=True, slots=True)
class NorthConfig:
    """The gimbal's north against the autopilot's, for the composition ``paper``."""

    bias_deg: float = param(
        0.0,
        "reported camera heading less the true one by the autopilot's north, as calibrated",
        unit="deg",
        low=-180,
        high=180,
    )
    sigma_deg: float = param(
        3.0, "standard deviation of bias_deg at the start", unit="deg", low=0, high=100
    )
    walk_deg: float = param(
        0.03,
        "standard deviation of the bias's change in one second; grows with the root of the time",
        unit="deg",
        low=0,
        high=10,
    )
    centred: bool = param(
        False, "the gimbal follows the nose and nobody turns it aside: the bias can be read"
    )
    settle_s: float = param(
        3.0,
        "a centred gimbal is read after the nose has kept still for so long; six of its time "
        "constants",
        unit="s",
        low=0,
        high=60,
    )
    centred_sigma_deg: float = param(
        0.3,
        "standard deviation of the angle from the nose to a centred camera, which stays the same",
        unit="deg",
        low=0,
        high=90,
    )
    noise_deg: float = param(
        0.2,
        "standard deviation of a reading of the bias, the mean of one second",
        unit="deg",
        low=1e-3,
        high=90,
    )
    gate_sigma: float = param(
        5.0, "readings beyond this many standard deviations are refused", low=1, high=1e6
    )
    reset_after_s: float = param(
        5.0,
        "readings that agree with each other but are refused for at least so long set the bias",
        unit="s",
        low=0.1,
        high=3600,
    )


@dataclass(frozen=True, slots=True)
class GimbalConfig:
    """Parameters of gimbal_node."""

    composition: str = param(
        "auto",
        "paper (reported roll and pitch, filtered heading), encoders (body attitude and joints), "
        "or auto: encoders while joint angles arrive, else paper",
        choices=("auto", "paper", "encoders"),
    )
    lever_arm_m: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "gimbal pivot from the IMU, base_link axes (forward, left, up)",
        unit="m",
        low=-_LARGE,
        high=_LARGE,
    )
    camera_offset_m: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "camera from the pivot, camera body axes (forward, left, up)",
        unit="m",
        low=-_LARGE,
        high=_LARGE,
    )
    boresight_rpy_deg: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "mounting error of the camera: roll, pitch, yaw about camera body axes forward, left, up",
        unit="deg",
        low=-180,
        high=180,
    )
    encoder_sigma_deg: float = param(
        0.05, "standard deviation of a joint angle", unit="deg", low=0, high=90
    )
    reported_sigma_deg: tuple[float, ...] = param(
        (0.2704, 0.4839),
        "standard deviation of the reported camera roll and pitch (Table 8)",
        unit="deg",
        low=0,
        high=90,
    )
    max_wait_s: float = param(
        0.5,
        "a gimbal sample waits this long for the body pose around it",
        unit="s",
        low=0,
        high=10,
    )
    max_gap_s: float = param(
        0.25,
        "longest time between two body poses that is bridged; more than 1 / publish_rate_hz",
        unit="s",
        low=1e-3,
        high=2,
    )
    north: NorthConfig = group(NorthConfig)

    @property
    def lever_arm_b(self) -> Array:
        """(3,) pivot from the IMU, FRD, m."""
        return flu_from_frd(np.array(self.lever_arm_m))

    @property
    def camera_offset_g(self) -> Array:
        """(3,) camera from the pivot, camera body FRD, m."""
        return flu_from_frd(np.array(self.camera_offset_m))

    @property
    def boresight_rpy_rad(self) -> Array:
        """(3,) roll, pitch, yaw of the mounting error about camera body FRD axes, rad."""
        return np.radians(flu_from_frd(np.array(self.boresight_rpy_deg)))


@dataclass(frozen=True, slots=True)
class OverlayConfig:
    """Parameters of overlay_node."""

    map: str = param("", "the map's file")
    ground_height_m: float = param(
        math.nan,
        "ellipsoidal height of the ground; unset = the map's own heights",
        unit="m",
        low=-500,
        high=9000,
    )
    video_latency_s: float = param(0.05, "image stamp minus exposure", unit="s", low=-1, high=5)
    max_pose_wait_s: float = param(
        0.1,
        "a frame waits this long for the camera pose around its exposure",
        unit="s",
        low=0,
        high=5,
    )
    label_field: str = param("name", "property of a map feature that is its label")
    jpeg_quality: int = param(80, "quality of overlay/image/compressed", low=1, high=100)


@dataclass(frozen=True, slots=True)
class BagPlayerConfig:
    """Parameters of bag_player."""

    bag: str = param("", "the MCAP file to play")
    rate: float = param(1.0, "speed, times real time", low=0.01, high=100)
    start_offset_s: float = param(0.0, "where in the bag to begin", unit="s", low=0, high=1e6)
    loop: bool = param(False, "begin again at the end")
    clock_rate_hz: float = param(100.0, "rate of /clock", unit="Hz", low=1, high=100)
    wait_timeout_s: float = param(
        30.0, "longest wait for subscribers before the first message", unit="s", low=0, high=3600
    )
    wait_for: str = param(
        "",
        "topics, separated by commas, that need a subscriber before the start; empty = any topic",
    )
    topics: str = param(
        "",
        "topics to play, separated by commas; empty = all that the graph does not make itself",
    )


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """Parameters of recorder."""

    output: str = param("", "the MCAP file to write")
    topics: str = param("", "topics to record, separated by commas")


#: Every node's parameter tree, by the node's name.
NODE_CONFIGS: dict[str, type] = {
    "ekf_node": EkfConfig,
    "gimbal_node": GimbalConfig,
    "overlay_node": OverlayConfig,
    "bag_player": BagPlayerConfig,
    "recorder": RecorderConfig,
}
