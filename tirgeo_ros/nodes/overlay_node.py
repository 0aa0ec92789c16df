"""The map on the video: frames, camera poses and the map's origin in; the drawn picture out."""

from __future__ import annotations

import gc
from functools import partial
from typing import Any

import cv2
from rclpy.node import Node

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.map_checks import MapChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.clicks import Clicks
from tirgeo_ros.core.overlay.map_renderer import DrawingVerdict
from tirgeo_ros.core.overlay.overlay import Overlay, OverlayResult
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.types.errors import cut, shown
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.messages import (
    DiagnosticItem,
    Messages,
    camera,
    camera_pose,
    compressed_pixels,
    diagnostic_level,
    image_pixels,
    navigation_status,
    pixel,
    stamp_ns,
    tangent_plane,
)
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.nodes.callbacks import steady_timer
from tirgeo_ros.nodes.diagnostics import Diagnostics, item_name
from tirgeo_ros.nodes.frame_statistics import FrameTimes, SentNumbers
from tirgeo_ros.nodes.map_watch import MapWatch
from tirgeo_ros.nodes.monitor import OK, WARN, Monitor
from tirgeo_ros.nodes.parameters import declare, given_names
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, latched, output, sensor_input
from tirgeo_ros.nodes.runner import run, unless_stopped
from tirgeo_ros.nodes.setup_checks import SUBJECT, InputChecks, SetupChecks
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe

_CLICKS = 10


class LocateTopics:
    """Connect the Clicks of an overlay with their topics; ``values`` is for the diagnostics."""

    def __init__(self, node: Node, clicks: Clicks, monitor: Monitor) -> None:
        self._clicks = clicks
        self._node = node
        self._messages = Messages(message_class)
        self._fix = advertise(node, "tirgeo/locate/fix", output())
        self._point = advertise(node, "tirgeo/locate/point", output())
        self._refused = ""
        # Best effort, so that any publisher is compatible.
        subscribe(node, "tirgeo/locate/pixel", self._take, sensor_input(_CLICKS), monitor)

    @property
    def values(self) -> dict[str, str]:
        """Return how many clicks were located and refused, and why the last one was refused."""
        found = {f"clicks_{name}": str(n) for name, n in sorted(self._clicks.counts.items())}
        return found | ({"last_click_refused": self._refused} if self._refused else {})

    def _take(self, message: Any) -> None:
        stamp_ns, u, v = pixel(message)
        answer = self._clicks.locate((u, v), stamp_ns)
        if isinstance(answer, Located):
            self._fix.publish(self._messages.located_fix(answer))
            self._point.publish(self._messages.located_point(answer))
            self._refused = ""
            return
        self._refused = answer.reason.value
        self._node.get_logger().warning(
            f"tirgeo/locate/pixel: no point at ({u:.0f}, {v:.0f}): {self._refused}",
            throttle_duration_sec=1.0,
        )


#: Period (s) of the timer that checks frames that wait for their poses.
_RELEASE_PERIOD_S = 0.02
#: Only the newest of the frames that arrive during drawing is wanted.
_FRAME_DEPTH = 1
_RAW, _COMPRESSED = "thermal/image_raw", "thermal/image_raw/compressed"
_INFO = "thermal/camera_info"


class OverlayNode(Node):
    """Connect one Overlay with its topics."""

    def __init__(self) -> None:
        super().__init__("overlay_node")
        cv2.setNumThreads(1)  # a frame is too little work for several threads
        self._config = declare(self, OverlayConfig)
        if not self._config.map:
            self.get_logger().warning("no map: set the parameter map to its file")
        layers = None if self._config.map else ()
        ground = unless_stopped(partial(ground_of, self._config))
        for note in ground.notes if isinstance(ground, Terrain) else ():
            self.get_logger().warning(shown(f"{self._config.dem}: {note}"))
        terrain = ground if isinstance(ground, Terrain) else None
        self._overlay = Overlay(self._config, layers, terrain)
        self._monitor = Monitor()
        self._map_checks = MapChecks(ground)
        self._picture_checks = PictureChecks(
            self._config, ground, given_names(self, OverlayConfig)
        )
        inputs = InputChecks(
            self, self._monitor, (_RAW, _COMPRESSED), *([] if self._config.camera else [(_INFO,)])
        )
        self._setup = SetupChecks(
            self, self._monitor, inputs, self._map_checks, self._picture_checks
        )
        self._verdicts: dict[str, DrawingVerdict] = {}  # of the nodes, by the names of their items
        self._camera = given_camera(self._config)
        if self._camera is not None:
            self._set_camera(self._camera)
        self._logged_notes: tuple[str, ...] = ()  # notes on the current map
        self.resources = MapWatch(self, self._config, lambda: self._overlay.plane)
        self._messages = Messages(message_class)
        self._times = FrameTimes()
        self._numbers: list[SentNumbers] = []  # of the frame topics
        self._arrivals = Arrivals()
        self._image = advertise(self, "tirgeo/overlay/image", output(IMAGE_DEPTH))
        self._jpeg = advertise(self, "tirgeo/overlay/image/compressed", output(IMAGE_DEPTH))
        self._timer = steady_timer(
            self, self._monitor, "drawing", _RELEASE_PERIOD_S, self._release
        )
        self._timer.cancel()
        self._subscribe()
        self._clicks = LocateTopics(self, self._overlay.clicks, self._monitor)
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)
        gc.freeze()  # keep a large map out of garbage collection while the video runs

    def _subscribe(self) -> None:
        frames, info = sensor_input(_FRAME_DEPTH), sensor_input(1)
        for topic, pixels_of in ((_RAW, image_pixels), (_COMPRESSED, compressed_pixels)):
            take_frame = partial(self._take_frame, topic, pixels_of)
            self._numbers.append(SentNumbers())
            counted = self._numbers[-1].listening
            subscribe(self, topic, take_frame, frames, self._monitor, wrapped=counted)
        for topic, take, qos in (
            ("tirgeo/camera_pose", self._take_pose, output()),
            ("tirgeo/origin", self._take_origin, latched()),
            ("/diagnostics", self._take_diagnostics, output()),
        ):
            subscribe(self, topic, take, qos, self._monitor)
        self._monitor.expects("tirgeo/camera_pose")
        if self._camera is None:
            subscribe(self, _INFO, self._take_camera_info, info, self._monitor)
            self._monitor.expects(_INFO)

    def _take_frame(self, topic: str, pixels_of: Any, message: Any) -> None:
        now_ns = self._now_ns()
        stamp = self._arrivals.stamp_ns(topic, stamp_ns(message), now_ns)
        self._times.arrived(stamp)
        pixels = pixels_of(message)
        self._overlay.add_frame(stamp, pixels, now_ns)
        self._timer.reset()
        self._release()
        self._setup.take(self._picture_checks.frame, stamp_ns(message), pixels, now_ns)

    def _take_pose(self, message: Any) -> None:
        pose = camera_pose(message)
        self._overlay.add_pose(pose)
        self._release()
        self._setup.take(self._picture_checks.pose, pose)

    def _take_camera_info(self, message: Any) -> None:
        self._set_camera(camera(message))

    def _set_camera(self, found: Camera) -> None:
        self._setup.take(self._picture_checks.camera, found)
        self._overlay.set_camera(found)

    def _take_origin(self, message: Any) -> None:
        before = self._overlay.plane
        plane = tangent_plane(message)
        self._overlay.set_plane(plane)
        self.resources.look()
        if plane != before:
            self._setup.take(self._map_checks.plane, plane)
            self._setup.take(self._picture_checks.plane, plane)

    def _log_notes(self) -> None:
        if self._overlay.notes != self._logged_notes:
            self._logged_notes = self._overlay.notes
            for note in self._logged_notes:
                self.get_logger().warning(shown(note))

    def _take_diagnostics(self, message: Any) -> None:
        for status in message.status:
            subject = self._subject(status.name)
            if subject == "navigation":
                self._overlay.set_status(navigation_status(status))
            elif subject == SUBJECT:
                severity = Severity(min(diagnostic_level(status), Severity.STOP))
                self._verdicts[status.name] = DrawingVerdict(severity, cut(status.message))
                worst = max(self._verdicts.values(), key=lambda verdict: verdict.severity)
                self._overlay.set_verdict(worst)

    def _subject(self, name: str) -> str:
        """Return the subject of an item of a node in this namespace; empty for any other item."""
        node, _, subject = name.partition(": ")
        namespace = self.get_namespace().rstrip("/")
        return subject if node.rpartition("/")[0] == namespace else ""

    def _release(self) -> None:
        if not self._overlay.frames:
            return
        self._renew_map()
        result = self._overlay.take(self._now_ns())
        if result is not None:
            self._publish(result)
            self._monitor.took("tirgeo/overlay/image", self._times.left(result.stamp_ns))
        if not self._overlay.frames:
            self._timer.cancel()

    def _renew_map(self) -> None:
        changed = self.resources.changed()
        if changed is not None:
            self._overlay.set_map(changed)
            self._setup.take(self._map_checks.map, changed)
            gc.freeze()
            self._log_notes()
        elif self.resources.error:
            self._overlay.map_failed()
            self._setup.take(self._map_checks.failed, self.resources.error)

    def _publish(self, result: OverlayResult) -> None:
        if self._image.get_subscription_count():
            self._image.publish(self._messages.image(result.stamp_ns, result.image))
        if self._jpeg.get_subscription_count():
            quality = [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg_quality]
            jpeg = cv2.imencode(".jpg", result.image, quality)[1].tobytes()
            self._jpeg.publish(self._messages.compressed(result.stamp_ns, jpeg))

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _items(self) -> list[DiagnosticItem]:
        self._renew_map()
        watch = self.resources
        numbers = self._overlay.counts | {"waiting": len(self._overlay.frames)} | watch.counts
        numbers |= {
            "frames_sent": sum(each.sent for each in self._numbers),
            "frames_missed": sum(each.missed for each in self._numbers),
        }
        values = {name: str(number) for name, number in numbers.items()}
        if self._overlay.poses.fault:
            values["poses_invalid_because"] = self._overlay.poses.fault
        values |= {"frame rate [Hz]": f"{self._overlay.frames.rate_hz:.1f}"}
        values |= self._times.values | self._clicks.values | self._arrivals.diagnostics
        waits = self._overlay.no_map_yet
        message = watch.error or (f"no map yet: {waits}" if waits else "ok")
        level = WARN if watch.error else OK
        item = DiagnosticItem(item_name(self, "overlay"), level, message, values)
        return [item, self._setup.item()]


main = partial(run, "overlay_node", OverlayNode)
