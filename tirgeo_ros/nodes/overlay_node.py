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
"""Draw the map on the video: frames, camera poses and the map's origin in; pictures out."""

from __future__ import annotations

import gc
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.ground_checks import MapChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.clicks import TEMPERATURE_SCALE
from tirgeo_ros.core.overlay.frame_shapes import DrawingVerdict, FrameShapes, Unpainted
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.streams.stamps import Arrivals, RateLimit
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.core.types.finding import Severity, verdict_line
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.messages import (
    FINDINGS_TOPIC,
    STATE_TOPIC,
    DiagnosticItem,
    PictureState,
    camera_pose,
    findings_of,
    node_state,
    pixel,
    stamp_ns,
    tangent_plane,
    targets_of,
)
from tirgeo_ros.io.messages.json_codec import answer_text
from tirgeo_ros.io.messages.pictures import camera, compressed_pixels, image_pixels
from tirgeo_ros.io.messages.shapes_codec import SHAPES_FORMAT, written_shapes
from tirgeo_ros.io.messages.topics import IMAGE_DEPTH, TEMPERATURES
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.nodes.graph_node import GraphNode, latched, output, sensor_input, with_info
from tirgeo_ros.nodes.map_watch import MapWatch
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.parameters import given_names
from tirgeo_ros.nodes.runner import run, unless_stopped
from tirgeo_ros.nodes.setup_checks import InputChecks, OtherPublishers, Restarts, SetupChecks

_CLICKS = 10
#: Of one aircraft; the latched states of all come at once when this node starts.
_MOST_NODES = 20
#: Period (s) of the timer that checks frames that wait for their poses.
_RELEASE_PERIOD_S = 0.02
#: Only the newest of the frames that arrive during drawing is wanted.
_FRAME_DEPTH = 1
_RAW, _COMPRESSED = "thermal/image_raw", "thermal/image_raw/compressed"
_INFO = "thermal/camera_info"
_TIMED = 100  # newest frames whose time of arrival is kept


class OverlayNode(GraphNode):
    """Connect one Overlay with its topics."""

    def __init__(self) -> None:
        super().__init__("overlay_node")
        cv2.setNumThreads(1)  # a frame is too little work for several threads
        self._config = self.configured(OverlayConfig, self._reconfigure)
        if not self._config.map:
            self.log(OK, "no map is given: clicks are answered, no lines are drawn")
        ground = unless_stopped(partial(ground_of, self._config))
        for note in ground.notes if isinstance(ground, Terrain) else ():
            self.log(WARN, f"{self._config.dem}: {note}")
        terrain = ground if isinstance(ground, Terrain) else None
        self._overlay = Overlay(self._config, None if self._config.map else (), terrain)
        self._map_checks = MapChecks(ground)
        self._picture_checks = PictureChecks(
            self._config, ground, given_names(self, OverlayConfig)
        )
        info = [] if self._config.camera else [(_INFO,)]
        inputs = InputChecks(self, (_RAW, _COMPRESSED), *info)
        self._restarts = Restarts()  # of the other nodes: this node reads their states anyway
        checks = inputs, OtherPublishers(self), self._map_checks, self._picture_checks
        self._setup = SetupChecks(self, *checks, self._restarts)
        self._notice = ""  # of the newest picture: why it has no map
        self._verdicts: dict[str, DrawingVerdict] = {}  # by node
        self.reporting_nodes: set[str] = set()  # by name, in this namespace
        self._camera = configured_camera(self._config)
        if self._camera is not None:
            self._set_camera(self._camera)
        self._logged_notes: tuple[str, ...] = ()  # notes on the current map
        self.resources = MapWatch(self, self._config, lambda: self._overlay.plane)
        self._frames = FrameStatistics()
        self._arrivals = Arrivals()
        self._image = self.advertise("tirgeo/overlay/image", output(IMAGE_DEPTH))
        self._jpeg = self.advertise("tirgeo/overlay/image/compressed", output(IMAGE_DEPTH))
        self._clean = self.advertise("tirgeo/overlay/clean/compressed", output(IMAGE_DEPTH))
        self._shapes = self.advertise("tirgeo/overlay/shapes", output(IMAGE_DEPTH))
        self._markers = self.advertise("tirgeo/overlay/markers", output(IMAGE_DEPTH))
        self._jpeg_rate = RateLimit(self._config.compressed_rate_hz)
        self._info = self.advertise("tirgeo/overlay/camera_info", output(IMAGE_DEPTH))
        self._footprint = self.advertise("tirgeo/footprint", output())
        self._footprint_rate = RateLimit(self._config.footprint_rate_hz)
        self._fix = self.advertise("tirgeo/locate/fix", output())
        self._point = self.advertise("tirgeo/locate/point", output())
        self._answer = self.advertise("tirgeo/locate/answer", output())
        self._timer = self.steady_timer("drawing", _RELEASE_PERIOD_S, self._release)
        self._timer.cancel()
        self._subscribe()
        self.report_each_second(
            self._items, self._setup.findings, picture=self._picture_state, counts=self._counts
        )
        gc.freeze()  # keep a large map out of garbage collection while the video runs

    def _reconfigure(self, config: OverlayConfig) -> None:
        self._config = config
        self._jpeg_rate = RateLimit(config.compressed_rate_hz)
        self._overlay.configure(config)
        self._setup.take(self._picture_checks.configure, config)
        self.report([self._overlay_item()])

    def _subscribe(self) -> None:
        frames, info = sensor_input(_FRAME_DEPTH), sensor_input(1)
        for topic, pixels_of in ((_RAW, image_pixels), (_COMPRESSED, compressed_pixels)):
            take_frame = partial(self._take_frame, topic, pixels_of)
            self.listen(topic, take_frame, frames, wrapped=partial(self._frames.counting, topic))
        set_targets = self._overlay.clicks.set_targets
        for topic, take, qos in (
            (TEMPERATURES, self._take_temperatures, sensor_input(_CLICKS)),
            ("tirgeo/camera_pose", self._take_pose, output()),
            ("tirgeo/origin", self._take_origin, latched()),
            ("tirgeo/targets", lambda m: set_targets(targets_of(m)), latched()),
            (STATE_TOPIC, self._take_state, latched(_MOST_NODES)),
            (FINDINGS_TOPIC, self._take_findings, output()),
            # Best effort, so that any publisher is compatible.
            ("tirgeo/locate/pixel", self._take_click, sensor_input(_CLICKS)),
        ):
            self.listen(topic, take, qos)
        self.monitor.expects("tirgeo/camera_pose")
        if self._camera is None:
            self.listen(_INFO, lambda m: self._set_camera(camera(m)), info)
            self.monitor.expects(_INFO)

    def _take_frame(self, topic: str, pixels_of: Any, message: Any) -> None:
        now_ns = self.now_ns
        stamp = self._arrivals.stamp_ns(topic, stamp_ns(message), now_ns)
        self._frames.arrived(stamp)
        pixels = pixels_of(message)
        self._overlay.add_frame(stamp, pixels, now_ns)
        self._timer.reset()
        self._release()
        self._setup.take(self._picture_checks.frame, stamp_ns(message), pixels, now_ns)

    def _take_temperatures(self, message: Any) -> None:
        pixels = compressed_pixels(message)
        self._overlay.add_temperatures(stamp_ns(message), pixels, TEMPERATURE_SCALE)

    def _take_pose(self, message: Any) -> None:
        pose = camera_pose(message)
        self._overlay.poses.add(pose)
        self._release()
        self._setup.take(self._picture_checks.pose, pose)

    def _set_camera(self, camera_model: Camera) -> None:
        self._setup.take(self._picture_checks.camera, camera_model)
        self._overlay.set_camera(camera_model)

    def _take_origin(self, message: Any) -> None:
        before = self._overlay.plane
        plane = tangent_plane(message)
        self._overlay.set_plane(plane)
        self.resources.look()
        if plane != before:
            self._setup.take(self._map_checks.plane, plane)
            self._setup.take(self._picture_checks.plane, plane)

    def _take_click(self, message: Any) -> None:
        clicked_ns, u, v = pixel(message)
        answer = self._overlay.clicks.locate((u, v), clicked_ns)
        if self._answer.is_wanted:
            self._answer.publish(self.messages.text(answer_text(answer)))
        if isinstance(answer, Located):
            self._fix.publish(self.messages.located_fix(answer))
            self._point.publish(self.messages.located_point(answer))
        else:
            text = f"tirgeo/locate/pixel: no point at ({u:.0f}, {v:.0f}): {answer.reason.value}"
            self.get_logger().warning(text, throttle_duration_sec=1.0)

    def _take_state(self, message: Any) -> None:
        state = node_state(message)
        if len(self.reporting_nodes) < _MOST_NODES:
            self.reporting_nodes.add(state.name)
        self._restarts.take(state)
        if state.navigation is not None:
            self._overlay.status = state.navigation

    def _take_findings(self, message: Any) -> None:
        node, _, findings = findings_of(message)
        if node not in self._verdicts and len(self._verdicts) >= _MOST_NODES:
            return
        severity = max((finding.severity for finding in findings), default=Severity.NOTE)
        self._verdicts[node] = DrawingVerdict(severity, shown(verdict_line(findings)))
        self._overlay.verdict = max(self._verdicts.values(), key=lambda verdict: verdict.severity)

    def _release(self) -> None:
        if not self._overlay.frames:
            return
        self._renew_map()
        picture = self._overlay.take_unpainted(self.now_ns)
        if picture is not None:
            self._publish(picture)
        if not self._overlay.frames:
            self._timer.cancel()

    def _renew_map(self) -> None:
        changed = self.resources.changed()
        if changed is not None:
            self._overlay.set_map(changed)
            self._setup.take(self._map_checks.map, changed)
            gc.freeze()
            if self._overlay.notes != self._logged_notes:
                self._logged_notes = self._overlay.notes
                for note in self._logged_notes:
                    self.log(WARN, note)
        elif self.resources.error:
            self._overlay.map_failed(self.resources.failure)
            self._setup.take(self._map_checks.failed, self.resources.error)

    def _publish(self, picture: Unpainted) -> None:
        stamp, shapes = picture.stamp_ns, self._overlay.painter.shapes(picture)
        is_due = self._jpeg_rate.due(stamp)
        clean = self._clean, self._shapes, self._markers
        if is_due and any(topic.is_wanted for topic in clean):
            self._publish_clean(picture, shapes)
        if self._image.is_wanted or (is_due and self._jpeg.is_wanted):
            self._publish_painted(picture, shapes, is_due=is_due)
        had_notice, self._notice = bool(self._notice), shapes.notice
        if bool(shapes.notice) != had_notice:  # at once: an operator is waiting for it
            self.report([self._overlay_item()])
        self.monitor.published("tirgeo/overlay/image", self._frames.age_s(stamp))
        self._publish_geometry(picture)

    def _publish_clean(self, picture: Unpainted, shapes: FrameShapes) -> None:
        """Publish a picture without its map, and what is drawn on it: the page draws it."""
        stamp, clean = picture.stamp_ns, self._overlay.painter.clean(picture)
        written = written_shapes(shapes, clean.pixels, clean.celsius)
        if self._shapes.is_wanted:
            data = written.to_bytes()
            self._shapes.publish(self.messages.compressed(stamp, data, SHAPES_FORMAT))
        if self._clean.is_wanted:
            jpeg = self._jpeg_of(clean.pixels)
            self._clean.publish(self.messages.compressed(stamp, jpeg))
        if self._markers.is_wanted:
            self._markers.publish(self.messages.line_marker(stamp, written))

    def _publish_painted(self, picture: Unpainted, shapes: FrameShapes, *, is_due: bool) -> None:
        image = self._overlay.painter.paint(picture, shapes).image
        if self._image.is_wanted:
            self._image.publish(self.messages.image(picture.stamp_ns, image))
        if is_due and self._jpeg.is_wanted:
            jpeg = self._jpeg_of(image)
            self._jpeg.publish(self.messages.compressed(picture.stamp_ns, jpeg))

    def _jpeg_of(self, image: Pixels) -> bytes:
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg_quality]
        return cv2.imencode(".jpg", image, quality)[1].tobytes()

    def _publish_geometry(self, picture: Unpainted) -> None:
        """Publish a picture's calibration, and its footprint if that is due.

        The footprint of a picture without a trusted pose is empty, so that no viewer keeps an old
        one.
        """
        if picture.camera is not None and self._info.is_wanted:
            self._info.publish(self.messages.camera_info(picture.camera, picture.stamp_ns))
        if self._footprint.is_wanted and self._footprint_rate.due(picture.stamp_ns):
            outline_n = self._overlay.painter.shaper.footprint(picture.pose)
            self._footprint.publish(self.messages.footprint(picture.stamp_ns, outline_n))

    def _items(self) -> list[DiagnosticItem]:
        self._renew_map()
        return [self._overlay_item(), self._setup.report()]

    def _counts(self) -> dict[str, int]:
        overlay, clicks = self._overlay, self._overlay.clicks.counts
        counts = overlay.counts | {"waiting": len(overlay.frames)} | self.resources.counts
        counts |= {f"clicks_{name}": number for name, number in sorted(clicks.items())}
        return counts | {"frames_sent": self._frames.sent, "frames_missed": self._frames.missed}

    def _picture_state(self) -> PictureState:
        config, newest_ns = self._config, self._frames.newest_ns
        return PictureState(self._notice, config.video_latency_s, config.confidence, newest_ns)

    def _overlay_item(self) -> DiagnosticItem:
        watch, overlay = self.resources, self._overlay
        values = {name: str(number) for name, number in self._counts().items()}
        texts = {"poses_invalid_because": overlay.poses.fault, "notice": self._notice}
        values |= {name: text for name, text in texts.items() if text}
        values |= self._arrivals.diagnostics
        waits = f"no map yet: {overlay.no_map_yet}" if overlay.no_map_yet else ""
        fine = "ok" if self._config.map else "ok; no map is given"
        level, message = (WARN, watch.error) if watch.error else (OK, waits or fine)
        return self.item("overlay", values, message, level)


class FrameStatistics:
    """Record when the newest frames arrived; count the frames that were sent and missed.

    ``sent`` counts the frames published since the first arrival, ``missed`` those that did not
    arrive: a newer frame replaced them in a shallow queue, or they were lost in transport. Both
    come from the publication sequence numbers. A number that goes back means a new publisher. With
    two publishers at once on one topic both counts are wrong.
    """

    def __init__(self) -> None:
        self.sent = self.missed = 0
        self.newest_ns = 0  # stamp of the newest frame
        self._last: dict[str, int] = {}  # number of each topic's newest frame
        self._arrived_s: deque[tuple[int, float]] = deque(maxlen=_TIMED)  # stamp (ns), time

    def count(self, topic: str, number: int) -> None:
        """Count the frame with this sequence number, and those missed before it."""
        last = self._last.get(topic, 0)
        skipped = number - last - 1 if 0 < last < number else 0
        self.missed += skipped
        self.sent += skipped + 1
        self._last[topic] = number

    def counting(self, topic: str, receive: Callable[[Any], None]) -> Callable[..., None]:
        """Return ``receive`` as a callback that also counts frames by their sequence number."""

        def take(message: Any, info: Any) -> None:
            number = info.get("publication_sequence_number") if info else None
            if number is not None:  # not every middleware numbers messages
                self.count(topic, number)
            receive(message)

        return with_info(take)

    def arrived(self, stamp_ns: int) -> None:
        """Record the arrival of a frame."""
        self.newest_ns = stamp_ns
        self._arrived_s.append((stamp_ns, time.monotonic()))

    def age_s(self, stamp_ns: int) -> float:
        """Return the time since a frame's arrival; 0 if it is unknown."""
        now_s = time.monotonic()
        return now_s - dict(self._arrived_s).get(stamp_ns, now_s)


main = partial(run, "overlay_node", OverlayNode)
