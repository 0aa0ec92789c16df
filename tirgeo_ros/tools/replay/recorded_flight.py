"""Load a flight's samples into memory, and the truth of a simulated one; compare the two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import euler_from_quat, wrap_pi
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_poses import WHOLE_FLIGHT_S, RecordedFlight
from tirgeo_ros.tools.replay.registration import SAMPLES, Sample


@dataclass(frozen=True)
class Recording:
    """Hold a flight's samples in order of arrival, and its camera."""

    samples: list[Sample]
    camera: Camera


def load_recording(
    path: Path,
    namespace: str = "",
    progress: Report = silent,
    *,
    camera: Camera | None = None,
) -> Recording:
    """Read a bag without its images; call ``progress`` with seconds of the bag.

    A given ``camera`` overrides the bag's. Raise BagError without thermal/camera_info, CameraError
    if the calibration has another size than the pictures.
    """
    samples: list[Sample] = []
    flight = RecordedFlight(BagReader(path), namespace, camera=camera)
    flight.add(SAMPLES, samples.append)
    flight.read_all(progress)
    return Recording(samples, flight.camera)


@dataclass(frozen=True)
class TruePoses:
    """Hold the true poses of a flight and their tangent plane."""

    plane: TangentPlane
    bodies: PoseBuffer[BodyPose]


def load_truth(path: Path) -> TruePoses:
    """Read ``tirgeo/odometry`` and ``tirgeo/origin`` of a bag. Raise BagError without them."""
    cdr, plane = Cdr(), None
    bodies: PoseBuffer[BodyPose] = PoseBuffer(WHOLE_FLIGHT_S)
    for item in BagReader(path).messages(["/tirgeo/origin", "/tirgeo/odometry"]):
        message = cdr.deserialize(item.data, item.typename)
        if item.topic == "/tirgeo/origin":
            plane = convert.tangent_plane(message)
        else:
            bodies.add(convert.body_pose(message))
    if plane is None or not len(bodies):
        raise BagError(f"{path}: needed topic absent: /tirgeo/origin or /tirgeo/odometry")
    return TruePoses(plane, bodies)


@dataclass(frozen=True, slots=True)
class BodyErrors:
    """Hold root mean square errors against the truth."""

    roll_rad: float
    pitch_rad: float
    heading_rad: float
    position_m: float  # in space


def body_errors(bodies: Sequence[BodyPose], truth: TruePoses, after_s: float) -> BodyErrors:
    """Return the errors of poses in the truth's plane, from ``after_s`` after the first pose."""
    pairs = [
        (pose, true)
        for pose in bodies
        if pose.stamp_ns >= bodies[0].stamp_ns + after_s * 1e9
        and isinstance(true := truth.bodies.at(pose.stamp_ns), BodyPose)
    ]
    if not pairs:
        return BodyErrors(math.nan, math.nan, math.nan, math.nan)
    angles, true_angles = (
        euler_from_quat(np.array([pair[k].q_nb for pair in pairs])) for k in (0, 1)
    )
    roll, pitch, heading = np.sqrt(np.mean(wrap_pi(angles - true_angles) ** 2, axis=0)).tolist()
    apart = np.array([pose.position_n - true.position_n for pose, true in pairs])
    return BodyErrors(roll, pitch, heading, float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))))
