"""Compute body and camera poses from sensor samples, with the core objects of the nodes.

This is what ``ekf_node`` and ``gimbal_node`` do in a graph, without messages between them. With
``--smooth`` a first pass through a flight records the filter, which is then smoothed backwards in
time, and the second pass has the smoothed poses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    SmoothedNavigation,
    SmoothedRun,
)
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    ImuSample,
    JointSample,
    NavigationInput,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.io import messages as convert

Sample = NavigationInput | JointSample | CameraAttitudeSample

#: Topic -> the function that converts its messages to samples.
SAMPLES: Mapping[str, Callable[[Any], Sample]] = convert.SENSED_SAMPLES
FILTERS = ("ekf", "ekf_heading")


class Registered(NamedTuple):
    """Hold what one sample made the filter and the gimbal output."""

    solution: NavSolution | None = None
    body: BodyPose | None = None
    cameras: Sequence[CameraPose] = ()
    plane: TangentPlane | None = None  # of the poses


class Registration:
    """Feed the filter and the gimbal composition with samples in order of arrival.

    With ``smoothed`` runs of the same samples the poses are those.
    """

    def __init__(
        self, ekf: EkfConfig, gimbal: GimbalConfig, smoothed: Sequence[SmoothedRun] | None = None
    ) -> None:
        self.navigation = (
            Navigation(ekf) if smoothed is None else SmoothedNavigation(ekf, smoothed)
        )
        self.composer = GimbalComposer(gimbal)

    def take(self, sample: Sample) -> Registered:
        """Process a sample in the objects that use it; return their outputs."""
        solution = navigated(self.navigation, sample)
        plane = self.navigation.plane
        if solution is None or plane is None:
            return Registered(cameras=composed(self.composer, sample, None), plane=plane)
        body = plane.body_pose(solution)
        return Registered(solution, body, composed(self.composer, sample, body), plane)


def navigated(navigation: Navigation, sample: Sample) -> NavSolution | None:
    """Return the filter's solution for a sample, or None; gimbal samples are ignored."""
    if isinstance(sample, (JointSample, CameraAttitudeSample)):
        return None
    return navigation.process(sample).solution


def composed(composer: GimbalComposer, sample: Sample, body: BodyPose | None) -> list[CameraPose]:
    """Return camera poses from a sample and the body pose that the filter published for it."""
    if isinstance(sample, JointSample):
        return composer.add_joints(sample)
    if isinstance(sample, CameraAttitudeSample):
        return composer.add_attitude(sample)
    cameras = []
    if isinstance(sample, ImuSample) and sample.autopilot_q_nb is not None:
        cameras = composer.add_autopilot(sample.stamp_ns, sample.autopilot_q_nb)
    return cameras if body is None else cameras + composer.add_body(body)


def can_smooth(method: str) -> bool:
    """Return whether a method's poses come from a filter."""
    return method in FILTERS
