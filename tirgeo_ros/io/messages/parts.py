"""Build the parts of messages, for either kind of message class."""

from __future__ import annotations

import array
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.io.messages.message_axes import covariance_turned_world, positive

_SERVICE_GPS = 1  # the satellite systems in use are unknown here; GPS always takes part
COVARIANCE_UNKNOWN, COVARIANCE_KNOWN = 0, 3


class Parts:
    """Build the parts of messages of the classes that ``types`` gives.

    ``takes_ndarray`` tells which of the two kinds they are.
    """

    def __init__(self, types: Callable[[str], type]) -> None:
        self.types = types
        self._known: dict[str, Callable[..., Any]] = {}
        # Parts of every message: bound once, as a look-up takes as long as making one.
        self._time = types("builtin_interfaces/msg/Time")
        self._header = types("std_msgs/msg/Header")
        self._quaternion = types("geometry_msgs/msg/Quaternion")
        self._vector = types("geometry_msgs/msg/Vector3")
        self._point = types("geometry_msgs/msg/Point")
        self._pose = types("geometry_msgs/msg/Pose")
        self._pose_covariance = types("geometry_msgs/msg/PoseWithCovariance")
        self._twist = types("geometry_msgs/msg/Twist")
        self._twist_covariance = types("geometry_msgs/msg/TwistWithCovariance")
        # rclpy takes array.array at no cost and an ndarray byte by byte; rosbags only ndarray.
        self.takes_ndarray = hasattr(self._header, "__msgtype__")

    def new(self, typename: str, **fields: Any) -> Any:
        """Return a message of a type, with these fields."""
        kind = self._known.get(typename)
        if kind is None:
            kind = self._known[typename] = self.types(typename)
        return kind(**fields)

    def time(self, stamp_ns: int) -> Any:
        """Return ``builtin_interfaces/Time``."""
        seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
        return self._time(sec=seconds, nanosec=nanoseconds)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Return ``std_msgs/Header``."""
        return self._header(stamp=self.time(stamp_ns), frame_id=frame_id)

    def quaternion(self, q: Quaternion) -> Any:
        """Return ``geometry_msgs/Quaternion`` of (w, x, y, z)."""
        w, x, y, z = q
        return self._quaternion(x=x, y=y, z=z, w=w)

    def vector(self, xyz: tuple[float, float, float]) -> Any:
        """Return ``geometry_msgs/Vector3`` of (x, y, z)."""
        x, y, z = xyz
        return self._vector(x=x, y=y, z=z)

    def frd(self, v: Array) -> Any:
        """Return ``geometry_msgs/Vector3`` in FLU of a (3,) vector in FRD."""
        x, y, z = v.tolist()
        return self.vector((x, -y, -z))

    def imu(
        self,
        stamp_ns: int,
        frame_id: str,
        attitude: tuple[Quaternion, Array],
        rate: tuple[Array, Array],
        force: tuple[Array, Array],
    ) -> Any:
        """Return ``sensor_msgs/Imu`` of pairs of a value and its (9,) covariance.

        The attitude is wxyz of FLU to ENU, rate (rad/s) and force (m/s2) are (3,) FRD.
        """
        return self.new(
            "sensor_msgs/msg/Imu",
            header=self.header(stamp_ns, frame_id),
            orientation=self.quaternion(positive(attitude[0])),
            orientation_covariance=attitude[1],
            angular_velocity=self.frd(rate[0]),
            angular_velocity_covariance=rate[1],
            linear_acceleration=self.frd(force[0]),
            linear_acceleration_covariance=force[1],
        )

    def fix(
        self,
        stamp_ns: int,
        frame_id: str,
        status: FixStatus,
        place: tuple[float, float, float],
        covariance: Array,
    ) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of a place with its (9,) ENU covariance.

        ``place``: latitude, longitude (rad), height (m). A covariance of zeros is marked as
        unknown.
        """
        known = bool(covariance.any())
        latitude_rad, longitude_rad, height_m = place
        return self.new(
            "sensor_msgs/msg/NavSatFix",
            header=self.header(stamp_ns, frame_id),
            status=self.new(
                "sensor_msgs/msg/NavSatStatus", status=int(status), service=_SERVICE_GPS
            ),
            latitude=math.degrees(latitude_rad),
            longitude=math.degrees(longitude_rad),
            altitude=float(height_m),
            position_covariance=covariance,
            position_covariance_type=COVARIANCE_KNOWN if known else COVARIANCE_UNKNOWN,
        )

    def pose(self, position_n: Array, turned: Quaternion, covariance: Array) -> Any:
        """Return ``geometry_msgs/PoseWithCovariance`` of (3,) and (6, 6) in NED.

        ``turned`` is the attitude in ENU.
        """
        north, east, down = position_n.tolist()
        pose = self._pose(
            position=self._point(x=east, y=north, z=-down), orientation=self.quaternion(turned)
        )
        return self._pose_covariance(pose=pose, covariance=covariance_turned_world(covariance, 6))

    def twist(
        self,
        linear: tuple[float, float, float],
        angular: tuple[float, float, float],
        covariance: Array,
    ) -> Any:
        """Return ``geometry_msgs/TwistWithCovariance``; (36,) covariance."""
        twist = self._twist(linear=self.vector(linear), angular=self.vector(angular))
        return self._twist_covariance(twist=twist, covariance=covariance)

    def octets(self, data: npt.NDArray[Any]) -> Any:
        """Return a contiguous array's bytes in the type that a field ``uint8[]`` takes fastest."""
        flat = data.reshape(-1).view(np.uint8)
        if self.takes_ndarray:
            return flat
        out = array.array("B")
        out.frombytes(flat.data)
        return out

    def doubles(self, values: Sequence[float]) -> Any:
        """Return the values in the type of a field ``float64[]``."""
        return np.array(values, float) if self.takes_ndarray else array.array("d", values)
