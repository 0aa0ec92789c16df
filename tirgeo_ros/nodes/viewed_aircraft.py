"""Say one aircraft's state to the operator's page, pass on clicks, find places in its video."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import numpy as np
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.ground_point import MarkedPlace
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.messages import TOPIC_TYPES, ClickAnswer, Messages, click_answer, finding_row
from tirgeo_ros.nodes import aircraft_state
from tirgeo_ros.nodes.aircraft_state import TrackNews
from tirgeo_ros.nodes.aircraft_verdict import Judge
from tirgeo_ros.nodes.graph_node import GraphNode, message_class
from tirgeo_ros.nodes.picture_sight import on_ground, pixel_of
from tirgeo_ros.nodes.qos import latched, output
from tirgeo_ros.nodes.seen_aircraft import ODOMETRY, POSE, VIDEO, SeenAircraft

_PATH = "tirgeo/path"
_RATE_S = 2.0  # over which the video's rate is taken
_PICTURES = 200
#: A picture that was drawn with a predicted pose has none on its other side.
_LAST_POSE_S = 0.2


class ViewedAircraft(SeenAircraft):
    """Be one aircraft of the page. ``answered`` takes the answers to clicks."""

    def __init__(
        self,
        node: GraphNode,
        aircraft: str,
        terrain: Terrain | None,
        show: Callable[[int, bytes], None],
        answered: Callable[[ClickAnswer], None],
    ) -> None:
        self._pictures: deque[tuple[float, float]] = deque(maxlen=_PICTURES)  # time, latency; s
        self._pass_on = show
        super().__init__(node, aircraft, terrain, self._count)
        self._track, self._places = TrackNews(), list[aircraft_state.Place]()
        self.listen(_PATH, self._take_path, 1)
        self.listen("tirgeo/findings", self._take_findings, 10)
        self.listen("tirgeo/locate/answer", lambda m: answered(click_answer(m)), 20)
        self._pixel = self._advertise("tirgeo/locate/pixel", output())
        self._targets = self._advertise("tirgeo/targets", latched())
        self._judge = Judge(self.heard)
        self._drawn: tuple[object, ...] = ()  # revision of the targets, plane and frame

    def _advertise(self, topic: str, qos: QoSProfile) -> Publisher:
        return self._node.advertise(f"{self._prefix}{topic}", qos, TOPIC_TYPES[topic])

    def draw(self, targets: Sequence[MarkedPlace], revision: int) -> None:
        """Have these targets drawn in the video, unless they are already, in the same plane."""
        drawn = revision, self.plane, self.map_frame
        if self.plane is None or drawn == self._drawn:
            return
        frames = self._node.messages.frames._replace(map=self.map_frame)
        self._targets.publish(Messages(message_class, frames).targets(self.plane, targets))
        self._drawn = drawn

    def _count(self, stamp: int, jpeg: bytes) -> None:
        self._pictures.append((time.monotonic(), 1e-9 * (self._node.now_ns - stamp)))
        self._pass_on(stamp, jpeg)

    def click(self, stamp: int, u: float, v: float) -> bool:
        """Pass a click on; return whether anybody listens to clicks."""
        self._pixel.publish(self._node.messages.pixel(stamp, u, v))
        return bool(self._pixel.get_subscription_count())

    def state(self, more_findings: Sequence[Finding]) -> dict[str, Any]:
        """Return the page's state of this aircraft, but for ``recording`` and ``sharing``."""
        now_s, plane = time.monotonic(), self.plane
        footprint_n, odometry = self.footprint_n(), self.newest(ODOMETRY)
        found: dict[str, Any] = dict(aircraft_state.UNKNOWN_POSITION)
        if plane and odometry is not None:
            found |= aircraft_state.position_fields(odometry, plane, footprint_n)
        found |= aircraft_state.navigation_fields(self.heard, now_s)
        found |= self._track.fresh(self._places)
        found["footprint"] = aircraft_state.places(footprint_n, plane) if plane else []
        found |= self._judged(now_s, more_findings)
        then_s, topics = self.heard.newest("ekf_node: topics")
        rtk_s = aircraft_state.number(topics.get("rtk/fix age [s]", ""))
        streams = {"video": VIDEO, "pose": ODOMETRY, "camera": POSE}
        ages = {name: self.age_s(topic) for name, topic in streams.items()}
        found["ages_s"] = ages | {"rtk": None if rtk_s is None else rtk_s + now_s - then_s}
        found["video_hz"], found["latency_ms"] = self._video(now_s)
        return found

    def _judged(self, now_s: float, more: Sequence[Finding]) -> dict[str, Any]:
        heard, no_map = self.heard.findings(now_s), self._no_map(now_s)
        findings = sorted([*(heard or ()), *more], key=lambda one: -one.severity)
        worst = max((one.severity for one in findings), default=Severity.NOTE)
        reported = None if heard is None else worst
        verdict = self._judge.look(now_s, self.came_s, reported, no_map or "")
        rows = [finding_row(one) for one in findings]
        judged = {"verdict": verdict._asdict(), "no_map": no_map, "findings": rows}
        if verdict.kind == "position" and verdict.word == "NO DATA":
            judged |= dict.fromkeys(("rtk", "heading_sigma_deg"))  # the filter's clock stands
        return judged

    def _no_map(self, now_s: float) -> str | None:
        """Return the picture's notice; None while nothing is heard of overlay_node."""
        items = self.heard.of(now_s, "overlay")
        return items[0].get("notice", "") if items else None

    def _take_findings(self, message: Any) -> None:
        self.heard.take_findings(time.monotonic(), message)

    def _video(self, now_s: float) -> tuple[float, float | None]:
        """Return the rate (Hz) of the last seconds, and the median of the latency (ms)."""
        recent = [latency for then_s, latency in [*self._pictures] if now_s - then_s < _RATE_S]
        return len(recent) / _RATE_S, round(1e3 * median(recent), 1) if recent else None

    def _take_path(self, message: Any) -> None:
        plane, points = self.plane, [one.pose.position for one in message.poses]
        if plane is not None:
            points_n = np.array([(p.y, p.x, -p.z) for p in points], float).reshape(-1, 3)
            self._places = aircraft_state.places(points_n, plane)

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
