"""Make one aircraft's state for the operator's page, of its messages; what is unknown is None."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import ellipse_95
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.verdicts import NavigationStatus
from tirgeo_ros.io.messages import body_pose, findings_of, navigation_status
from tirgeo_ros.nodes.graph_watch import Restarts

#: Diagnostics that are older count as silence: each node reports once a second.
SILENT_S = 3.5
_SIGMA_OF_ELLIPSE = math.sqrt(-2 * math.log(0.05))
_DIGITS = 8  # of degrees: a millimetre

Place = list[float]  # latitude, longitude (deg)


class Heard:
    """Hold the newest diagnostics and findings of one aircraft's nodes."""

    def __init__(self) -> None:
        self._items: dict[str, tuple[float, dict[str, str]]] = {}
        self._navigation: tuple[float, NavigationStatus] | None = None
        self.restarts = Restarts()  # of overlay_node, which counts those of the others
        self._findings: dict[str, tuple[float, list[Finding]]] = {}  # by node

    def take(self, now_s: float, name: str, status: Any) -> None:
        """Take a ``DiagnosticStatus``, named ``NODE: SUBJECT`` without the namespace.

        Raises MessageError for a status of the estimator that is none.
        """
        self._items[name] = now_s, {item.key: cut(item.value) for item in status.values}
        if name.endswith(": navigation"):
            self._navigation = now_s, navigation_status(status)
        elif name == "overlay_node: topics":
            self.restarts.take(status)

    def take_findings(self, now_s: float, message: Any) -> None:
        """Take ``tirgeo/findings`` of a node. Raises MessageError for another text."""
        node, _, findings = findings_of(message)
        self._findings[node] = now_s, findings

    def findings(self, now_s: float) -> list[Finding] | None:
        """Return what the nodes' checks have found; None while all are silent."""
        newest = [*self._findings.values()]
        heard = [findings for then_s, findings in newest if now_s - then_s <= SILENT_S]
        return [one for findings in heard for one in findings] if heard else None

    def newest(self, name: str) -> tuple[float, dict[str, str]]:
        """Return when an item came, and its values; never, and none, if it did not."""
        return self._items.get(name, (-math.inf, {}))

    def navigation(self, now_s: float) -> tuple[NavigationStatus | None, bool]:
        """Return the estimator's status, None if it is silent, and whether it ever spoke."""
        if self._navigation is None:
            return None, False
        then_s, status = self._navigation
        return status if now_s - then_s <= SILENT_S else None, True

    def of(self, now_s: float, subject: str) -> list[dict[str, str]]:
        """Return the values of each node's newest item of a subject; silent nodes are left out."""
        items = [*self._items.items()]
        return [
            values
            for name, (then_s, values) in sorted(items)
            if name.endswith(f": {subject}") and now_s - then_s <= SILENT_S
        ]

    def number(self, now_s: float, subject: str, key: str) -> float | None:
        """Return a finite number among the values of a subject; None without one."""
        texts = [values[key] for values in self.of(now_s, subject) if key in values]
        return number(texts[0]) if texts else None


def navigation_fields(heard: Heard, now_s: float) -> dict[str, Any]:
    """Return state, reason, RTK and the heading's sigma; a silent estimator counts as lost."""
    status, spoke = heard.navigation(now_s)
    if status is None:
        words = "lost" if spoke else "waiting", "nothing is heard of ekf_node"
        return {
            "navigation": dict(zip(("state", "reason"), words, strict=True)),
            "rtk": None,
            "heading_sigma_deg": None,
        }
    return {
        "navigation": {"state": status.state.value, "reason": status.reason},
        "rtk": status.rtk_status.name.lower(),
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
    }


def position_fields(odometry: Any, plane: TangentPlane, footprint_n: Array) -> dict[str, Any]:
    """Return where the aircraft is and how it moves, of ``nav_msgs/Odometry``.

    The height above ground is that above the middle of the footprint (N, 3), NED in the plane.
    """
    pose = body_pose(odometry)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    rotation, moving_n = matrix_from_quat(pose.q_nb), velocity_n(odometry)
    down_m = float(np.median(footprint_n[:, 2])) if len(footprint_n) else math.nan
    semi_axes, _ = ellipse_95(pose.covariance[:2, :2])
    return {
        "stamp_ns": str(pose.stamp_ns),
        "position": [*_degrees(latitude, longitude), round(height_m, 3)],
        "heading_deg": math.degrees(math.atan2(rotation[1, 0], rotation[0, 0])) % 360,
        "position_sigma_m": float(semi_axes[0, 0]) / _SIGMA_OF_ELLIPSE,
        "speed_m_s": float(np.hypot(moving_n[0], moving_n[1])),
        "above_ground_m": down_m - float(pose.position_n[2]),
    }


def velocity_n(odometry: Any) -> Array:
    """Return the velocity (3,), NED in the plane, m/s, of ``nav_msgs/Odometry``."""
    linear = odometry.twist.twist.linear
    body = np.array([linear.x, -linear.y, -linear.z])
    return np.asarray(matrix_from_quat(body_pose(odometry).q_nb) @ body)


UNKNOWN_POSITION: Mapping[str, Any] = dict.fromkeys(
    ("stamp_ns", "position", "heading_deg", "position_sigma_m", "speed_m_s", "above_ground_m")
)


def places(points_n: Array, plane: TangentPlane) -> list[Place]:
    """Return latitude and longitude (deg) of points (N, 3), NED in the plane."""
    if not len(points_n):
        return []
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    return [_degrees(*one) for one in zip(latitude.tolist(), longitude.tolist(), strict=True)]


class TrackNews:
    """Know which points of a track the page does not have yet."""

    def __init__(self) -> None:
        self._sent: list[Place] = []

    def fresh(self, track: list[Place]) -> dict[str, Any]:
        """Return the points from the first one that differs, and its index."""
        same = len(self._sent)
        while same and self._sent[same - 1 : same] != track[same - 1 : same]:
            same -= 1
        self._sent = track
        return {"track": track[same:], "track_from": same}


def number(text: str) -> float | None:
    """Return a finite number of a text; None for any other."""
    try:
        found = float(text)
    except ValueError:
        return None
    return found if math.isfinite(found) else None


def _degrees(latitude_rad: float, longitude_rad: float) -> Place:
    return [round(math.degrees(angle), _DIGITS) for angle in (latitude_rad, longitude_rad)]
