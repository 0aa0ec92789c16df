"""Convert clicks and located ground points to messages, and back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.io.messages.decode import stamp_ns
from tirgeo_ros.io.messages.encode import UNKNOWN_VARIANCE
from tirgeo_ros.io.messages.message_axes import covariance_turned_world
from tirgeo_ros.io.messages.parts import Parts
from tirgeo_ros.io.messages.topics import MAP_FRAME, OPTICAL_FRAME

_NO_TURN = (1.0, 0.0, 0.0, 0.0)


class LocatedMessages:
    """Build the messages of ``tirgeo/locate/pixel``, ``tirgeo/locate/fix`` and ``.../point``.

    ``types`` gives the classes, as for ``Messages``. The stamp of all is the picture's.
    """

    def __init__(self, types: Callable[[str], type]) -> None:
        self._parts = Parts(types)

    def pixel(self, stamp_ns: int, u: float, v: float) -> Any:
        """Return ``geometry_msgs/PointStamped`` of a click at a column and row of a picture."""
        return self._parts.new(
            "geometry_msgs/msg/PointStamped",
            header=self._parts.header(stamp_ns, OPTICAL_FRAME),
            point=self._parts.new("geometry_msgs/msg/Point", x=u, y=v, z=0.0),
        )

    def fix(self, located: Located) -> Any:
        """Return ``sensor_msgs/NavSatFix`` of the ground point, covariance in ENU."""
        where = (located.latitude_rad, located.longitude_rad, located.height_m)
        covariance = covariance_turned_world(located.covariance_n, 3)
        return self._parts.fix(located.stamp_ns, MAP_FRAME, FixStatus.SINGLE, where, covariance)

    def point(self, located: Located) -> Any:
        """Return ``geometry_msgs/PoseWithCovarianceStamped`` in ``map``.

        A point has no attitude: the rotation is the identity, with a variance that marks it as
        unknown.
        """
        covariance = np.diag([0.0] * 3 + [UNKNOWN_VARIANCE] * 3)
        covariance[:3, :3] = located.covariance_n
        return self._parts.new(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self._parts.header(located.stamp_ns, MAP_FRAME),
            pose=self._parts.pose(located.point_n, _NO_TURN, covariance),
        )


def ground_point(msg: Any) -> tuple[int, Array, Array]:
    """Decode ``tirgeo/locate/point``: stamp (ns), point (3,) and covariance (3, 3), local NED."""
    position = msg.pose.pose.position
    covariance = covariance_turned_world(msg.pose.covariance, 6).reshape(6, 6)[:3, :3]
    return stamp_ns(msg), np.array([position.y, position.x, -position.z]), covariance
