"""Say one aircraft's state to the operator's page, pass on clicks, find places in its video."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tirgeo_ros.core.camera.projection_covariance import ellipse_95
from tirgeo_ros.core.checks.navigation_checks import nearest_causes
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.ground.ground_point import Answer
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.messages import (
    TOPIC_TYPES,
    answer_of,
    body_pose,
    finding_row,
)
from tirgeo_ros.nodes.aircraft_topics import (
    ODOMETRY,
    POSE,
    VIDEO,
    AircraftTopics,
    Reports,
    number,
    places_n,
)
from tirgeo_ros.nodes.aircraft_verdict import Judge
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.qos import latched, output
from tirgeo_ros.nodes.target_markers import target_markers

Place = list[float]  # latitude, longitude (deg)

_RATE_S = 2.0  # over which the video's rate is taken
_PICTURES = 200
#: A picture that was drawn with a predicted pose has none on its other side.
_LAST_POSE_S = 0.2
_SIGMA_OF_ELLIPSE = math.sqrt(-2 * math.log(0.05))
#: Markers of 2000 targets take 0.4 s of a processor.
_MARKERS_S = 2.0
_DIGITS = 8  # of degrees: a millimetre
_NO_POSITION: Mapping[str, None] = dict.fromkeys(
    ("stamp_ns", "position", "heading_deg", "position_sigma_m", "speed_m_s", "above_ground_m")
)


class AircraftView(AircraftTopics):
    """Be one aircraft of the page. ``answered`` takes the answers to clicks."""

    def __init__(
        self,
        node: GraphNode,
        aircraft: str,
        terrain: Terrain | None,
        show: Callable[[int, bytes], None],
        answered: Callable[[Answer], None],
    ) -> None:
        self._pictures: deque[tuple[float, float]] = deque(maxlen=_PICTURES)  # time, latency; s
        self._pass_on = show
        super().__init__(node, aircraft, terrain, self._count)
        self._track, self._sent = list[Place](), list[Place]()
        self.listen("tirgeo/path", self._take_path, 1)
        self.listen("tirgeo/findings", self._take_findings, 10)
        self.listen("tirgeo/locate/answer", lambda m: answered(answer_of(m)), 20)
        self._pixel = self._advertise("tirgeo/locate/pixel", output())
        self.targets = self._advertise("tirgeo/targets", latched())
        self._markers = self._advertise("tirgeo/targets/markers", latched())
        self._judge = Judge(self.reports, self.came_s)
        self._marked: tuple[object, ...] = ()  # revision of the targets, plane and frame
        self._marked_s = -math.inf

    def _advertise(self, topic: str, qos: QoSProfile) -> Publisher:
        return self._node.advertise(f"{self._prefix}{topic}", qos, TOPIC_TYPES[topic])

    def mark(self, targets: Sequence[Target], revision: int) -> None:
        """Show these targets in RViz while it listens, unless it shows them in the same plane."""
        marked, now_s = (revision, self.plane, self.map_frame), time.monotonic()
        soon = now_s - self._marked_s < _MARKERS_S
        if self.plane is None or soon or marked == self._marked:
            return
        if self._markers.get_subscription_count():
            self._markers.publish(target_markers(self.map_frame, self.plane, targets))
            self._marked, self._marked_s = marked, now_s

    def _count(self, stamp: int, jpeg: bytes) -> None:
        self._pictures.append((time.monotonic(), 1e-9 * (self._node.now_ns - stamp)))
        self._pass_on(stamp, jpeg)

    def _take_findings(self, message: Any) -> None:
        self.reports.take_findings(time.monotonic(), message)

    def _take_path(self, message: Any) -> None:
        if self.plane is not None:
            points_n = places_n(one.pose.position for one in message.poses)
            self._track = places(points_n, self.plane)

    def click(self, stamp: int, u: float, v: float) -> bool:
        """Pass a click on; return whether anybody listens to clicks."""
        self._pixel.publish(self._node.messages.pixel(stamp, u, v))
        return bool(self._pixel.get_subscription_count())

    def state(self, more_findings: Sequence[Finding]) -> dict[str, Any]:
        """Return the page's state of this aircraft, but for ``recording`` and ``sharing``."""
        now_s, plane = time.monotonic(), self.plane
        footprint_n, odometry = self.footprint_n(), self.newest(ODOMETRY)
        state: dict[str, Any] = dict(_NO_POSITION)
        if plane and odometry is not None:
            state |= position_fields(odometry, plane, footprint_n)
        state |= navigation_fields(self.reports, now_s)
        sent, self._sent = self._sent, self._track
        state |= track_fields(sent, self._sent)
        state["footprint"] = places(footprint_n, plane) if plane else []
        state |= self._judged(now_s, more_findings)
        then_s, topics = self.reports.newest("ekf_node: topics")
        rtk_s = number(topics.get("rtk/fix age [s]", ""))
        streams = {"video": VIDEO, "pose": ODOMETRY, "camera": POSE}
        ages = {name: self.age_s(topic) for name, topic in streams.items()}
        state["ages_s"] = ages | {"rtk": None if rtk_s is None else rtk_s + now_s - then_s}
        state["video_hz"], state["latency_ms"] = self._video(now_s)
        return state

    def _judged(self, now_s: float, more: Sequence[Finding]) -> dict[str, Any]:
        heard, overlay = self.reports.findings(now_s), self.reports.overlay(now_s)
        no_map = overlay.get("notice", "") if overlay else None  # the picture's notice
        findings = sorted(nearest_causes([*(heard or ()), *more]), key=lambda one: -one.severity)
        worst = max((one.severity for one in findings), default=Severity.NOTE)
        verdict = self._judge.look(now_s, None if heard is None else worst, no_map or "")
        rows = [finding_row(one) for one in findings]
        judged = {"verdict": verdict._asdict(), "no_map": no_map, "findings": rows}
        if verdict.kind == "position" and verdict.word == "NO DATA":
            judged |= dict.fromkeys(("rtk", "heading_sigma_deg"))  # the filter's clock stands
        return judged

    def _video(self, now_s: float) -> tuple[float, float | None]:
        """Return the rate (Hz) of the last seconds, and the median of the latency (ms)."""
        recent = [latency for then_s, latency in [*self._pictures] if now_s - then_s < _RATE_S]
        return len(recent) / _RATE_S, round(1e3 * median(recent), 1) if recent else None

    def where(self, latitude_rad: float, longitude_rad: float) -> tuple[int, float, float] | str:
        """Return stamp, column and row of a place in the newest picture, or why it isn't there.

        The place lies on the elevation model, or on the flat ground that fits the picture's
        footprint best.
        """
        stamp, footprint_n = self.newest_ns, self.footprint_n()
        sight = self.sight(stamp, last_pose_s=_LAST_POSE_S)
        if sight is None or len(footprint_n) < 3:
            return "the newest picture has no trusted pose"
        place, plane = (latitude_rad, longitude_rad), sight.plane
        if self.terrain is None:
            point_n = on_ground(plane, footprint_n, *place)
        else:
            point_n = plane.ned_from_geodetic(*place, self.terrain.height_m(*place))
        uv = pixel_of(sight, point_n)
        return (stamp, *uv) if uv else "it is outside the picture"


def navigation_fields(reports: Reports, now_s: float) -> dict[str, Any]:
    """Return state, reason, RTK and the heading's sigma; a silent estimator counts as lost."""
    status, spoke = reports.navigation(now_s)
    if status is None:
        state = "lost" if spoke else "waiting"
        return {
            "navigation": {"state": state, "reason": "nothing is heard of ekf_node"},
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


def track_fields(sent: list[Place], track: list[Place]) -> dict[str, Any]:
    """Return the points of a track from the first one that was not sent so, and its index."""
    same = len(sent)
    while same and sent[same - 1 : same] != track[same - 1 : same]:
        same -= 1
    return {"track": track[same:], "track_from": same}


def places(points_n: Array, plane: TangentPlane) -> list[Place]:
    """Return latitude and longitude (deg) of points (N, 3), NED in the plane."""
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    return [_degrees(*one) for one in zip(latitude.tolist(), longitude.tolist(), strict=True)]


def _degrees(latitude_rad: float, longitude_rad: float) -> Place:
    return [round(math.degrees(angle), _DIGITS) for angle in (latitude_rad, longitude_rad)]


def on_ground(
    plane: TangentPlane, footprint_n: Array, latitude_rad: float, longitude_rad: float
) -> Array:
    """Return a place (3,), NED, on the flat ground that fits a footprint (3 or more, 3) best."""
    north, east, _ = plane.ned_from_geodetic(latitude_rad, longitude_rad, plane.height_m).tolist()
    level = np.column_stack([footprint_n[:, :2], np.ones(len(footprint_n))])
    slope, *_ = np.linalg.lstsq(level, footprint_n[:, 2], rcond=None)
    return np.array([north, east, float(np.dot(slope, [north, east, 1.0]))])


def pixel_of(sight: Sight, point_n: Array) -> tuple[float, float] | None:
    """Return column and row of a point (3,), NED, in a picture; None outside it."""
    offset_n, camera = point_n - sight.pose.position_n, sight.camera
    uv, seen = camera.project(offset_n[None] @ matrix_from_quat(sight.pose.q_nc))
    u, v = uv[0].tolist()
    inside = seen[0] and -0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5
    return (u, v) if inside else None
