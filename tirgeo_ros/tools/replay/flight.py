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
"""Read a recorded flight in one pass through its bag, for any number of sinks.

A sink takes the samples of topics (``Flight.add``), or the poses that filter and gimbal compute
from them (``Flight.registered``), or whole messages (``MessageSink``, as in ``tirgeo process``).
The checks get the same messages. Each message is decoded once.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any, Protocol

from tirgeo_ros.core.adjustment.adjustment import Adjustment
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.checks.input_checks import size_fault
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import RecordingNavigation
from tirgeo_ros.core.streams.stamps import Arrivals
from tirgeo_ros.core.types.errors import (
    BagError,
    CameraError,
    ConfigError,
    MessageError,
    TirgeoError,
)
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, pictures as picture_messages
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES, resolved
from tirgeo_ros.tools.presentation.progress import Report, part
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.registration import (
    FILTERS,
    METHOD_TOPICS,
    SAMPLES,
    Registered,
    Registration,
    Sample,
    checked_topics,
    inputs_of,
    navigated,
    topics_absent,
)

_TRIED = 10  # pictures to try for their size, because the first ones may be damaged
WHOLE_FLIGHT_S = 1e9  # span of a buffer that keeps all poses
#: Poses this near an instant are kept; it is longer than any gap that is interpolated across.
_NEAR_NS = 1_000_000_000
#: The camera's motion is measured from this much before an instant to this much after it.
_MOTION_NS = 50_000_000
#: Messages that are decoded together: a series of equal work uses the caches better.
_BLOCK = 32
#: Rough share of the first of two passes in the work.
_FIRST_SHARE = 0.4
#: The checks get each tenth message of a topic that the sink no longer uses: enough for statistics
#: over a flight, at little cost.
_UNWANTED_STEP = 10

#: Take a sample, and the outputs of filter and gimbal for it.
Watcher = Callable[[Sample, Registered], None]


class MessageSink(Protocol):
    """Define a sink that takes pictures and clicks too, and writes as the flight goes on."""

    topics: Mapping[str, str]  # topics to read for the sink: resolved name -> contract topic

    def wants(self, topic: str) -> bool:
        """Return whether a topic of samples still changes the outputs."""

    def expect(self, topic: str, content: object) -> None:
        """Prepare for a picture that ``take`` will soon receive."""

    def set_camera(self, camera: Camera) -> None:
        """Take a calibration. If it raises TirgeoError, the message counts as unreadable."""

    def take(self, topic: str, content: Any, arrival_ns: int) -> None:
        """Take a message that is no sample. If it raises TirgeoError, it counts as unreadable."""

    def proceed(self, arrival_ns: int) -> None:
        """Advance to the log time of a message, after all sinks have taken it."""


class Flight:
    """Hold a recorded flight and the sinks of the one pass through it.

    Messages are counted: ``read`` and ``undecoded`` by their names in the bag, ``unreadable`` by
    contract topic, with the newest reason. ``now_ns`` is the log time of the message that is being
    processed. With ``pictures``, ``picture_stamps_ns`` holds the stamps of the pictures. A given
    ``camera`` overrides the bag's; with ``needs_camera`` there must be one. ``checks`` get all
    inputs, and the pixels of the pictures that they need or, with ``all_pixels``, of all.
    """

    def __init__(
        self,
        reader: BagReader,
        namespace: str = "",
        *,
        pictures: bool = False,
        camera: Camera | None = None,
        checks: FlightChecks | None = None,
        needs_camera: bool = True,
        all_pixels: bool = False,
    ) -> None:
        self.read: Counter[str] = Counter()
        self.undecoded: Counter[str] = Counter()
        self.unreadable: Counter[str] = Counter()
        self.unreadable_because: dict[str, str] = {}
        self.picture_stamps_ns: list[int] = []
        self.arrivals = Arrivals()
        self.begun_ns: int | None = None
        self.now_ns = 0
        self._reader, self._namespace = reader, namespace
        self._pictures, self._all_pixels = pictures, all_pixels
        self._given_camera = self._camera = camera
        self._needs_camera = needs_camera
        self._checks = checks
        self._sink: MessageSink | None = None
        self._takers: defaultdict[str, list[Callable[[Sample], object]]] = defaultdict(list)
        self._to_smooth: list[FlightPoses] = []
        self._unwanted = 0
        self._cdr = Cdr()

    @property
    def refused(self) -> int:
        """Return the number of messages that could not be used."""
        return self.undecoded.total() + self.unreadable.total()

    @property
    def duration_s(self) -> float:
        """Return the time from the first message for the sinks to the newest one."""
        return (self.now_ns - (self.begun_ns or 0)) * 1e-9

    @property
    def camera(self) -> Camera:
        """Return the camera, after the flight was read.

        Raise BagError without a usable calibration, and CameraError if its size is not that of the
        bag's pictures.
        """
        if self._camera is None:
            raise BagError(f"{self._reader.path}: no message of {CAMERA_INFO} could be used")
        size = self._picture_size()
        fault = size_fault(self._camera, *size) if size else ""
        if fault:
            raise CameraError(
                f"{self._reader.path}: {fault}: give the calibration of these pictures (--camera, "
                f"or {CAMERA_INFO})"
            )
        return self._camera

    def _picture_size(self) -> tuple[int, int] | None:
        """Return (width, height) of the first picture that can be read, or None without one."""
        for topic in filter(self.has, PICTURES):
            name = resolved(topic, self._namespace)
            for message in islice(self._reader.messages([name]), _TRIED):
                with suppress(TirgeoError):
                    content = self._cdr.deserialize(message.data, message.typename)
                    height, width = picture_messages.pixels(topic, content).shape[:2]
                    return width, height
        return None

    def registered(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        instants_ns: Sequence[int],
        *watchers: Watcher,
        smooth: bool = False,
        adjustment: Adjustment | None = None,
    ) -> FlightPoses:
        """Add a registration of the samples to poses, and return it.

        Raise BagError if a needed topic is absent. ``smooth``: each pose uses later measurements
        too. ``adjustment`` corrects the camera's poses.
        """
        topics = inputs_of(
            self._reader, ekf.method, gimbal.composition, self._namespace, pictures=False
        )
        poses = FlightPoses(ekf, gimbal, topics.values(), instants_ns, watchers, adjustment)
        return self.add_poses(poses, smooth=smooth)

    def add_poses(self, poses: FlightPoses, *, smooth: bool = False) -> FlightPoses:
        """Add a registration that takes the samples of its topics, and return it."""
        self.add(poses.topics, poses.take)
        if smooth:
            self._to_smooth.append(poses)
        return poses

    def add(self, topics: Collection[str], take: Callable[[Sample], object]) -> None:
        """Pass the samples of contract topics to ``take``, in order of arrival."""
        for topic in topics:
            self._takers[topic].append(take)

    def has(self, topic: str) -> bool:
        """Return whether the bag has a contract topic with its type."""
        name = resolved(topic, self._namespace)
        return self._reader.topics().get(name) == TOPIC_TYPES[topic]

    def read_all(self, progress: Report, sink: MessageSink | None = None) -> None:
        """Pass the flight to all sinks; call ``progress`` with seconds of the flight.

        To smooth poses, a first pass records the filter. Raise BagError if the camera's
        calibration is needed and absent.
        """
        if self._needs_camera and self._given_camera is None and not self.has(CAMERA_INFO):
            raise topics_absent(self._reader, [(CAMERA_INFO,)], self._namespace)
        self._sink = sink
        if self._to_smooth:
            first = Flight(self._reader, self._namespace, needs_camera=False)
            for poses in self._to_smooth:
                first.add(METHOD_TOPICS[poses.ekf.method], poses.recorder())
            first.read_all(part(progress, 0.0, _FIRST_SHARE))
            for poses in self._to_smooth:
                poses.smooth()
            progress = part(progress, _FIRST_SHARE, 1.0)
        wanted = [CAMERA_INFO, *self._takers, *(PICTURES if self._pictures else ())]
        present = {resolved(name, self._namespace): name for name in wanted if self.has(name)}
        topics = present if sink is None else sink.topics
        checks = self._checks
        checked = {} if checks is None else checked_topics(self._reader, self._namespace, topics)
        first_ns, last_ns = self._reader.span_ns
        messages = self._reader.messages({*topics, *checked})
        while block := list(islice(messages, _BLOCK)):
            progress((block[-1].log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
            contents = [
                self._content(topics[message.topic], message) if message.topic in topics else None
                for message in block
            ]
            for message, content in zip(block, contents, strict=True):
                if message.topic in topics:
                    self._take(topics[message.topic], message, content)
                elif checks is not None:
                    checks.message(checked[message.topic], message)

    def _content(self, topic: str, message: BagMessage) -> object | None:
        """Return the content, or the error that prevents it; None for a picture without a sink."""
        if self._sink is None and topic in PICTURES:
            return None
        try:
            content: object = self._cdr.deserialize(message.data, message.typename, message.topic)
        except MessageError as error:
            return error
        if self._sink is not None and topic in PICTURES:
            self._sink.expect(topic, content)
        return content

    def _take(self, topic: str, message: BagMessage, content: object | None) -> None:
        """Process a message; if the sink does not use it, only the checks may get it."""
        self.now_ns = message.log_time_ns
        if self.begun_ns is None:
            self.begun_ns = self.now_ns
        if self._sink is not None and not self._sink.wants(topic):
            self._unwanted += 1
            skipped = self._unwanted % _UNWANTED_STEP or isinstance(content, MessageError)
            if self._checks is not None and not skipped:
                with suppress(TirgeoError):
                    self._checks.sample(topic, SAMPLES[topic](content), self.now_ns)
            return
        if isinstance(content, MessageError):
            self.undecoded[message.topic] += 1
            if self._sink is None and self._checks is not None:
                self._checks.refused(topic, str(content))
            return
        if content is not None:
            self.read[message.topic] += 1
        sample = self._sample(topic, message, content)
        if sample is not None:
            for take in self._takers[topic]:
                take(sample)
        if self._sink is not None:
            self._sink.proceed(self.now_ns)

    def _sample(self, topic: str, message: BagMessage, content: object | None) -> Sample | None:
        """Return a message's sample, or take another message; count what cannot be used."""
        try:
            if topic in SAMPLES:
                sample = SAMPLES[topic](content)
                if self._checks is not None:
                    self._checks.sample(topic, sample, self.now_ns)
                return self.arrivals.stamped(topic, sample, self.now_ns)
            self._take_other(topic, message, content)
        except TirgeoError as error:
            self.unreadable[topic] += 1
            self.unreadable_because[topic] = str(error)
            if self._checks is not None:
                self._checks.refused(topic, str(error))
        return None

    def _take_other(self, topic: str, message: BagMessage, content: object | None) -> None:
        """Take a calibration, a picture, or another message of the sink."""
        if topic == CAMERA_INFO:
            self._camera = self._given_camera or picture_messages.camera(content)
            if self._checks is not None:
                self._checks.camera(self._camera, self.now_ns)
            if self._sink is not None:
                self._sink.set_camera(self._camera)
        elif self._sink is not None:
            self._sink.take(topic, content, self.now_ns)
        else:
            self.picture_stamps_ns.append(header_stamp_ns(message.data))
            if self._checks is not None:
                self._checks.picture(topic, message, always=self._all_pixels)


class FlightPoses:
    """Compute the poses of a flight; keep the camera's poses near some instants (ns; None: all).

    All poses are in one tangent plane. ``watchers`` are called with each sample and its outputs.
    """

    def __init__(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        topics: Collection[str],
        instants_ns: Sequence[int] | None = (),
        watchers: Sequence[Watcher] = (),
        adjustment: Adjustment | None = None,
    ) -> None:
        self.ekf, self._gimbal, self.topics = ekf, gimbal, topics
        self._adjustment = adjustment
        self.watchers = list(watchers)
        self.cameras: PoseBuffer[CameraPose] = PoseBuffer(WHOLE_FLIGHT_S)
        self._instants_ns = None if instants_ns is None else sorted(instants_ns)
        self.registration = Registration(ekf, gimbal, None, adjustment)
        self._recording: RecordingNavigation | None = None

    @property
    def plane(self) -> TangentPlane | None:
        """Return the tangent plane of the poses; None before the first pose."""
        return self.registration.navigation.plane

    def recorder(self) -> Callable[[Sample], object]:
        """Return a function that records the samples of a first pass, before ``smooth``.

        Raise ConfigError for a method without a filter.
        """
        if self.ekf.method not in FILTERS:
            choices = " or ".join(FILTERS)
            raise ConfigError(
                f"method {self.ekf.method} has no filter to smooth: choose {choices}, or do not "
                "smooth"
            )
        self._recording = recording = RecordingNavigation(self.ekf)
        return lambda sample: navigated(recording, sample)

    def smooth(self) -> None:
        """Begin a second pass, with the smoothed poses of the first one."""
        assert self._recording is not None
        smoothed = self._recording.smoothed()
        self.registration = Registration(self.ekf, self._gimbal, smoothed, self._adjustment)

    def take(self, sample: Sample) -> None:
        """Process a sample in filter and gimbal, and keep the camera poses near the instants."""
        registered = self.registration.take(sample)
        for pose in registered.cameras:
            if self._instants_ns is None or self._is_near(pose.stamp_ns):
                self.cameras.add(pose)
        for watcher in self.watchers:
            watcher(sample, registered)

    def _is_near(self, stamp_ns: int) -> bool:
        assert self._instants_ns is not None
        after = bisect_left(self._instants_ns, stamp_ns - _NEAR_NS)
        nearest = self._instants_ns[after : after + 1]
        return bool(nearest) and nearest[0] <= stamp_ns + _NEAR_NS

    def at(self, stamp_ns: int) -> tuple[CameraPose, CameraRates | None] | None:
        """Return the pose at one of the instants and the camera's motion there, or None."""
        return pose_at(self.cameras, stamp_ns)


def pose_at(
    poses: PoseBuffer[CameraPose], stamp_ns: int
) -> tuple[CameraPose, CameraRates | None] | None:
    """Return the pose at an instant (ns) and the camera's motion there, or None without a pose."""
    pose = poses.at(stamp_ns)
    if not isinstance(pose, CameraPose):
        return None
    around = [poses.at(stamp_ns + step) for step in (-_MOTION_NS, 0, _MOTION_NS)]
    present = [each for each in around if isinstance(each, CameraPose)]
    return pose, CameraRates.between(present[0], present[-1]) if len(present) > 1 else None
