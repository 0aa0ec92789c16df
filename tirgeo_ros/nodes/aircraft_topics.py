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
"""Subscribe to one aircraft: its video, poses and place, and the reports of its nodes."""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Generic

import numpy as np
from rclpy.qos import QoSProfile

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.config.viewer_parameters import GroundConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, P, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.overlay.overlay import RATES_S, rates_up_to
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.verdicts import NavigationStatus
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.messages import (
    STATE_TOPIC,
    TOPIC_TYPES,
    NodeState,
    PictureState,
    body_pose,
    camera_pose,
    findings_of,
    node_state,
    stamp_ns,
    tangent_plane,
)
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.pictures import camera
from tirgeo_ros.io.messages.topics import IMAGE_DEPTH, STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, latched, output

PAINTED, INFO = "tirgeo/overlay/image/compressed", "tirgeo/overlay/camera_info"
ODOMETRY, POSE, FOOTPRINT = "tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/footprint"
#: A node whose report is older (s) is silent: each node reports once a second.
SILENT_S = 3.5
_MOST_NODES = 20  # of one aircraft
#: Nodes whose checks a flight needs.
_CHECKED = ("ekf_node", "gimbal_node", "overlay_node")
_BACK_NS = 1_000_000_000  # stamps that go back by more belong to a new flight
_POSES = 400  # kept: one second of the fastest stream
#: If the heights of a footprint differ by more, the ground is not level. The Earth's curvature
#: makes 8 cm in a kilometre.
_LEVEL_M = 1.0


class Reports:
    """Hold what the nodes of one aircraft report; ``own`` is the node that listens."""

    def __init__(self, own: str = "") -> None:
        self._own = own
        self._states: dict[str, tuple[float, NodeState]] = {}  # by name
        self._findings: dict[str, tuple[float, list[Finding]]] = {}  # by node

    def take_state(self, now_s: float, message: Any) -> None:
        """Take ``tirgeo/state`` of a node. Raises MessageError if it cannot be read."""
        state = node_state(message)
        if state.name in self._states or len(self._states) < _MOST_NODES:
            self._states[state.name] = now_s, state

    def take_findings(self, now_s: float, message: Any) -> None:
        """Take ``tirgeo/findings`` of another node. Raises MessageError if it cannot be read."""
        node, _, findings = findings_of(message)
        if node != self._own and (node in self._findings or len(self._findings) < _MOST_NODES):
            self._findings[node] = now_s, findings

    def findings(self, now_s: float) -> list[Finding] | None:
        """Return the findings of all nodes; None while the nodes of _CHECKED are silent."""
        recent = {
            n: findings for n, (s, findings) in self._findings.items() if now_s - s <= SILENT_S
        }
        if not any(node.endswith(_CHECKED) for node in recent):
            return None
        return [finding for findings in recent.values() for finding in findings]

    def state(self, node: str) -> tuple[float, NodeState | None]:
        """Return when a node's newest state came (s), and the state: -inf, None without one."""
        return self._states.get(node, (-math.inf, None))

    def input_age_s(self, node: str, topic: str, now_s: float) -> float | None:
        """Return the time since a node got a message of an input; None if it has got none."""
        then_s, state = self.state(node)
        age_s = state.topics[topic].age_s if state and topic in state.topics else None
        return None if age_s is None else age_s + now_s - then_s

    def navigation(self, now_s: float) -> tuple[NavigationStatus | None, bool]:
        """Return the estimator's status, None if it is silent, and whether it ever reported."""
        then_s, state = self.state("ekf_node")
        if state is None or now_s - then_s > SILENT_S:
            return None, state is not None
        return state.navigation, True

    def picture(self, now_s: float = -math.inf) -> PictureState | None:
        """Return overlay_node's report on its pictures; None if it is silent at ``now_s``."""
        then_s, state = self.state("overlay_node")
        return state.picture if state and now_s - then_s <= SILENT_S else None


class PoseTape(Generic[P]):
    """Keep the pose messages of the last second as bytes; decode those that are asked for.

    ``decode`` returns the pose in a message. Any thread may call it.
    """

    def __init__(self, decode: Callable[[bytes], P]) -> None:
        self._decode = decode
        self._lock = threading.Lock()
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=_POSES)

    def add(self, data: bytes) -> None:
        """Add a message; if its stamp goes back, drop all before. Raises MessageError."""
        stamp_ns = header_stamp_ns(data)
        with self._lock:
            if self._kept and stamp_ns < self._kept[-1][0]:
                self._kept.clear()
            self._kept.append((stamp_ns, data))

    def around(self, stamp_ns: int, before_s: float = 0.0) -> PoseBuffer[P]:
        """Return the poses on both sides of an instant, and those of ``before_s`` before it."""
        with self._lock:
            kept = list(self._kept)
        stamps = [stamp for stamp, _ in kept]
        first = max(bisect_left(stamps, stamp_ns - round(before_s * 1e9)) - 1, 0)
        poses: PoseBuffer[P] = PoseBuffer()
        for _, data in kept[first : bisect_left(stamps, stamp_ns) + 1]:
            poses.add(self._decode(data))
        return poses


class AircraftTopics:
    """Hold the newest messages of one aircraft as bytes, and decode them when they are asked for.

    ``aircraft`` is its namespace, "" for that of the node. ``show`` takes the stamp (ns) and the
    JPEG of each picture of the topic ``video``; ``terrain`` is the ground's elevation model, if
    there is one. Any thread may call it; only the node's thread brings messages.
    """

    def __init__(
        self,
        node: GraphNode,
        aircraft: str,
        terrain: Terrain | None,
        show: Callable[[int, bytes], None],
        video: str = PAINTED,
    ) -> None:
        self.terrain, self.video = terrain, video
        self.plane: TangentPlane | None = None
        self.map_frame = node.messages.frames.map
        self.namespace = f"/{aircraft}" if aircraft else node.get_namespace().rstrip("/")
        self.reports = Reports(node.get_fully_qualified_name())
        self.newest_ns = 0  # stamp of the newest picture
        self._node, self._prefix, self._show = node, f"/{aircraft}/" if aircraft else "", show
        self._newest: dict[str, tuple[float, bytes]] = {}  # topic -> steady time, message
        decoded = node.decoded
        self._camera_poses = PoseTape(lambda data: camera_pose(decoded(data, POSE)))
        self._body_poses = PoseTape(lambda data: body_pose(decoded(data, ODOMETRY)))
        for topic, tape in ((POSE, self._camera_poses), (ODOMETRY, self._body_poses)):
            keep = partial(self._keep, topic, tape=tape)
            self.listen(topic, keep, output(STREAM_DEPTH), decoded=False)
        for topic in (INFO, FOOTPRINT):
            self.listen(topic, partial(self._keep, topic), output(1), decoded=False)
        self.listen(video, self._take_picture, output(IMAGE_DEPTH))
        self.listen("tirgeo/origin", self._take_origin, latched())
        now_s, take = time.monotonic, self.reports.take_state
        self.listen(STATE_TOPIC, lambda message: take(now_s(), message), latched(_MOST_NODES))

    def listen(
        self, topic: str, take: Callable[[Any], None], qos: QoSProfile, *, decoded: bool = True
    ) -> None:
        """Call ``take`` with each message of a contract topic."""
        name, typename = f"{self._prefix}{topic}", TOPIC_TYPES[topic]
        self._node.listen(name, take, qos, typename, decoded=decoded)

    def newest(self, topic: str) -> Any:
        """Return the newest message of a kept topic, or None."""
        newest = self._newest.get(topic)
        return self._node.decoded(newest[1], topic) if newest else None

    def came_s(self, topic: str) -> float | None:
        """Return when the newest message of a topic came, steady clock; None without one."""
        newest = self._newest.get(topic)
        return newest[0] if newest else None

    def age_s(self, topic: str) -> float | None:
        """Return the time since the newest message of a topic; None without one."""
        came_s = self.came_s(topic)
        return None if came_s is None else round(time.monotonic() - came_s, 2)

    def _keep(self, topic: str, data: bytes, tape: PoseTape[Any] | None = None) -> None:
        self._newest[topic] = time.monotonic(), data
        if tape is not None:
            tape.add(data)

    def _take_picture(self, message: Any) -> None:
        stamp = stamp_ns(message)
        if stamp < self.newest_ns - _BACK_NS:
            self._newest.clear()  # of an earlier flight: the clock was set back
        self.newest_ns = stamp
        self._keep(self.video, b"")
        self._show(stamp, bytes(message.data))

    def _take_origin(self, message: Any) -> None:
        self.plane, self.map_frame = tangent_plane(message), message.header.frame_id

    def footprint_n(self) -> Array:
        """Return the newest footprint (N, 3), NED in the plane; empty without one."""
        message = self.newest(FOOTPRINT)
        points = places_n(message.polygon.points if message is not None else ())
        return points if np.isfinite(points).all() else points[:0]

    def exposure_ns(self, stamp: int) -> int | None:
        """Return when a picture was exposed; None until overlay_node reports the latency."""
        picture = self.reports.picture()
        return None if picture is None else exposure_ns(stamp, picture.video_latency_s)

    @property
    def confidence(self) -> ConfidenceConfig:
        """Return the sigmas of located points that overlay_node reports; before, the defaults."""
        picture = self.reports.picture()
        return ConfidenceConfig() if picture is None else picture.confidence

    def sight(self, stamp: int, *, last_pose_s: float = 0.0) -> Sight | None:
        """Return camera and pose of a picture; None without a pose at its exposure.

        A last pose that is younger than ``last_pose_s`` will do. Without an elevation model the
        newest footprint gives the height of the ground, if it is level.
        """
        plane, info, exposed_ns = self.plane, self.newest(INFO), self.exposure_ns(stamp)
        if plane is None or info is None or exposed_ns is None:
            return None
        cameras = self._camera_poses.around(exposed_ns, RATES_S)
        pose, body = cameras.at(exposed_ns), self._body_poses.around(exposed_ns).at(exposed_ns)
        if pose is Miss.TOO_NEW:
            latest = cameras.latest(0.0)[0]
            pose = latest if exposed_ns - latest.stamp_ns < last_pose_s * 1e9 else pose
        if isinstance(pose, Miss):
            return None
        ground = level_of(self.footprint_n(), plane) if self.terrain is None else self.terrain
        carrier = None if isinstance(body, Miss) else body
        return Sight(camera(info, INFO), pose, plane, ground, carrier, rates_up_to(pose, cameras))


def terrain_of(config: GroundConfig) -> Terrain | None:
    """Return the elevation model of the parameters, if they name one. Raises ElevationError."""
    return load_terrain(config.dem, config.dem_undulation_m) if config.dem else None


def level_of(footprint_n: Array, plane: TangentPlane) -> float:
    """Return the ellipsoidal height (m) of a footprint (N, 3), NED; nan if it is not level."""
    if len(footprint_n) < 3:
        return math.nan
    _, _, heights_m = plane.geodetic_from_ned(footprint_n)
    return float(np.median(heights_m)) if np.ptp(heights_m) < _LEVEL_M else math.nan


def places_n(points: Iterable[Any]) -> Array:
    """Return points of a message in ``map`` as (N, 3), NED."""
    return np.array([(p.y, p.x, -p.z) for p in points], float).reshape(-1, 3)
