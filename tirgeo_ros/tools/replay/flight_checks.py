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
"""Check a recorded flight with the data that a command reads and computes anyway.

The checks do not change this data; they only return findings.
"""

from __future__ import annotations

import functools
import math
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.ground_checks import MapChecks
from tirgeo_ros.core.checks.input_checks import (
    GIMBAL,
    RecordedTopics,
    parameter_findings,
    recording_findings,
    unreadable_findings,
)
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks, nearest_causes
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.checks.stream_checks import Stream, lone_findings
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.map.vector_map import MapLayer
from tirgeo_ros.core.overlay.map_shapes import DrapedMap, drape_layers
from tirgeo_ros.core.streams.stamps import Arrivals
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError
from tirgeo_ros.core.types.finding import Finding, sorted_findings
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample, JointSample
from tirgeo_ros.io.bags.bag import BagMessage, Cdr
from tirgeo_ros.io.messages import SENSED_TOPICS, TOPIC_TYPES, pictures as picture_messages
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.replay.node_configs import OpenedFlight
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Sample

#: Calls that are run together: one kind of work in a row uses the processor's caches better.
_BLOCK = 128
_JUMP_S = 1.0  # a longer step between the stamps of the gimbal is a jump

F = TypeVar("F", bound=Callable[..., None])
T = TypeVar("T")


def _guarded(most: int = 1) -> Callable[[F], F]:
    """Let ``run_queued`` run a method's calls, once ``most`` calls of all methods wait."""

    def queued(method: F) -> F:
        @functools.wraps(method)
        def call(self: FlightChecks, *arguments: Any) -> None:
            self.queue.append((method, arguments))
            if len(self.queue) >= most:
                self.run_queued()

        return cast("F", call)

    return queued


def try_load(
    findings: list[Finding], parameter: str, load: Callable[[], T], *, used: bool = True
) -> T | None:
    """Return a file's contents by ``load``; if it cannot be read, add a finding and return None.

    The finding is a caution if the file is not ``used`` except for the checks.
    """
    try:
        return load()
    except TirgeoError as error:
        case = "" if used else "unused"
        findings.append(finding("{topic}_unreadable", case, topic=parameter, why=error))
        return None


class FlightChecks:
    """Feed all groups of checks. For each sample call ``sample``, then ``watch``.

    A given ``camera`` overrides the bag's; ``layers`` are draped in each new plane, or the caller
    does it and calls ``map``; ``pictures``: the bag should have pictures.
    """

    def __init__(
        self,
        opened: OpenedFlight,
        *,
        ground: Ground | None = None,
        layers: Sequence[MapLayer] | None = None,
        camera: Camera | None = None,
        pictures: bool = False,
    ) -> None:
        (ekf, gimbal, overlay, given), namespace = opened.configs, opened.namespace
        self._navigation = NavigationChecks(ekf, given)
        self._gimbal = GimbalChecks(gimbal, given)
        self._pictures = PictureChecks(overlay, ground, given)
        self._map = MapChecks(ground)
        self._ground, self._layers = ground, layers
        self._given_camera = camera
        self._cdr = Cdr()
        self._arrivals = Arrivals()
        self._streams: dict[str, Stream] = {}  # the gimbal's topics
        self._plane: TangentPlane | None = None
        self.picture_size: tuple[int, int] | None = None  # width, height of the newest picture
        self.arrivals_ns: defaultdict[str, list[int]] = defaultdict(list)  # topic -> log times
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self.failed: Counter[str] = Counter()  # exceptions in the checks
        self.queue: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        if camera is not None:
            self._pictures.camera(camera)
        recording = RecordedTopics(
            opened.reader.topics(),
            {topic: TOPIC_TYPES[topic] for topic in (*SENSED_TOPICS, *PICTURES, CAMERA_INFO)},
            namespace,
            has_camera=camera is not None,
            wants_pictures=pictures,
        )
        pictured = recording.present.intersection((*PICTURES, *GIMBAL))
        unused = ParameterFile(opened.params).elsewhere(namespace)
        self.at_start = [
            *recording_findings(recording),
            *parameter_findings(given, unused, namespace, pictures=bool(pictured)),
        ]

    def run_queued(self) -> None:
        """Run the calls that wait."""
        queue, self.queue = self.queue, []
        for method, arguments in queue:
            self._run(method, arguments)

    def _run(self, method: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        """Run a check; count an exception as a fault of the check instead of raising it."""
        try:
            method(self, *arguments)
        except Exception as error:  # noqa: BLE001  a check must not stop a command
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            self.failed[f"{type(error).__name__}: {error} ({where})"] += 1

    @_guarded(_BLOCK)
    def sample(self, topic: str, sample: Sample, arrival_ns: int) -> None:
        """Take a sample of a contract topic, with the original stamp of its message."""
        self.arrivals_ns[topic].append(arrival_ns)
        if isinstance(sample, JointSample | CameraAttitudeSample):
            stream = self._streams.setdefault(topic, Stream(_JUMP_S))
            stream.add(sample, arrival_ns)
        if isinstance(sample, JointSample):
            self._gimbal.joints(self._arrivals.stamped(topic, sample, arrival_ns))
        elif isinstance(sample, CameraAttitudeSample):
            self._gimbal.reported(self._arrivals.stamped(topic, sample, arrival_ns))
        else:
            self._navigation.take(topic, sample, arrival_ns)
        if isinstance(sample, ImuSample) and sample.autopilot_q_nb is not None:
            stamp_ns = self._arrivals.stamp_ns(topic, sample.stamp_ns, arrival_ns)
            self._gimbal.autopilot(stamp_ns, sample.autopilot_q_nb)
            if sample.is_attitude_alone:
                self._gimbal.autopilot_alone(stamp_ns, sample.autopilot_q_nb)

    @_guarded(_BLOCK)
    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Take the outputs of filter and gimbal for a sample."""
        plane = registered.plane
        if plane is not None and plane is not self._plane:
            self._plane = plane
            self._pictures.plane(plane)
            self._map.plane(plane)
            if self._layers is not None:
                ground = math.nan if self._ground is None else self._ground
                try:
                    self._map.map(drape_layers(self._layers, plane, ground))
                except ConfigError as error:
                    self.at_start.append(finding("no_ground", why=error))
        if registered.body is not None:
            self._gimbal.body(registered.body)
        for pose in registered.cameras:
            self._pictures.pose(pose)

    @_guarded()
    def map(self, draped: DrapedMap) -> None:
        """Take the map, draped in the newest plane that ``watch`` has received."""
        self._map.map(draped)

    @_guarded()
    def camera(self, camera: Camera, arrival_ns: int) -> None:
        """Take a calibration of the bag."""
        self.arrivals_ns[CAMERA_INFO].append(arrival_ns)
        self._pictures.camera(camera)

    def message(self, topic: str, message: BagMessage) -> None:
        """Take a message that only the checks need; count it if it cannot be used."""
        try:
            if topic in PICTURES:
                self.picture(topic, message)
                return
            content: Any = self._cdr.deserialize(message.data, message.typename)
            if topic == CAMERA_INFO:
                self.camera(
                    self._given_camera or picture_messages.camera(content), message.log_time_ns
                )
            else:
                self.sample(topic, SAMPLES[topic](content), message.log_time_ns)
        except TirgeoError as error:
            self.refused(topic, str(error))

    def picture(self, topic: str, message: BagMessage, *, always: bool = False) -> None:
        """Take a picture; decode it only if the checks need its pixels, or ``always``."""
        stamp_ns, arrival_ns = header_stamp_ns(message.data), message.log_time_ns
        if always or self._pictures.wants_pixels(stamp_ns, arrival_ns):
            content = self._cdr.deserialize(message.data, message.typename)
            self.frame(topic, stamp_ns, picture_messages.pixels(topic, content), arrival_ns)
        else:
            self._passed(topic, stamp_ns, arrival_ns)

    @_guarded()
    def _passed(self, topic: str, stamp_ns: int, arrival_ns: int) -> None:
        self.arrivals_ns[topic].append(arrival_ns)
        self._pictures.passed(stamp_ns, arrival_ns)

    @_guarded()
    def frame(self, topic: str, stamp_ns: int, pixels: Any, arrival_ns: int) -> None:
        """Take a picture's pixels, without the map, and the stamp of its message."""
        self.arrivals_ns[topic].append(arrival_ns)
        self.picture_size = (pixels.shape[1], pixels.shape[0])
        self._pictures.frame(stamp_ns, pixels, arrival_ns)

    def refused(self, topic: str, reason: str) -> None:
        """Count a message of a topic that could not be used, with the reason."""
        self._refused[topic] += 1
        self._reasons[topic] = reason

    def findings(self) -> list[Finding]:
        """Return all findings, the worst first."""
        self.run_queued()
        findings = list(self.at_start)
        counts = {topic: len(arrivals) for topic, arrivals in self.arrivals_ns.items()}
        findings += lone_findings(self._streams)
        findings += unreadable_findings(counts, self._refused, self._reasons)
        for group in (self._navigation, self._gimbal, self._pictures, self._map):
            self._ask(group.findings, findings)
        if self.failed:
            kind, number = self.failed.most_common(1)[0]
            findings.append(finding("check_failed", kind=kind, number=number))
        return sorted_findings(nearest_causes(findings))

    @_guarded()
    def _ask(self, group: Callable[[], list[Finding]], findings: list[Finding]) -> None:
        findings += group()
