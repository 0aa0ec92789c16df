"""Check a recorded flight with the data that a command reads and computes anyway.

The checks change nothing of that data: they only return findings.
"""

from __future__ import annotations

import functools
import math
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.map_checks import MapChecks
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.checks.recording_checks import unreadable_findings
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.map_renderer import DrapedMap
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample, JointSample
from tirgeo_ros.tools.replay.check_setting import CheckSetting
from tirgeo_ros.tools.replay.registration import Registered, Sample

F = TypeVar("F", bound=Callable[..., None])


#: Number of calls that are run together. Work of one kind in a row uses the processor's caches
#: better.
_BLOCK = 128


def _later(method: F) -> F:
    """Return a method whose calls are queued and run in order, before any finding is read."""

    @functools.wraps(method)
    def call(self: FlightChecks, *arguments: Any) -> None:
        self._waiting.append((method, arguments))
        if len(self._waiting) >= _BLOCK:
            self.catch_up()

    return cast("F", call)


class CheckedSamples:
    """Count messages by topic, with their time span and the longest gap between two of them."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None  # of the newest picture: width, height
        self._topics: dict[str, list[int]] = {}  # number, first, newest, longest gap (ns)

    def message(self, topic: str, arrival_ns: int) -> None:
        """Count a message by its arrival (ns)."""
        entry = self._topics.get(topic)
        if entry is None:
            self._topics[topic] = [1, arrival_ns, arrival_ns, 0]
            return
        entry[0] += 1
        entry[3] = max(entry[3], arrival_ns - entry[2])
        entry[2] = arrival_ns

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        return {topic: entry[0] for topic, entry in self._topics.items()}

    @property
    def topics(self) -> dict[str, dict[str, float | None]]:
        """Return number, rate (Hz) and longest gap (s) of each topic."""
        return {
            topic: {
                "messages": number,
                "rate_hz": (number - 1) / ((last - first) * 1e-9) if last > first else None,
                "longest_gap_s": gap * 1e-9,
            }
            for topic, (number, first, last, gap) in sorted(self._topics.items())
        }


class FlightChecks:
    """Feed all groups of checks. For each sample call ``sample``, then ``registered``."""

    def __init__(self, setting: CheckSetting) -> None:
        self._waiting: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._seen = CheckedSamples()
        self._found = setting.found
        ground, given = setting.ground, setting.given
        self._navigation = NavigationChecks(setting.ekf, given)
        self._gimbal = GimbalChecks(setting.gimbal, given)
        self._pictures = PictureChecks(setting.overlay, ground, given)
        self._map = MapChecks(math.nan if ground is None else ground)
        self._arrivals = Arrivals()
        self._camera: Camera | None = None
        self._plane: TangentPlane | None = None
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._failed: Counter[str] = Counter()
        if setting.camera is not None:
            self.camera(setting.camera)

    @property
    def seen(self) -> CheckedSamples:
        """Return the counts of the checked messages."""
        self.catch_up()
        return self._seen

    def catch_up(self) -> None:
        """Run all queued calls."""
        waiting, self._waiting = self._waiting, []
        for method, arguments in waiting:
            self._guarded(method, arguments)

    def _guarded(self, method: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        """Run a check; count an exception as a fault of the check instead of raising it."""
        try:
            method(self, *arguments)
        except Exception as error:  # noqa: BLE001 nobody's flight is lost by a check
            self.failed(error)

    @_later
    def sample(self, topic: str, sample: Sample, arrival_ns: int) -> None:
        """Take a sample of a contract topic, with the original stamp of its message."""
        self._seen.message(topic, arrival_ns)
        if not isinstance(sample, JointSample | CameraAttitudeSample):
            self._navigation.take(topic, sample, arrival_ns)
        self._gimbal_sample(self._arrivals.stamped(topic, sample, arrival_ns))

    def _gimbal_sample(self, sample: Sample) -> None:
        if isinstance(sample, ImuSample):
            if sample.autopilot_q_nb is not None:
                self._gimbal.autopilot(sample.stamp_ns, sample.autopilot_q_nb)
        elif isinstance(sample, JointSample):
            self._gimbal.joints(sample)
        elif isinstance(sample, CameraAttitudeSample):
            self._gimbal.reported(sample)

    @_later
    def registered(self, found: Registered, plane: TangentPlane | None) -> None:
        """Take what filter and gimbal computed from a sample, and the poses' tangent plane."""
        if found.solution is not None:
            self._navigation.solution(found.solution)
        if plane is not None and plane is not self._plane:
            self._plane = plane
            self._pictures.plane(plane)
            self._map.plane(plane)
        if found.body is not None:
            self._gimbal.body(found.body)
            self._pictures.body(found.body)
        for pose in found.cameras:
            self._pictures.pose(pose)

    @_later
    def map(self, laid: DrapedMap) -> None:
        """Take the map as placed in the plane that was given before."""
        self._map.map(laid)

    @_later
    def camera(self, camera: Camera, arrival_ns: int | None = None) -> None:
        """Take a calibration; one without a time of arrival comes from a file."""
        if arrival_ns is not None:
            self._seen.message("thermal/camera_info", arrival_ns)
        if camera != self._camera:
            self._camera = camera
            self._pictures.camera(camera)

    def frame(self, topic: str, stamp_ns: int, pixels: Any, arrival_ns: int) -> None:
        """Take a picture with the stamp of its message.

        It is checked at once, because it may be drawn on later.
        """
        self._frame(topic, stamp_ns, pixels, arrival_ns)
        self.catch_up()

    def wants_pixels(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Return whether a picture is to be decoded; give the others to ``passed``."""
        return self._pictures.wants_pixels(stamp_ns, arrival_ns)

    @_later
    def passed(self, topic: str, stamp_ns: int, arrival_ns: int) -> None:
        """Take the stamp and arrival (ns) of a picture that was not decoded."""
        self._seen.message(topic, arrival_ns)
        self._pictures.passed(stamp_ns, arrival_ns)

    @_later
    def _frame(self, topic: str, stamp_ns: int, pixels: Any, arrival_ns: int) -> None:
        self._seen.message(topic, arrival_ns)
        self._seen.size = (pixels.shape[1], pixels.shape[0])
        self._pictures.frame(stamp_ns, pixels, arrival_ns)

    def refused(self, topic: str, reason: str) -> None:
        """Count a message of a topic that could not be used, with the reason."""
        self._refused[topic] += 1
        self._reasons[topic] = reason

    def findings(self) -> list[Finding]:
        """Return all findings, the worst first."""
        self.catch_up()
        found = [*self._found]
        found += unreadable_findings(self._seen.counts, self._refused, self._reasons)
        try:
            for group in (self._navigation, self._gimbal, self._pictures, self._map):
                found += group.findings()
        except Exception as error:  # noqa: BLE001 as above
            self.failed(error)
        return sorted_findings([*found, *self._failures()])

    def failed(self, error: Exception) -> None:
        """Count a fault of a check."""
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        self._failed[f"{type(error).__name__}: {error} ({where})"] += 1

    def _failures(self) -> list[Finding]:
        if not self._failed:
            return []
        kind, number = self._failed.most_common(1)[0]
        evidence = f"a check failed {number} times: {kind}"
        mend = "report it with this flight; other findings stand"
        return [Finding("check_failed", Severity.CAUTION, evidence, "tirgeo itself", mend)]
