"""Load whole flights into memory: a bag's samples, the poses computed from them, the truth."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import resolved
from tirgeo_ros.tools.replay.picture_size import check_size, picture_size
from tirgeo_ros.tools.replay.registration import SAMPLES, Sample, composed, navigated

COMPOSITIONS = ("paper", "encoders")
_CAMERA_INFO = "thermal/camera_info"
_WHOLE_FLIGHT_S = 1e9


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
    cdr, samples = Cdr(), []
    arrivals = Arrivals()
    reader = BagReader(path)
    first_ns, last_ns = reader.span_ns
    topics = {resolved(name, namespace): name for name in (*SAMPLES, _CAMERA_INFO)}
    for item in reader.messages(topics):
        topic = topics[item.topic]
        progress((item.log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
        if topic in SAMPLES:
            sample = SAMPLES[topic](cdr.deserialize(item.data, item.typename))
            samples.append(arrivals.stamped(topic, sample, item.log_time_ns))
        elif camera is None:
            camera = convert.camera(cdr.deserialize(item.data, item.typename))
    if camera is None:
        raise BagError(f"{path}: needed topic absent: {resolved(_CAMERA_INFO, namespace)}")
    check_size(camera, picture_size(reader, namespace), str(path))
    return Recording(samples, camera)


@dataclass
class FlightTrack:
    """Hold the poses of a whole flight in one tangent plane."""

    plane: TangentPlane
    bodies: list[BodyPose] = field(default_factory=list)
    cameras: dict[str, PoseBuffer[CameraPose]] = field(
        default_factory=lambda: {name: PoseBuffer(_WHOLE_FLIGHT_S) for name in COMPOSITIONS}
    )


def track_of(samples: Iterable[Sample], ekf: EkfConfig, gimbal: GimbalConfig) -> FlightTrack:
    """Compute poses with every composition; ``ekf`` must set the origin of the plane."""
    navigation = Navigation(ekf)
    assert navigation.plane is not None
    track = FlightTrack(navigation.plane)
    composers = {
        name: GimbalComposer(dataclasses.replace(gimbal, composition=name))
        for name in COMPOSITIONS
    }
    for sample in samples:
        solution = navigated(navigation, sample)
        body = None if solution is None else track.plane.body_pose(solution)
        if body is not None:
            track.bodies.append(body)
        for name, composer in composers.items():
            for pose in composed(composer, sample, body):
                track.cameras[name].add(pose)
    return track


@dataclass(frozen=True)
class TruePoses:
    """Hold the true poses of a flight and their tangent plane."""

    plane: TangentPlane
    bodies: PoseBuffer[BodyPose]


def load_truth(path: Path) -> TruePoses:
    """Read ``tirgeo/odometry`` and ``tirgeo/origin`` of a bag. Raise BagError without them."""
    cdr, plane = Cdr(), None
    bodies: PoseBuffer[BodyPose] = PoseBuffer(_WHOLE_FLIGHT_S)
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
