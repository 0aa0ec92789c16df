"""Measure the errors of a flight's ordinary GPS and autopilot (Ren et al. 2022, Eq. 22, Table 1).

RTK is the truth for the positions; the filter with the dual-antenna heading is the truth for the
heading.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import (
    azimuths,
    euler_from_quat,
    matrix_from_quat,
    rotation_z,
    wrap_pi,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.registration import SAMPLES, Registration, Sample

#: The heading is compared with the filter's only from this time on, s.
_SETTLED_S = 20.0
_LONGEST_GAP_NS = 1_000_000_000  # longest interval between two RTK positions to interpolate across


class Track(NamedTuple):
    """Hold the view of a flight's camera by the filter: medians."""

    height_m: float  # ellipsoidal, of the camera
    depression_deg: float  # angle of the optical axis below the horizon
    speed_m_s: float
    covariance_a: Array  # (6, 6) mean over the poses, along ahead, right, down


@dataclass(frozen=True)
class MeasuredFlight:
    """Hold what is measured from a bag.

    ``errors`` are Table 1's, by the names of Setting's fields, nan if the bag lacks the data; and
    how many positions and headings were compared.
    """

    camera: Camera
    errors: Mapping[str, float]
    track: Track
    warning: str | None  # messages that were not used


def measured_flight(
    bag: PathLike,
    ekf: EkfConfig,
    gimbal: GimbalConfig,
    namespace: str,
    progress: Report,
    *,
    camera: Camera | None = None,
) -> MeasuredFlight:
    """Compute Equation 22 from a bag, and the camera's track. Raise BagError."""
    reader, samples = BagReader(bag), list[Sample]()
    flight = Flight(reader, namespace, camera=camera)
    flight.add(SAMPLES, samples.append)
    flight.read_all(progress)
    ekf = config_from(EkfConfig, values_of(ekf) | {"method": "ekf_heading"})
    bodies, cameras, plane = _poses(samples, ekf, gimbal)
    if plane is None or not bodies or len(cameras) < 2:
        raise BagError(f"{bag}: no pose could be made of this flight")
    imu = [s for s in samples if isinstance(s, ImuSample) and s.autopilot_q_nb is not None]
    positions = [s for s in samples if isinstance(s, PositionSample)]
    apart_n = gps_less_rtk_n(positions, imu, plane, ekf)
    settled_ns = bodies[0].stamp_ns + round(_SETTLED_S * 1e9)
    headings = _heading_errors([body for body in bodies if body.stamp_ns >= settled_ns], imu)
    north, east, height = rms(apart_n).tolist() if len(apart_n) else [math.nan] * 3
    errors = {
        "east_error_m": east,
        "north_error_m": north,
        "height_error_m": height,
        "heading_error_deg": float(np.degrees(rms(headings))) if len(headings) else math.nan,
        "positions": len(apart_n),
        "headings": len(headings),
    }
    late = [pose for pose in cameras if pose.stamp_ns >= settled_ns]
    track = camera_track(late if len(late) > 1 else cameras, plane)
    lost = [f"{flight.refused} messages could not be used"] if flight.refused else []
    lost += [str(reader.damage)] if reader.damage is not None else []
    warning = f"{bag}: {'; '.join(lost)}" if lost else None
    return MeasuredFlight(camera=flight.camera, errors=errors, track=track, warning=warning)


def _poses(
    samples: Sequence[Sample], ekf: EkfConfig, gimbal: GimbalConfig
) -> tuple[list[BodyPose], list[CameraPose], TangentPlane | None]:
    """Return the poses of body and camera, and their plane."""
    registration = Registration(ekf, gimbal)
    bodies: list[BodyPose] = []
    cameras: list[CameraPose] = []
    for sample in samples:
        registered = registration.take(sample)
        bodies += [] if registered.body is None else [registered.body]
        cameras += registered.cameras
    return bodies, cameras, registration.navigation.plane


def gps_less_rtk_n(
    positions: Iterable[PositionSample],
    imu: Sequence[ImuSample],
    plane: TangentPlane,
    ekf: EkfConfig,
) -> Array:
    """Return GPS minus RTK positions (N, 3), NED, m, both reduced to the IMU.

    RTK, fixed alone, is interpolated to the instants of the GPS.
    """
    of: dict[Source, list[PositionSample]] = {Source.RTK_POSITION: [], Source.GPS_POSITION: []}
    for position in positions:
        if position.source is Source.GPS_POSITION or position.status is FixStatus.FIXED:
            of[position.source].append(position)
    rtk, gps = of.values()
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
) -> tuple[IntArray, Array]:
    """Return stamps (ns) and positions (N, 3), NED, m, of the IMU.

    They are the antenna's, reduced by the lever arm and the autopilot's attitude.
    """
    stamps = np.array([p.stamp_ns for p in positions], np.int64)
    stamps, first = np.unique(stamps, return_index=True)  # in order of time, each once
    geodetic = np.array([(p.latitude_rad, p.longitude_rad, p.height_m) for p in positions])
    places = plane.ned_from_geodetic(*geodetic[first].T)
    imu_ns = np.array([s.stamp_ns for s in imu], np.int64)
    near = np.clip(np.searchsorted(imu_ns, stamps), 0, len(imu) - 1)
    q_nb = np.array([imu[k].autopilot_q_nb for k in near])
    return stamps, places - matrix_from_quat(q_nb) @ lever_arm_b


def _heading_errors(bodies: Sequence[BodyPose], imu: Sequence[ImuSample]) -> Array:
    """Return the autopilot's heading minus the filter's (N,), rad, at equal stamps."""
    autopilot = {sample.stamp_ns: sample.autopilot_q_nb for sample in imu}
    pairs = [(autopilot[b.stamp_ns], b.q_nb) for b in bodies if b.stamp_ns in autopilot]
    yaw = euler_from_quat(np.array(pairs).reshape(-1, 2, 4))[..., 2]
    return np.asarray(wrap_pi(yaw[:, 0] - yaw[:, 1]))


def camera_track(cameras: Sequence[CameraPose], plane: TangentPlane) -> Track:
    """Return the track of at least two poses, in order of time."""
    places_n = np.array([pose.position_n for pose in cameras])
    times_s = np.array([(pose.stamp_ns - cameras[0].stamp_ns) * 1e-9 for pose in cameras])
    axes_n = matrix_from_quat(np.array([pose.q_nc for pose in cameras]))[:, :, 2]
    speeds = np.linalg.norm(np.gradient(places_n, times_s, axis=0), axis=1)
    turn = np.zeros((len(cameras), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = rotation_z(-azimuths(axes_n))
    covariance_n = np.array([pose.covariance for pose in cameras])
    return Track(
        height_m=float(np.median(plane.geodetic_from_ned(places_n)[2])),
        depression_deg=math.degrees(math.asin(np.clip(np.median(axes_n[:, 2]), -1, 1))),
        speed_m_s=float(np.median(speeds)),
        covariance_a=np.asarray(np.mean(turn @ covariance_n @ turn.transpose(0, 2, 1), axis=0)),
    )
