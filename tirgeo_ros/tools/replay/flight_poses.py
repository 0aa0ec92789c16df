"""Read a recorded flight once, and compute camera poses with the nodes' core objects."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from itertools import islice
from typing import Any, Protocol

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.checks.input_checks import size_fault
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.navigation.smoothing.backward_pass import SmoothedRun
from tirgeo_ros.core.streams.arrivals import Arrivals
from tirgeo_ros.core.types.errors import BagError, CameraError, TirgeoError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import Verdict
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import (
    CAMERA_INFO,
    PICTURES,
    checked_topics,
    inputs_of,
    resolved,
)
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Registration, Sample
from tirgeo_ros.tools.replay.smoothed_flight import FilterRecording, FlightFilter, passes

_TRIED = 10  # pictures to try for their size, as the first ones may be damaged
WHOLE_FLIGHT_S = 1e9
#: Poses this near an instant are kept: more than the longest gap that is interpolated across.
_NEAR_NS = 1_000_000_000
#: The camera's motion is measured from this much before an instant to this much after it.
_MOTION_NS = 50_000_000


class Watcher(Protocol):
    """Define an object that observes what a registration computes from a flight."""

    def heard(self, verdict: Verdict) -> None:
        """Take a verdict on the sample of the next ``took``, or on one held back until it."""

    def took(self, sample: Sample, found: Registered) -> None:
        """Take a sample and what was computed from it."""


class RecordedFlight:
    """Decode a bag once, for any number of takers.

    ``read`` counts the messages that were decoded, ``refused`` those that could not be used. With
    ``pictures``, ``picture_stamps_ns`` holds the stamps of the pictures. A given ``camera``
    overrides the bag's; ``needs_camera``: one of them must be there. ``checks`` get all inputs,
    and of the pictures those that they want, or ``all_pixels``.
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
        self.read = self.refused = 0
        self.picture_stamps_ns: list[int] = []
        self._reader, self._namespace = reader, namespace
        self._pictures, self._all_pixels = pictures, all_pixels
        self._given_camera = self._camera = camera
        self._needs_camera = needs_camera
        self._checks = checks
        self._takers: defaultdict[str, list[Callable[[Sample], None]]] = defaultdict(list)
        self._to_smooth: list[FlightPoses] = []
        self._arrivals = Arrivals()
        self._cdr = Cdr()

    @property
    def camera(self) -> Camera:
        """Return the camera, once the flight was read.

        Raise BagError without a usable calibration, and CameraError for one of another size than
        the bag's pictures.
        """
        if self._camera is None:
            raise BagError(f"{self._reader.path}: no {CAMERA_INFO} could be used")
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
                try:
                    pixels = convert.pixels(topic, self._decoded(message))
                except TirgeoError:
                    continue
                return pixels.shape[1], pixels.shape[0]
        return None

    def _decoded(self, message: BagMessage) -> Any:
        return self._cdr.deserialize(message.data, message.typename, message.topic)

    def registered(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        instants_ns: Sequence[int],
        watcher: Watcher | None = None,
        *,
        baseline_step_rad: float = 0.0,
        smooth: bool = False,
    ) -> FlightPoses:
        """Add a registration, which takes the samples, and return it.

        Raise BagError if a needed topic is absent. ``baseline_step_rad``: use the headings that
        the aircraft would have measured with its antenna baseline turned by this angle, clockwise
        from above. ``smooth``: each pose from all measurements, also later ones.
        """
        topics = inputs_of(
            self._reader, ekf.method, gimbal.composition, self._namespace, pictures=False
        )
        poses = FlightPoses(ekf, gimbal, instants_ns, topics.values(), watcher, baseline_step_rad)
        self.add(poses.topics, poses.take)
        if smooth:
            self._to_smooth.append(poses)
        return poses

    def add(self, topics: Collection[str], take: Callable[[Sample], None]) -> None:
        """Pass the samples of contract topics to ``take``, in order of arrival."""
        for topic in topics:
            self._takers[topic].append(take)

    def has(self, topic: str) -> bool:
        """Return whether the bag has a contract topic with its type."""
        name = resolved(topic, self._namespace)
        return self._reader.topics().get(name) == TOPIC_TYPES[topic]

    def read_all(self, progress: Report) -> None:
        """Pass the flight to all takers; call ``progress`` with seconds of the flight.

        Raise BagError if no topic has the camera's calibration. What is to be smoothed is
        recorded in a pass of its own before.
        """
        if self._needs_camera and self._given_camera is None and not self.has(CAMERA_INFO):
            hint = "" if self._namespace else "; is there a --namespace?"
            name = resolved(CAMERA_INFO, self._namespace)
            raise BagError(f"{self._reader.path}: needed topic absent: {name}{hint}")
        if self._to_smooth:
            first, progress = passes(progress)
            runs = smoothed_runs(
                self._reader, self._namespace, [one.filter for one in self._to_smooth], first
            )
            for poses, smoothed in zip(self._to_smooth, runs, strict=True):
                poses.smooth(smoothed)
        wanted = [CAMERA_INFO, *self._takers, *(PICTURES if self._pictures else ())]
        topics = {resolved(name, self._namespace): name for name in wanted if self.has(name)}
        checked = {}
        if self._checks is not None:
            checked = checked_topics(self._reader, self._namespace, topics)
        first_ns, last_ns = self._reader.span_ns
        for message in self._reader.messages({*topics, *checked}):
            progress((message.log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
            if self._checks is not None and message.topic in checked:
                self._checks.message(checked[message.topic], message)
                continue
            try:
                self._take(topics[message.topic], message)
            except TirgeoError as error:
                self.refused += 1
                if self._checks is not None:
                    self._checks.refused(topics[message.topic], str(error))

    def _take(self, topic: str, message: BagMessage) -> None:
        if topic in PICTURES:
            self._take_picture(topic, message)
            return
        decoded, checks, arrival_ns = self._decoded(message), self._checks, message.log_time_ns
        self.read += 1
        if topic == CAMERA_INFO:
            self._camera = self._given_camera or convert.camera(decoded)
            if checks is not None:
                checks.camera(self._camera, arrival_ns)
            return
        sample = SAMPLES[topic](decoded)
        if checks is not None:
            checks.sample(topic, sample, arrival_ns)
        sample = self._arrivals.stamped(topic, sample, arrival_ns)
        for take in self._takers[topic]:
            take(sample)

    def _take_picture(self, topic: str, message: BagMessage) -> None:
        """Note a picture's stamp, and pass it to the checks."""
        self.picture_stamps_ns.append(header_stamp_ns(message.data))
        if self._checks is not None:
            self._checks.picture(topic, message, always=self._all_pixels)


class FlightPoses:
    """Hold the poses of one registration around some instants (ns), all in one tangent plane."""

    def __init__(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        instants_ns: Sequence[int],
        topics: Collection[str],
        watcher: Watcher | None = None,
        baseline_step_rad: float = 0.0,
    ) -> None:
        self.topics = topics
        self.checks: FlightChecks | None = None
        self.filter = FlightFilter(ekf, baseline_step_rad)
        self._gimbal = gimbal
        self.cameras: PoseBuffer[CameraPose] = PoseBuffer(WHOLE_FLIGHT_S)
        self._watcher = watcher
        self.smooth(None)
        self._instants_ns = sorted(instants_ns)

    @property
    def plane(self) -> TangentPlane | None:
        """Return the tangent plane of the poses; None before there is one."""
        return self.registration.navigation.plane

    def smooth(self, runs: Sequence[SmoothedRun] | None) -> None:
        """Begin the registration, with the poses of smoothed runs if they are given."""
        heard = self._watcher.heard if self._watcher else None
        self.registration = Registration(self.filter.ekf, self._gimbal, heard, runs)

    def take(self, sample: Sample) -> None:
        """Process a sample in filter and gimbal, and keep the camera poses near the instants."""
        sample = self.filter.given(sample)
        found = self.registration.take(sample)
        for pose in found.cameras:
            after = bisect_left(self._instants_ns, pose.stamp_ns - _NEAR_NS)
            nearest = self._instants_ns[after : after + 1]
            if nearest and nearest[0] <= pose.stamp_ns + _NEAR_NS:
                self.cameras.add(pose)
        if self._watcher is not None:
            self._watcher.took(sample, found)
        if self.checks is not None:
            self.checks.registered(found, self.plane)

    def at(self, stamp_ns: int) -> tuple[CameraPose, CameraRates | None] | None:
        """Return the pose at one of the instants and the camera's motion there, or None."""
        return pose_at(self.cameras, stamp_ns)


def smoothed_runs(
    reader: BagReader, namespace: str, filters: Sequence[FlightFilter], progress: Report
) -> list[list[SmoothedRun]]:
    """Record filters in one pass through a bag; return the smoothed runs of each.

    Filters that are the same object are run once. Raise ConfigError for a method without a filter.
    """
    first = RecordedFlight(reader, namespace, needs_camera=False)
    keys = [(id(one.ekf), one.baseline_step_rad) for one in filters]
    recordings: dict[tuple[int, float], FilterRecording] = {}
    for key, one in zip(keys, filters, strict=True):
        if key not in recordings:
            recordings[key] = FilterRecording(one)
            first.add(one.topics, recordings[key].take)
    first.read_all(progress)
    runs = {key: recording.smoothed() for key, recording in recordings.items()}
    return [runs[key] for key in keys]


def pose_at(
    poses: PoseBuffer[CameraPose], stamp_ns: int
) -> tuple[CameraPose, CameraRates | None] | None:
    """Return the pose at an instant (ns) and the camera's motion there, or None if unknown."""
    pose = poses.at(stamp_ns)
    if not isinstance(pose, CameraPose):
        return None
    around = [poses.at(stamp_ns + step) for step in (-_MOTION_NS, 0, _MOTION_NS)]
    known = [one for one in around if isinstance(one, CameraPose)]
    return pose, CameraRates.between(known[0], known[-1]) if len(known) > 1 else None
