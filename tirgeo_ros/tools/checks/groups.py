"""The groups of checks that a flight is taken through, each behind what is asked of it here."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.checks.finding import Finding
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.samples import (
    Array,
    BodyPose,
    CameraAttitudeSample,
    CameraPose,
    JointSample,
    NavigationInput,
    NavSolution,
)
from tirgeo_ros.tools.checks.setting import CheckSetting


class NavigationGroup(Protocol):
    """Checks of the filter's sensors."""

    def take(self, topic: str, sample: NavigationInput, arrival_ns: int) -> None:
        """Take a sample as its message has it: a stamp of 0 is 0."""

    def solution(self, s: NavSolution) -> None:
        """Take what the filter made."""

    def findings(self) -> Sequence[Finding]:
        """Return what was found."""


class GimbalGroup(Protocol):
    """Checks of the gimbal against the airframe."""

    def joints(self, sample: JointSample) -> None:
        """Take encoder angles."""

    def reported(self, sample: CameraAttitudeSample) -> None:
        """Take the attitude that the flight controller reports of the camera."""

    def autopilot(self, stamp_ns: int, q_nb: Array) -> None:
        """Take the autopilot's own attitude."""

    def body(self, pose: BodyPose) -> None:
        """Take the filter's pose."""

    def findings(self) -> Sequence[Finding]:
        """Return what was found."""


class PictureGroup(Protocol):
    """Checks of camera, pictures and ground."""

    def camera(self, camera: Camera) -> None:
        """Take a calibration."""

    def frame(self, stamp_ns: int, pixels: Any, arrival_ns: int) -> None:
        """Take a picture with the stamp of its message."""

    def pose(self, pose: CameraPose) -> None:
        """Take a pose of the camera."""

    def body(self, pose: BodyPose) -> None:
        """Take a pose of the body."""

    def plane(self, plane: TangentPlane) -> None:
        """Take the plane of the poses."""

    def findings(self) -> Sequence[Finding]:
        """Return what was found."""


class Groups:
    """All groups, made for a setting."""

    def __init__(self, setting: CheckSetting) -> None:
        one = setting
        self.navigation: NavigationGroup = _made(NAVIGATION, one.ekf, one.given)
        self.gimbal: GimbalGroup = _made(GIMBAL, one.gimbal, one.given)
        self.pictures: PictureGroup = _made(PICTURES, one.overlay, one.ground, one.given)

    def findings(self) -> list[Finding]:
        """Return what all of them found."""
        groups = (self.navigation, self.gimbal, self.pictures)
        return [finding for group in groups for finding in group.findings()]


#: Module of ``core.checks`` and class of each group.
NAVIGATION = ("navigation_checks", "NavigationChecks")
GIMBAL = ("gimbal_checks", "GimbalChecks")
PICTURES = ("picture_checks", "PictureChecks")


def _made(group: tuple[str, str], *arguments: object) -> Any:
    """Return a group; one that takes all and finds nothing while its module is not there."""
    module, name = group
    try:
        found = importlib.import_module(f"tirgeo_ros.core.checks.{module}")
    except ModuleNotFoundError:
        return _Absent()
    return getattr(found, name)(*arguments)


class _Absent:
    def __getattr__(self, _name: str) -> Callable[..., Sequence[Finding]]:
        return lambda *_: ()
