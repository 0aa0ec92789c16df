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
"""Write the topics that the nodes would publish, in log-time order, for ``tirgeo process``.

The poses, the transforms and the track are those of ekf_node and gimbal_node, the pictures those
of overlay_node, by the same core objects and conversions. The log time of an output is that of
the input that caused it. While a picture is being drawn, later messages wait in a queue.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import DjiConfig, OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.navigation.estimator.track import Track
from tirgeo_ros.core.overlay.frame_shapes import Unpainted
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.streams.stamps import RateLimit, exposure_ns
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import (
    STATE_TOPIC,
    TOPIC_TYPES,
    DiagnosticItem,
    Messages,
    NodeState,
    navigation_item,
)
from tirgeo_ros.io.messages.json_codec import state_text
from tirgeo_ros.io.messages.topics import prefix, resolved
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, OpenedFlight
from tirgeo_ros.tools.replay.picture_stage import PictureStage
from tirgeo_ros.tools.replay.registration import Registered, Registration, Sample
from tirgeo_ros.tools.replay.still_outputs import StillOutputs

DRAWN = "tirgeo/overlay/image/compressed"
#: Time between two reports of the state, as in the nodes.
REPORT_PERIOD_NS = 1_000_000_000
_TRACK_HZ = 0.1  # rate of the track, which is sent whole each time
#: Messages that are written together: one kind of work in a row uses the caches better.
_BLOCK = 64
#: Messages that may wait for pictures: some 10 s without a picture, a few MB.
_MOST_WAITING = 4096

#: Write a message to a contract topic: topic, message, log time (ns).
Write = Callable[[str, object, int], None]
#: Return the aircraft's pose at an instant (ns), or the reason why there is none.
BodyAt = Callable[[int], BodyPose | Miss]


class PoseOutputs:
    """Write the poses of a run, and the transforms, positions and track that follow from them."""

    def __init__(self, configs: NodeConfigs, messages: Messages, write: Write) -> None:
        self._messages, self._write = messages, write
        self._ekf, self._with_camera_tf = configs.ekf, configs.gimbal.publish_tf
        self._fix_rate = RateLimit(configs.ekf.fix_rate_hz)
        self._track = Track(messages.track_point)
        self._track_rate = RateLimit(_TRACK_HZ)
        self._has_fixed = False
        self._newest_ns = 0

    def new_plane(self, plane: TangentPlane, stamp_ns: int, log_time_ns: int) -> None:
        """Write the origin and, with the first one, the aircraft's fixed transforms."""
        self._write("tirgeo/origin", self._messages.origin(plane, stamp_ns), log_time_ns)
        if self._ekf.publish_tf and not self._has_fixed:
            fixed = self._messages.fixed_transforms(self._ekf.aircraft, stamp_ns)
            self._write("/tf_static", self._messages.tf(fixed), log_time_ns)
            self._has_fixed = True
        self._track.clear()

    def add(self, registered: Registered, body_at: BodyAt, log_time_ns: int) -> None:
        """Write poses; ``body_at`` gives the body pose from which a camera pose was computed."""
        solution, body, messages = registered.solution, registered.body, self._messages
        if solution is not None and body is not None:
            self._write("tirgeo/odometry", messages.odometry(solution, body), log_time_ns)
            if self._ekf.publish_tf:
                self._write("/tf", messages.tf([messages.body_transform(body)]), log_time_ns)
            if self._fix_rate.due(solution.stamp_ns):
                self._write("tirgeo/fix", messages.fix(solution), log_time_ns)
            self._track.add(body)
            self._newest_ns = body.stamp_ns
            if self._track_rate.due(body.stamp_ns):
                path = messages.path(body.stamp_ns, self._track.points())
                self._write("tirgeo/path", path, log_time_ns)
        for pose in registered.cameras:
            self._write("tirgeo/camera_pose", messages.camera_pose(pose), log_time_ns)
        for pose in registered.cameras if self._with_camera_tf else ():
            base = body_at(pose.stamp_ns)
            if not isinstance(base, Miss):
                transform = messages.camera_transform(base, pose)
                self._write("/tf", messages.tf([transform]), log_time_ns)

    def finish(self, log_time_ns: int) -> None:
        """Write the whole track."""
        if points := self._track.points():
            path = self._messages.path(self._newest_ns, points)
            self._write("tirgeo/path", path, log_time_ns)


class _Message(NamedTuple):
    topic: str
    message: object
    log_time_ns: int


class _Picture(NamedTuple):
    stamp_ns: int
    camera: Camera | None
    packet: bytes  # metadata for the video
    log_time_ns: int


class PictureOutputs:
    """Draw pictures, and write messages and pictures in the order of ``put`` and ``add``."""

    def __init__(
        self,
        stage: PictureStage,
        messages: Messages,
        write: Write,
        film: OverlayFilm | None,
        footprint_rate_hz: float,
        *,
        raw_images: bool,
    ) -> None:
        self._stage, self._messages, self._write, self._film = stage, messages, write, film
        self._footprint_rate = RateLimit(footprint_rate_hz)
        self._raw_images = raw_images
        self._waiting: deque[_Message | _Picture] = deque()
        self._under_way = 0

    def put(self, topic: str, message: object, log_time_ns: int) -> None:
        """Write a message after all earlier messages and pictures."""
        self._waiting.append(_Message(topic, message, log_time_ns))
        if len(self._waiting) > _MOST_WAITING:
            self._receive()
        elif len(self._waiting) >= _BLOCK:
            self._write_messages()

    def add(
        self,
        picture: Unpainted,
        overlay: Overlay,
        body_at: BodyAt,
        log_time_ns: int,
    ) -> None:
        """Draw a picture of the overlay; ``body_at`` gives the aircraft's pose at an instant."""
        due = self._footprint_rate.due(picture.stamp_ns)
        packet = self._film.packet(picture, body_at) if self._film is not None else b""
        self._stage.send(picture, overlay.painter.scene, with_outline=due)
        self._waiting.append(_Picture(picture.stamp_ns, picture.camera, packet, log_time_ns))
        self._under_way += 1
        while self._under_way > self._stage.most_under_way:
            self._receive()

    def finish(self) -> None:
        """Write all waiting pictures and messages."""
        while self._under_way:
            self._receive()
        self._write_messages()

    def _receive(self) -> None:
        """Write the oldest picture, what came before it, and the messages up to the next one."""
        self._write_messages()
        oldest = self._waiting.popleft()
        assert isinstance(oldest, _Picture)
        self._under_way -= 1
        self._write_picture(oldest)
        self._write_messages()

    def _write_messages(self) -> None:
        """Write the messages before the oldest picture."""
        while self._waiting and isinstance(self._waiting[0], _Message):
            self._write(*self._waiting.popleft())

    def _write_picture(self, picture: _Picture) -> None:
        """Write a finished picture, its calibration, and its footprint if it is due."""
        painted, messages = self._stage.receive(), self._messages
        stamp_ns, camera, packet, log_time_ns = picture
        if self._film is not None and painted.image is not None:
            self._film.video.add(stamp_ns, painted.image, packet)
        jpeg = messages.compressed(stamp_ns, painted.jpeg)
        self._write(DRAWN, jpeg, log_time_ns)
        if self._raw_images and painted.image is not None:
            image = messages.image(stamp_ns, painted.image)
            self._write("tirgeo/overlay/image", image, log_time_ns)
        if camera is not None:
            info = messages.camera_info(camera, stamp_ns)
            self._write("tirgeo/overlay/camera_info", info, log_time_ns)
        if painted.outline_n is not None:
            outline = messages.footprint(stamp_ns, painted.outline_n)
            self._write("tirgeo/footprint", outline, log_time_ns)


class OverlayFilm:
    """Make the metadata of a video's pictures.

    ``undulation_m`` is that of the geoid; if it is nan, there are no heights above sea level.
    """

    def __init__(
        self, video: VideoFile, overlay: Overlay, config: OverlayConfig, undulation_m: float
    ) -> None:
        self.video, self._overlay = video, overlay
        self._latency_s = config.video_latency_s
        self._metadata = FrameMetadata(config.confidence, undulation_m)

    def packet(self, picture: Unpainted, body_at: BodyAt) -> bytes:
        """Return a picture's metadata; without a trusted pose, they are only its time."""
        if not self.video.takes_metadata:
            return b""
        sight, camera, pose, plane = None, picture.camera, picture.pose, self._overlay.plane
        if camera is not None and pose is not None and plane is not None:
            body = body_at(pose.stamp_ns)
            aircraft = None if isinstance(body, Miss) else body
            ground = self._overlay.painter.shaper.ground
            sight = Sight(camera, pose, plane, ground, aircraft, picture.rates)
        return self._metadata.packet(exposure_ns(picture.stamp_ns, self._latency_s), sight)


class ProcessSetup(NamedTuple):
    """Hold a flight to be processed, with the overlay and the checks set up for it."""

    opened: OpenedFlight
    topics: Mapping[str, str]  # topics to read: resolved name -> contract topic
    overlay: Overlay | None  # None if no pictures are drawn
    checks: FlightChecks
    notes: Sequence[str]
    stills: StillOutputs | None = None


class ProcessOutputs:
    """Write all outputs of a flight, as its ``MessageSink`` and the watcher of its poses.

    ``written`` counts messages by name in the bag, ``states_s`` the seconds in each filter state.
    The pictures and the map are passed to the checks, which change nothing.
    """

    def __init__(
        self,
        setup: ProcessSetup,
        flight: Flight,
        poses: FlightPoses,
        writer: BagWriter,
        video: VideoFile | None,
        stage: PictureStage,
        *,
        raw_images: bool = False,
    ) -> None:
        self._stills = setup.stills
        configs, namespace, overlay = setup.opened.configs, setup.opened.namespace, setup.overlay
        self.topics = setup.topics
        self.written: Counter[str] = Counter()
        self.states_s: Counter[str] = Counter()
        self._flight, self._registered, self._overlay = flight, poses, overlay
        self._checks, self._stage = setup.checks, stage
        self._messages = Messages(configs.ekf.frame_ids)
        film = None
        if video is not None and overlay is not None:
            dji = ParameterFile(setup.opened.params).config("dji_node", DjiConfig, namespace)
            film = OverlayFilm(video, overlay, configs.overlay, dji.geoid_undulation_m)
        rate_hz = configs.overlay.footprint_rate_hz
        self._pictures = PictureOutputs(
            stage, self._messages, self._write_one, film, rate_hz, raw_images=raw_images
        )
        self._write = self._pictures.put  # writes after the older pictures
        self._poses = PoseOutputs(configs, self._messages, self._write)
        self._writer, self._prefix = writer, prefix(namespace)
        self._names = {topic: resolved(topic, namespace) for topic in TOPIC_TYPES}
        self._plane: TangentPlane | None = None
        self._reported_ns: int | None = None

    @property
    def registration(self) -> Registration:
        """Return the filter and the gimbal's composition of the flight."""
        return self._registered.registration

    def wants(self, topic: str) -> bool:
        """Return whether a topic changes outputs; attitudes do so until the joints are trusted."""
        return topic != "gimbal/attitude" or self.registration.composer.composition == "paper"

    def expect(self, topic: str, content: object) -> None:
        """Begin to decode a picture."""
        if self._overlay is not None:
            self._stage.decode_ahead(topic, content)

    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Write the outputs of filter and gimbal for a sample."""
        plane, body, now_ns = registered.plane, registered.body, self._flight.now_ns
        if body is not None and plane is not None and plane != self._plane:
            self._plane = plane
            self._poses.new_plane(plane, body.stamp_ns, now_ns)
            if self._overlay is not None:
                self._overlay.set_plane(plane)
                if self._overlay.map_given and self._overlay.painter.shaper.draped is not None:
                    self._checks.map(self._overlay.painter.shaper.draped)
        if self._overlay is not None:
            for pose in registered.cameras:
                self._overlay.poses.add(pose)
        self._poses.add(registered, self.registration.composer.body_at, now_ns)

    def set_camera(self, camera: Camera) -> None:
        """Take a calibration of the bag."""
        if self._overlay is not None:
            self._overlay.set_camera(camera)

    def take(self, topic: str, content: Any, arrival_ns: int) -> None:
        """Take a click or a picture."""
        if self._overlay is None:
            return
        if topic == "tirgeo/locate/pixel":
            stamp_ns, u, v = convert.pixel(content)
            answer = self._overlay.clicks.locate((u, v), stamp_ns)
            if isinstance(answer, Located):
                self._write("tirgeo/locate/fix", self._messages.located_fix(answer), arrival_ns)
                point = self._messages.located_point(answer)
                self._write("tirgeo/locate/point", point, arrival_ns)
            return
        self._overlay.status = self.registration.navigation.status()
        pixels, stamp_ns = self._stage.pixels(topic, content), convert.stamp_ns(content)
        self._checks.frame(topic, stamp_ns, pixels, arrival_ns)
        stamp_ns = self._flight.arrivals.stamp_ns(topic, stamp_ns, arrival_ns)
        self._overlay.add_frame(stamp_ns, pixels, arrival_ns)

    def proceed(self, arrival_ns: int) -> None:
        """Write the frame that is due, if any, and once a second the state."""
        self._draw(arrival_ns, arrival_ns)
        if self._reported_ns is None:
            self._reported_ns = arrival_ns
        late_ns = arrival_ns - self._reported_ns
        if late_ns >= REPORT_PERIOD_NS:
            self._reported_ns = arrival_ns - late_ns % REPORT_PERIOD_NS
            self._report(arrival_ns)

    def finish(self, log_time_ns: int) -> None:
        """Write the frames that still wait for poses, the track and the last state."""
        if self._overlay is not None:
            for deadline_ns in self._overlay.deadlines_ns:
                self._draw(log_time_ns, deadline_ns)
        self._poses.finish(log_time_ns)
        self._report(log_time_ns)
        self._pictures.finish()

    def _draw(self, log_time_ns: int, now_ns: int) -> None:
        """Output the frame, if any, that is drawn at ``now_ns``, after all poses."""
        picture = None if self._overlay is None else self._overlay.take_unpainted(now_ns)
        if picture is not None and self._overlay is not None:
            if self._stills is not None:
                self._stills.note(picture, self._overlay.plane)
            body_at = self.registration.composer.body_at
            self._pictures.add(picture, self._overlay, body_at, log_time_ns)

    def _write_one(self, topic: str, message: Any, log_time_ns: int) -> None:
        if self._stills is not None and topic == DRAWN:
            self._stills.write(convert.stamp_ns(message), bytes(message.data))
        name = self._names[topic]
        self._writer.write(name, TOPIC_TYPES[topic], message, log_time_ns)
        self.written[name] += 1

    def _report(self, log_time_ns: int) -> None:
        """Write diagnostics for people, and the filter's state for programs."""
        status = self.registration.navigation.status()
        self.states_s[status.state.value] += 1
        composer, overlay = self.registration.composer, self._overlay
        items = [navigation_item(f"{self._prefix}ekf_node: navigation", status)]
        items[0].values.update(self._flight.arrivals.diagnostics)
        composition = f"composition: {composer.composition}"
        items.append(self._counts("gimbal_node: camera pose", composer.diagnostics, composition))
        if overlay is not None:
            clicks = {f"clicks_{name}": n for name, n in sorted(overlay.clicks.counts.items())}
            items.append(self._counts("overlay_node: overlay", overlay.counts | clicks, "ok"))
        diagnostics = self._messages.diagnostics(log_time_ns, items)
        self._write("/diagnostics", diagnostics, log_time_ns)
        # The node starts with the flight, so that the same input gives the same bytes.
        node, started_ns = f"{self._prefix}ekf_node", self._flight.begun_ns or 0
        state = NodeState(node, log_time_ns, started_ns, navigation=status)
        self._write(STATE_TOPIC, self._messages.text(state_text(state)), log_time_ns)

    def _counts(self, name: str, counts: Mapping[str, int | str], message: str) -> DiagnosticItem:
        values = {key: str(number) for key, number in counts.items()}
        return DiagnosticItem(self._prefix + name, 0, message, values)
