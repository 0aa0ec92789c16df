"""Collect over a flight what the report compares: tracks, and the body's poses with the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.rotations import euler_from_quat, wrap_pi
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.replay.flight import WHOLE_FLIGHT_S
from tirgeo_ros.tools.replay.registration import Registered, Sample

#: Settling time of the filter; errors against the truth count only after it.
SETTLED_S = 20.0
_TRACK_HZ = 10.0
_SHOWN = 1500  # places, up to twice as many: a figure resolves no more


class Track:
    """Hold places of a flight, thinned for a plot."""

    def __init__(self) -> None:
        self._rate, self._places = RateLimit(_TRACK_HZ), list[tuple[float, float]]()

    def add(self, stamp_ns: int, latitude_rad: float, longitude_rad: float) -> None:
        """Add a place if it is finite and the rate allows it."""
        place = latitude_rad, longitude_rad
        if all(map(math.isfinite, place)) and self._rate.due(stamp_ns):
            self._places.append(place)

    @property
    def places(self) -> Array:
        """Return latitudes and longitudes (N, 2), rad."""
        step = max(len(self._places) // _SHOWN, 1)
        return np.array(self._places[::step], float).reshape(-1, 2)


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


class MethodSeries:
    """Watch the poses of a method: keep the track, and with a truth every pose of the body.

    ``has_poses`` says whether there was any camera pose. Only simulated flights have a truth.
    """

    def __init__(self, truth: TruePoses | None = None) -> None:
        self.track, self.has_poses = Track(), False
        self._truth = truth
        self._bodies: list[BodyPose] = []  # in the truth's plane

    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Take the poses that were computed from a sample."""
        self.has_poses = self.has_poses or bool(registered.cameras)
        solution = registered.solution
        if solution is not None:
            place = solution.latitude_rad, solution.longitude_rad
            self.track.add(solution.stamp_ns, *place)
            if self._truth is not None:
                self._bodies.append(self._truth.plane.body_pose(solution))

    def body_errors(self) -> BodyErrors | None:
        """Return the errors of the body's poses after settling; None without a truth."""
        return None if self._truth is None else body_errors(self._bodies, self._truth, SETTLED_S)
