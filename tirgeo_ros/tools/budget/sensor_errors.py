"""Measure the errors of a flight's ordinary GPS and autopilot (Ren et al. 2022, Eq. 22, Table 1).

RTK is the truth for the positions; the filter with the dual-antenna heading is the truth for the
heading.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.heading import azimuths, wrap_pi
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    matrix_from_euler,
    matrix_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.recorded_flight import load_recording
from tirgeo_ros.tools.replay.registration import Registration

#: The heading is compared with the filter's only from this time on, s.
SETTLED_S = 20.0
_LONGEST_GAP_NS = 1_000_000_000  # longest interval between two RTK positions to interpolate across


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Hold root mean square errors of Equation 22; nan if the bag lacks the data."""

    east_m: float
    north_m: float
    height_m: float
    heading_rad: float
    positions: int  # GPS positions compared
    headings: int  # autopilot headings compared


@dataclass(frozen=True)
class CameraTrack:
    """Hold the view of a flight's camera by the filter: medians."""

    height_m: float  # ellipsoidal, of the camera
    depression_rad: float  # of the optical axis below the horizon
    speed_m_s: float
    covariance_a: Array  # (6, 6) mean over the poses, along ahead, right, down


@dataclass(frozen=True)
class MeasuredFlight:
    """Hold what is measured from a bag."""

    camera: Camera
    errors: SensorErrors
    track: CameraTrack


def measured_flight(
    bag: PathLike,
    ekf: EkfConfig,
    gimbal: GimbalConfig,
    namespace: str = "",
    progress: Report = silent,
    *,
    camera: Camera | None = None,
) -> MeasuredFlight:
    """Compute Equation 22 from a bag, and the camera's track. Raise BagError."""
    recording = load_recording(Path(bag), namespace, progress, camera=camera)
    samples = recording.samples
    ekf = config_from(EkfConfig, values_of(ekf) | {"method": "ekf_heading"})
    registration = Registration(ekf, gimbal)
    bodies: list[BodyPose] = []
    cameras: list[CameraPose] = []
    for sample in samples:
        found = registration.take(sample)
        if found.body is not None:
            bodies.append(found.body)
        cameras.extend(found.cameras)
    plane = registration.navigation.plane
    if plane is None or not bodies or len(cameras) < 2:
        raise BagError(f"{bag}: no pose could be made of this flight")
    imu = [s for s in samples if isinstance(s, ImuSample) and s.autopilot_q_nb is not None]
    positions = [s for s in samples if isinstance(s, PositionSample)]
    apart = gps_less_rtk_n(positions, imu, plane, ekf)
    headings = _heading_errors(bodies, imu)
    north, east, height = rms(apart).tolist() if len(apart) else [math.nan] * 3
    heading_rad = float(rms(headings)) if len(headings) else math.nan
    errors = SensorErrors(east, north, height, heading_rad, len(apart), len(headings))
    track = camera_track(_settled(cameras, bodies[0].stamp_ns), plane)
    return MeasuredFlight(recording.camera, errors, track)


def gps_less_rtk_n(
    positions: Iterable[PositionSample],
    imu: Sequence[ImuSample],
    plane: TangentPlane,
    ekf: EkfConfig,
) -> Array:
    """Return GPS minus RTK positions (N, 3), NED, m, both reduced to the IMU.

    RTK is interpolated to the instants of the GPS.
    """
    kept = [p for p in positions if p.source is Source.GPS_POSITION or p.status is FixStatus.FIXED]
    rtk = [p for p in kept if p.source is Source.RTK_POSITION]
    gps = [p for p in kept if p.source is Source.GPS_POSITION]
    if len(rtk) < 2 or not gps or not imu:
        return np.empty((0, 3))
    truth_ns, truth_n = _of_imu(rtk, imu, plane, ekf.aircraft.rtk_lever_b)
    at_ns, found_n = _of_imu(gps, imu, plane, ekf.aircraft.gps_lever_b)
    after = np.clip(np.searchsorted(truth_ns, at_ns), 1, len(truth_ns) - 1)
    within = (at_ns >= truth_ns[after - 1]) & (at_ns <= truth_ns[after])
    within &= truth_ns[after] - truth_ns[after - 1] <= _LONGEST_GAP_NS
    interpolated = np.stack(
        [np.interp(at_ns - truth_ns[0], truth_ns - truth_ns[0], axis) for axis in truth_n.T], -1
    )
    return np.asarray((found_n - interpolated)[within])


def _of_imu(
    positions: Sequence[PositionSample],
    imu: Sequence[ImuSample],
    plane: TangentPlane,
    lever_arm_b: Array,
) -> tuple[npt.NDArray[np.int64], Array]:
    """Return stamps (ns) and positions (N, 3), NED, m, of the IMU.

    They are the antenna's, reduced by the lever arm and the autopilot's attitude.
    """
    stamps = np.array([p.stamp_ns for p in positions], np.int64)
    _, first = np.unique(stamps, return_index=True)  # in order of time, each once
    chosen = [positions[k] for k in first]
    places = plane.ned_from_geodetic(
        np.array([p.latitude_rad for p in chosen]),
        np.array([p.longitude_rad for p in chosen]),
        np.array([p.height_m for p in chosen]),
    )
    imu_ns = np.array([s.stamp_ns for s in imu], np.int64)
    near = np.clip(np.searchsorted(imu_ns, stamps[first]), 0, len(imu) - 1)
    q_nb = np.array([imu[k].autopilot_q_nb for k in near])
    return stamps[first], places - matrix_from_quat(q_nb) @ lever_arm_b


def _heading_errors(bodies: Sequence[BodyPose], imu: Sequence[ImuSample]) -> Array:
    """Return the autopilot's heading minus the filter's (N,), rad, at equal stamps.

    Stamps before the filter has settled are left out.
    """
    autopilot = {sample.stamp_ns: sample.autopilot_q_nb for sample in imu}
    start_ns = bodies[0].stamp_ns + round(SETTLED_S * 1e9)
    pairs = [
        (autopilot[body.stamp_ns], body.q_nb)
        for body in bodies
        if body.stamp_ns >= start_ns and body.stamp_ns in autopilot
    ]
    if not pairs:
        return np.empty(0)
    reported, filtered = (euler_from_quat(np.array([pair[k] for pair in pairs])) for k in (0, 1))
    return np.asarray(wrap_pi(reported[:, 2] - filtered[:, 2]))


def _settled(cameras: Sequence[CameraPose], start_ns: int) -> Sequence[CameraPose]:
    """Return the poses after the filter has settled; all poses of a shorter flight."""
    late = [pose for pose in cameras if pose.stamp_ns >= start_ns + SETTLED_S * 1e9]
    return late if len(late) > 1 else cameras


def camera_track(cameras: Sequence[CameraPose], plane: TangentPlane) -> CameraTrack:
    """Return the track of at least two poses, in order of time."""
    places_n = np.array([pose.position_n for pose in cameras])
    times_s = np.array([(pose.stamp_ns - cameras[0].stamp_ns) * 1e-9 for pose in cameras])
    axes_n = matrix_from_quat(np.array([pose.q_nc for pose in cameras]))[:, :, 2]
    _, _, height_m = plane.geodetic_from_ned(places_n)
    speeds = np.linalg.norm(np.gradient(places_n, times_s, axis=0), axis=1)
    return CameraTrack(
        float(np.median(height_m)),
        float(np.arcsin(np.clip(np.median(axes_n[:, 2]), -1, 1))),
        float(np.median(speeds)),
        _mean_covariance(cameras, azimuths(axes_n)),
    )


def _mean_covariance(cameras: Sequence[CameraPose], heading_rad: Array) -> Array:
    """Return the mean covariance of the poses (6, 6) along ahead, right, down."""
    turn = np.zeros((len(cameras), 6, 6))
    level = matrix_from_euler(np.zeros_like(heading_rad), np.zeros_like(heading_rad), heading_rad)
    turn[:, :3, :3] = turn[:, 3:, 3:] = level.transpose(0, 2, 1)
    covariance_n = np.array([pose.covariance for pose in cameras])
    return np.asarray(np.mean(turn @ covariance_n @ turn.transpose(0, 2, 1), axis=0))
