"""The checks of a recorded flight, fed with what a command reads and makes anyway.

They change nothing of it: what goes in is looked at, and nothing comes back but findings.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from tirgeo_ros.core.arrival import Arrivals
from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.checks.finding import Finding, sorted_findings
from tirgeo_ros.core.checks.recording_checks import unreadable_findings
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_drawing import LaidMap
from tirgeo_ros.core.samples import CameraAttitudeSample, ImuSample, JointSample
from tirgeo_ros.tools.checks.groups import groups_of
from tirgeo_ros.tools.checks.seen import Seen
from tirgeo_ros.tools.checks.setting import CheckSetting
from tirgeo_ros.tools.registration import Registered, Sample


class FlightChecks:
    """Feeds all groups of checks. Take a sample, then what it made possible."""

    def __init__(self, setting: CheckSetting) -> None:
        self.seen = Seen()
        self._setting = setting
        self._groups = groups_of(setting)
        self._arrivals = Arrivals()
        self._camera: Camera | None = None
        self._plane: TangentPlane | None = None
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        if setting.camera is not None:
            self.camera(setting.camera)

    def sample(self, topic: str, sample: Sample, arrival_ns: int) -> None:
        """Take a sample of a contract topic, its stamp as its message has it."""
        self.seen.message(topic, arrival_ns)
        if not isinstance(sample, JointSample | CameraAttitudeSample):
            self._groups.navigation.take(topic, sample, arrival_ns)
        self._gimbal(self._arrivals.stamped(topic, sample, arrival_ns))

    def _gimbal(self, sample: Sample) -> None:
        if isinstance(sample, ImuSample):
            if sample.autopilot_q_nb is not None:
                self._groups.gimbal.autopilot(sample.stamp_ns, sample.autopilot_q_nb)
        elif isinstance(sample, JointSample):
            self._groups.gimbal.joints(sample)
        elif isinstance(sample, CameraAttitudeSample):
            self._groups.gimbal.reported(sample)

    def registered(self, found: Registered, plane: TangentPlane | None) -> None:
        """Take what filter and gimbal made of a sample, and the plane of the poses."""
        if found.solution is not None:
            self._groups.navigation.solution(found.solution)
        if plane is not None and plane is not self._plane:
            self._plane = plane
            self._groups.pictures.plane(plane)
            self._groups.map.plane(plane)
        if found.body is not None:
            self._groups.gimbal.body(found.body)
            self._groups.pictures.body(found.body)
        for pose in found.cameras:
            self._groups.pictures.pose(pose)

    def map(self, laid: LaidMap) -> None:
        """Take the map as it lies in the plane that was taken before."""
        self._groups.map.map(laid)

    def camera(self, camera: Camera, arrival_ns: int | None = None) -> None:
        """Take a calibration; without a time of arrival, one from a file."""
        if arrival_ns is not None:
            self.seen.message("thermal/camera_info", arrival_ns)
        if camera != self._camera:
            self._camera = camera
            self._groups.pictures.camera(camera)

    def frame(self, topic: str, stamp_ns: int, pixels: Any, arrival_ns: int) -> None:
        """Take a picture with the stamp of its message."""
        self.seen.message(topic, arrival_ns)
        self.seen.size = (pixels.shape[1], pixels.shape[0])
        self._groups.pictures.frame(stamp_ns, pixels, arrival_ns)

    def refused(self, topic: str, reason: str) -> None:
        """Take that a message of a topic could not be used, and why."""
        self._refused[topic] += 1
        self._reasons[topic] = reason

    def findings(self) -> list[Finding]:
        """Return what is wrong, the worst first."""
        unreadable = unreadable_findings(self.seen.counts, self._refused, self._reasons)
        return sorted_findings([*self._setting.found, *unreadable, *self._groups.findings()])
