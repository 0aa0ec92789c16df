"""Listen to one aircraft's video, and to what says from where each picture was taken."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.config.overlay import POINT_SIGMAS, ConfidenceConfig
from tirgeo_ros.core.config.viewer import GroundConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.overlay.camera_motion import RATES_S, rates_up_to
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.messages import (
    TOPIC_TYPES,
    body_pose,
    camera,
    camera_pose,
    stamp_ns,
    tangent_plane,
)
from tirgeo_ros.nodes.aircraft_state import Heard
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.picture_sight import level_of
from tirgeo_ros.nodes.pose_tape import PoseTape
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, STREAM_DEPTH, latched, output

VIDEO, INFO = "tirgeo/overlay/image/compressed", "tirgeo/overlay/camera_info"
ODOMETRY, POSE, FOOTPRINT = "tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/footprint"
_BACK_NS = 1_000_000_000  # stamps that go back by more are those of a new flight


class SeenAircraft:
    """Hold what is newest of one aircraft as bytes, and decode it when it is asked for.

    ``aircraft`` is its namespace, "" for that of the node. ``show`` takes the stamp (ns) and the
    JPEG of each picture; ``terrain`` is the ground's elevation model, if there is one. Any thread
    may ask; the node's alone brings messages.
    """

    def __init__(
        self,
        node: GraphNode,
        aircraft: str,
        terrain: Terrain | None,
        show: Callable[[int, bytes], None],
    ) -> None:
        self.terrain = terrain
        self.plane: TangentPlane | None = None
        self.map_frame = node.messages.frames.map
        self.namespace = f"/{aircraft}" if aircraft else node.get_namespace().rstrip("/")
        self.heard = Heard()
        self.newest_ns = 0  # stamp of the newest picture
        self._node, self._prefix, self._show = node, f"/{aircraft}/" if aircraft else "", show
        self._newest: dict[str, tuple[float, bytes]] = {}  # topic -> steady time, message
        decoded = node.decoded
        self._camera_poses = PoseTape(lambda data: camera_pose(decoded(data, POSE)))
        self._body_poses = PoseTape(lambda data: body_pose(decoded(data, ODOMETRY)))
        for topic, tape in ((POSE, self._camera_poses), (ODOMETRY, self._body_poses)):
            self.listen(topic, partial(self._tape, topic, tape), STREAM_DEPTH, decoded=False)
        for topic in (INFO, FOOTPRINT):
            self.keep(topic)
        self.listen(VIDEO, self._take_picture, IMAGE_DEPTH)
        self.listen("tirgeo/origin", self._take_origin)

    def listen(
        self, topic: str, take: Callable[[Any], None], depth: int = 0, *, decoded: bool = True
    ) -> None:
        """Have each message of a topic of the contract taken; of depth 0 also the latched one."""
        name, qos = f"{self._prefix}{topic}", output(depth) if depth else latched()
        self._node.listen(name, take, qos, TOPIC_TYPES[topic], raw=True, decoded=decoded)

    def keep(self, topic: str) -> None:
        """Keep the newest message of a topic."""
        self.listen(topic, partial(self._keep, topic), 1, decoded=False)

    def newest(self, topic: str) -> Any:
        """Return the newest message of a kept topic, or None."""
        found = self._newest.get(topic)
        return self._node.decoded(found[1], topic) if found else None

    def came_s(self, topic: str) -> float | None:
        """Return when the newest message of a topic came, steady clock; None without one."""
        found = self._newest.get(topic)
        return found[0] if found else None

    def age_s(self, topic: str) -> float | None:
        """Return the time since the newest message of a topic; None without one."""
        came_s = self.came_s(topic)
        return None if came_s is None else round(time.monotonic() - came_s, 2)

    def _keep(self, topic: str, data: bytes) -> None:
        self._newest[topic] = time.monotonic(), data

    def _tape(self, topic: str, tape: PoseTape[Any], data: bytes) -> None:
        self._keep(topic, data)
        tape.add(data)

    def _take_picture(self, message: Any) -> None:
        stamp = stamp_ns(message)
        if stamp < self.newest_ns - _BACK_NS:
            self.forget()
        self.newest_ns = stamp
        self._keep(VIDEO, b"")
        self._show(stamp, bytes(message.data))

    def forget(self) -> None:
        """Forget a flight before: the clock was set back."""
        self._newest.clear()

    def _take_origin(self, message: Any) -> None:
        self.plane, self.map_frame = tangent_plane(message), message.header.frame_id

    def footprint_n(self) -> Array:
        """Return the newest footprint (N, 3), NED in the plane; empty without one."""
        message = self.newest(FOOTPRINT)
        points = message.polygon.points if message is not None else []
        found = np.array([(p.y, p.x, -p.z) for p in points], float).reshape(-1, 3)
        return found if np.isfinite(found).all() else found[:0]

    def exposure_ns(self, stamp: int) -> int | None:
        """Return when a picture was exposed; None while overlay_node does not say the delay."""
        latency_s = self.heard.number(time.monotonic(), "overlay", "video_latency_s")
        return None if latency_s is None else stamp - round(latency_s * 1e9)

    @property
    def confidence(self) -> ConfidenceConfig:
        """Return the sigmas of located points, as overlay_node says them; else their defaults."""
        now_s = time.monotonic()
        said = {name: self.heard.number(now_s, "overlay", name) for name in POINT_SIGMAS}
        return ConfidenceConfig(**{name: x for name, x in said.items() if x is not None})

    def sight(self, stamp: int, *, last_pose_s: float = 0.0) -> Sight | None:
        """Return from where a picture was taken; None if that is not known.

        The last pose will do where it is no older than ``last_pose_s``. Without an elevation model
        the ground is known where it is level, by the newest footprint.
        """
        plane, info, exposure_ns = self.plane, self.newest(INFO), self.exposure_ns(stamp)
        if plane is None or info is None or exposure_ns is None:
            return None
        cameras = self._camera_poses.around(exposure_ns, RATES_S)
        pose, body = cameras.at(exposure_ns), self._body_poses.around(exposure_ns).at(exposure_ns)
        if pose is Miss.TOO_NEW:
            latest = cameras.latest(0.0)[0]
            pose = latest if exposure_ns - latest.stamp_ns < last_pose_s * 1e9 else pose
        if isinstance(pose, Miss):
            return None
        ground = level_of(self.footprint_n(), plane) if self.terrain is None else self.terrain
        known = None if isinstance(body, Miss) else body
        return Sight(camera(info, INFO), pose, plane, ground, known, rates_up_to(pose, cameras))


def terrain_of(config: GroundConfig) -> Terrain | None:
    """Return the elevation model of the parameters, if they name one. Raises ElevationError."""
    return load_terrain(config.dem, config.dem_undulation_m) if config.dem else None


def listen_to_diagnostics(node: GraphNode, aircraft: Sequence[SeenAircraft]) -> None:
    """Give each aircraft the diagnostics of the nodes in its namespace."""
    by_namespace = {one.namespace: one.heard for one in aircraft}

    def take(message: Any) -> None:
        now_s = time.monotonic()
        for status in message.status:
            name, _, subject = status.name.partition(": ")
            namespace, _, short = name.rpartition("/")
            if namespace in by_namespace:
                by_namespace[namespace].take(now_s, f"{short}: {subject}", status)

    node.listen("/diagnostics", take, output(), raw=True)
