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
"""Build the parts that messages share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.config import FrameIds, FramesConfig
from tirgeo_ros.core.frames.rotations import ENU_NED, quat_turned_both
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.io.messages.cdr import Cdr

_HALF = math.sqrt(0.5)
NO_ROTATION: Quaternion = (1.0, 0.0, 0.0, 0.0)
#: Variance of an unknown value in a message that cannot mark it as unknown: so large that the
#: value has no weight. (rad/s)^2 in a twist, rad^2 for roll and pitch in a heading message.
UNKNOWN_VARIANCE = 1e6
COVARIANCE_UNKNOWN, COVARIANCE_KNOWN = 0, 3
_SERVICE_GPS = 1  # the satellite systems in use are unknown here; GPS always takes part


def stamp_ns(msg: Any) -> int:
    """Return the header's stamp in nanoseconds."""
    stamp = msg.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def frd_ned(q: Any) -> Array:
    """Convert a message's quaternion (FLU to ENU) to (4,) wxyz (FRD to NED)."""
    return np.array(quat_turned_both(q.w, q.x, q.y, q.z))


def quat_turned_world(w: float, x: float, y: float, z: float) -> Quaternion:
    """Convert a quaternion wxyz from any frame to NED into one to ENU, or the reverse."""
    return _HALF * (x + y), -_HALF * (w + z), _HALF * (z - w), _HALF * (x - y)


def positive(q: Quaternion) -> Quaternion:
    """Return the same rotation with w >= 0."""
    w, x, y, z = q
    return (-w, -x, -y, -z) if w < 0 else q


def _entries(blocks: int) -> tuple[np.ndarray, Array]:
    """Return source index and sign of each entry of a covariance in the other frame; both flat."""
    turn = np.kron(np.eye(blocks), ENU_NED)
    source = np.argmax(np.abs(turn), axis=1)
    sign = turn.sum(axis=1)
    size = 3 * blocks
    return (source[:, None] * size + source).ravel(), np.outer(sign, sign).ravel()


_WORLD = {3 * blocks: _entries(blocks) for blocks in (1, 2)}


def covariance_turned_world(covariance: Array, size: int) -> Array:
    """Convert a covariance of NED vectors, of size 3 or 6, to ENU, or the reverse; return flat."""
    source, sign = _WORLD[size]
    converted: Array = np.asarray(covariance).take(source)
    converted *= sign
    return converted


class MessageParts:
    """Build parts of messages; ``frames`` are their frame ids, None: the default ids."""

    def __init__(self, frames: FrameIds | None = None) -> None:
        self.frames = frames or FramesConfig().frame_ids

    def stamped(self, typename: str, stamp_ns: int, frame_id: str, **fields: Any) -> Any:
        """Return a message of a type with a header and these fields."""
        header = Cdr.types("std_msgs/msg/Header")(stamp=self._time(stamp_ns), frame_id=frame_id)
        return Cdr.types(typename)(header=header, **fields)

    def text(self, text: str) -> Any:
        """Return ``std_msgs/String``."""
        return Cdr.types("std_msgs/msg/String")(data=text)

    def _time(self, stamp_ns: int) -> Any:
        seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
        return Cdr.types("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)

    def _quaternion(self, q: Quaternion) -> Any:
        w, x, y, z = q
        return Cdr.types("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)

    def _vector(self, xyz: Sequence[float]) -> Any:
        x, y, z = xyz
        return Cdr.types("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)

    def _fix(
        self,
        stamp_ns: int,
        frame_id: str,
        place: PositionSample | NavSolution | TangentPlane | Located,
        covariance_n: Array,
        status: FixStatus = FixStatus.SINGLE,
    ) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of a place; a covariance (3, 3) of zeros is unknown."""
        covariance = covariance_turned_world(covariance_n, 3)
        has_covariance = bool(covariance.any())
        status_type = "sensor_msgs/msg/NavSatStatus"
        return self.stamped(
            "sensor_msgs/msg/NavSatFix",
            stamp_ns,
            frame_id,
            status=Cdr.types(status_type)(status=int(status), service=_SERVICE_GPS),
            latitude=math.degrees(place.latitude_rad),
            longitude=math.degrees(place.longitude_rad),
            altitude=float(place.height_m),
            position_covariance=covariance,
            position_covariance_type=COVARIANCE_KNOWN if has_covariance else COVARIANCE_UNKNOWN,
        )

    def _map_pose(
        self, stamp_ns: int, position_n: Array, q_enu: Quaternion, covariance: Array
    ) -> Any:
        typename = "geometry_msgs/msg/PoseWithCovarianceStamped"
        pose = self._pose(position_n, q_enu, covariance)
        return self.stamped(typename, stamp_ns, self.frames.map, pose=pose)

    def _pose(self, position_n: Array, q_enu: Quaternion, covariance: Array) -> Any:
        """Return ``geometry_msgs/PoseWithCovariance`` of (3,) and (6, 6) NED; attitude in ENU."""
        pose, flat = self._bare_pose(position_n, q_enu), covariance_turned_world(covariance, 6)
        return Cdr.types("geometry_msgs/msg/PoseWithCovariance")(pose=pose, covariance=flat)

    def _bare_pose(self, position_n: Array, q_enu: Quaternion) -> Any:
        """Return ``geometry_msgs/Pose`` of (3,) in NED and an attitude in ENU."""
        north, east, down = position_n.tolist()
        return Cdr.types("geometry_msgs/msg/Pose")(
            position=Cdr.types("geometry_msgs/msg/Point")(x=east, y=north, z=-down),
            orientation=self._quaternion(q_enu),
        )

    def _twist(self, linear: Sequence[float], angular: Sequence[float], covariance: Array) -> Any:
        """Return ``geometry_msgs/TwistWithCovariance``; (36,) covariance."""
        twist = Cdr.types("geometry_msgs/msg/Twist")(
            linear=self._vector(linear), angular=self._vector(angular)
        )
        typename = "geometry_msgs/msg/TwistWithCovariance"
        return Cdr.types(typename)(twist=twist, covariance=covariance)
