"""Compute body and camera poses from sensor samples, with the core objects of the nodes.

This is what ``ekf_node`` and ``gimbal_node`` do in a graph, without messages between them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.backward_pass import SmoothedRun
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import SmoothedNavigation
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    ImuSample,
    JointSample,
    NavigationInput,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.core.types.verdicts import Verdict
from tirgeo_ros.io import messages as convert

Sample = NavigationInput | JointSample | CameraAttitudeSample

#: Topic -> the function that converts its messages to samples.
SAMPLES: Mapping[str, Callable[[Any], Sample]] = convert.SENSED_SAMPLES


class Registered(NamedTuple):
    """Hold what one sample made the filter and the gimbal output."""

    solution: NavSolution | None = None
    body: BodyPose | None = None
    cameras: Sequence[CameraPose] = ()


class Registration:
    """Feed the filter and the gimbal composition with samples in order of arrival.

    ``heard`` is called with the filter's verdicts, as in ``Navigation``. With ``smoothed`` runs of
    the same samples the poses are those.
    """

    def __init__(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        heard: Callable[[Verdict], None] | None = None,
        smoothed: Sequence[SmoothedRun] | None = None,
    ) -> None:
        self.navigation = (
            Navigation(ekf, heard)
            if smoothed is None
            else SmoothedNavigation(ekf, smoothed, heard)
        )
        self.composer = GimbalComposer(gimbal)

    def take(self, sample: Sample) -> Registered:
        """Process a sample in the objects that use it; return their outputs."""
        solution = navigated(self.navigation, sample)
        plane = self.navigation.plane
        if solution is None or plane is None:
            return Registered(cameras=composed(self.composer, sample, None))
        body = plane.body_pose(solution)
        return Registered(solution, body, composed(self.composer, sample, body))


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
