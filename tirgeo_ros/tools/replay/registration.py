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
"""Choose the topics that a run reads from a bag, and compute poses from their samples.

The core objects of ``ekf_node`` and ``gimbal_node`` compute the poses, without messages between.
With ``--smooth`` a first pass through a flight records the filter, which is then smoothed
backwards in time; the second pass has the smoothed poses.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.adjustment.adjustment import Adjustment
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.navigation.aiding.fusion import METHOD_SOURCES
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import (
    SmoothedNavigation,
    SmoothedRun,
)
from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    ImuSample,
    JointSample,
    NavigationInput,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, SENSED_SAMPLES, SENSED_TOPICS, TOPIC_TYPES
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES, resolved

#: Method -> the topics that it uses.
METHOD_TOPICS: Mapping[str, tuple[str, ...]] = {
    method: tuple(NAVIGATION_INPUTS[source][0] for source in sources)
    for method, sources in METHOD_SOURCES.items()
}
#: Topics that sensors publish; in another system they may have other names.
INPUTS = (*SENSED_TOPICS, *PICTURES, CAMERA_INFO)
#: Composition of the camera's pose -> the gimbal's topics that it uses; one of them is enough.
GIMBAL_TOPICS: dict[str, tuple[str, ...]] = {
    "paper": ("gimbal/attitude",),
    "encoders": ("gimbal/joint_states",),
    "auto": ("gimbal/joint_states", "gimbal/attitude"),
}
_POSITIONS = ("rtk/fix", "gps/fix")
#: Topics that the default method uses in addition to ordinary GPS.
_RTK_TOPICS = ("rtk/fix", "rtk/vel", "rtk/heading")

Sample = NavigationInput | JointSample | CameraAttitudeSample

#: Topic -> the function that converts its messages to samples.
SAMPLES: Mapping[str, Callable[[Any], Sample]] = SENSED_SAMPLES
#: Methods whose poses come from a filter, and can be smoothed.
FILTERS = ("ekf", "ekf_heading")


class Registered(NamedTuple):
    """Hold the outputs of filter and gimbal for one sample."""

    solution: NavSolution | None = None
    body: BodyPose | None = None
    cameras: Sequence[CameraPose] = ()
    plane: TangentPlane | None = None  # tangent plane of the poses


class Registration:
    """Feed the filter and the gimbal composition with samples in order of arrival.

    The poses are those of ``smoothed`` runs of the same samples, if given, and the camera's are
    corrected by an ``adjustment``.
    """

    def __init__(
        self,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        smoothed: Sequence[SmoothedRun] | None = None,
        adjustment: Adjustment | None = None,
    ) -> None:
        self.navigation = (
            Navigation(ekf) if smoothed is None else SmoothedNavigation(ekf, smoothed)
        )
        self.composer = GimbalComposer(gimbal)
        self._adjustment = adjustment

    def take(self, sample: Sample) -> Registered:
        """Process a sample in the objects that use it; return their outputs."""
        solution = navigated(self.navigation, sample)
        plane = self.navigation.plane
        if solution is None or plane is None:
            return Registered(cameras=self._cameras(sample, None), plane=plane)
        body = plane.body_pose(solution)
        return Registered(solution, body, self._cameras(sample, body), plane)

    def _cameras(self, sample: Sample, body: BodyPose | None) -> list[CameraPose]:
        cameras = composed(self.composer, sample, body)
        if self._adjustment is None:
            return cameras
        return [self._adjustment.corrected(camera) for camera in cameras]


def biases_of(navigation: Navigation) -> dict[str, list[float]]:
    """Return the IMU's biases and their sigmas (3,), forward, left, up; {} without a filter."""
    biases = navigation.biases
    if biases is None:
        return {}
    gyro, accel = flu_from_frd(biases.vector.reshape(2, 3)).tolist()
    gyro_sigma, accel_sigma = np.sqrt(biases.covariance.diagonal()).reshape(2, 3).tolist()
    return {
        "gyro_bias_rad_s": gyro,
        "gyro_bias_sigma_rad_s": gyro_sigma,
        "accel_bias_m_s2": accel,
        "accel_bias_sigma_m_s2": accel_sigma,
    }


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


def topics_absent(
    reader: BagReader, absent: Iterable[Sequence[str]], namespace: str, hint: str = ""
) -> BagError:
    """Return the error of a bag without needed topics; of those named together, one is enough."""
    names = [" or ".join(resolved(topic, namespace) for topic in topics) for topics in absent]
    if not hint and not namespace:
        hint = "; give --namespace if the topics have one"
    return BagError(f"{reader.path}: needed topic absent: {', '.join(names)}{hint}")


def picture_topic(reader: BagReader, namespace: str) -> tuple[str, str]:
    """Return contract topic and name of a bag's pictures, raw if it can be. Raise BagError."""
    for topic in PICTURES:
        name = resolved(topic, namespace)
        if reader.topics().get(name) == TOPIC_TYPES[topic]:
            return topic, name
    raise topics_absent(reader, [PICTURES], namespace)


def inputs_of(
    reader: BagReader,
    method: str,
    composition: str,
    namespace: str,
    *,
    pictures: bool,
    camera: bool = True,
    gimbal: bool = True,
) -> dict[str, str]:
    """Return the topics that a run reads from a bag: resolved name -> contract topic.

    With ``pictures`` the camera's calibration is read too, unless ``camera`` is False. Without
    ``gimbal`` the gimbal's angles are not needed, but read if the bag has them. Raise BagError
    naming every needed topic that is absent, or a topic that has another type.
    """
    present = reader.topics()
    available = {topic for topic in TOPIC_TYPES if resolved(topic, namespace) in present}
    wanted = [*METHOD_TOPICS[method], *GIMBAL_TOPICS[composition]]
    positions = tuple(name for name in METHOD_TOPICS[method] if name in _POSITIONS)
    needed = [("imu/data",), positions, *([GIMBAL_TOPICS[composition]] if gimbal else ())]
    if pictures:
        needed += [PICTURES, *([(CAMERA_INFO,)] if camera else ())]
        wanted += ["tirgeo/locate/pixel", *([CAMERA_INFO] if camera else ())]
        wanted += [name for name in PICTURES if name in available][:1]
    absent = [names for names in needed if not available.intersection(names)]
    if absent:
        is_gimbal = absent == [GIMBAL_TOPICS[composition]]
        hint = "; without it, tirgeo process --no-images gives the body's poses"
        raise topics_absent(reader, absent, namespace, hint if is_gimbal else "")
    topics = {resolved(name, namespace): name for name in wanted if name in available}
    for topic, name in topics.items():
        if present[topic] != TOPIC_TYPES[name]:
            raise BagError(
                f"{reader.path}: {topic} is of type {present[topic] or 'nothing'}, "
                f"not {TOPIC_TYPES[name]}"
            )
    return topics


def checked_topics(reader: BagReader, namespace: str, used: Mapping[str, str]) -> dict[str, str]:
    """Return the inputs that a bag has and a run does not use: resolved -> contract topic.

    They are for the checks; if two topics have pictures, only one of them is checked.
    """
    present = reader.topics()
    available = {
        resolved(name, namespace): name
        for name in (*SENSED_TOPICS, CAMERA_INFO, *PICTURES)
        if present.get(resolved(name, namespace)) == TOPIC_TYPES[name]
    }
    pictures = [topic for topic, name in available.items() if name in PICTURES]
    spare = pictures if set(PICTURES).intersection(used.values()) else pictures[1:]
    return {topic: name for topic, name in available.items() if topic not in {*used, *spare}}


def fitting_method(present: Collection[str], namespace: str) -> tuple[str, str]:
    """Return the method for a bag's topics, and why it is not the default ("" if it is).

    Without headings the method is ``ekf``, on ordinary GPS if there is no RTK.
    """
    lacking = [name for name in _RTK_TOPICS if resolved(name, namespace) not in present]
    if "rtk/heading" not in lacking:
        return "ekf_heading", ""
    alone = lacking == list(_RTK_TOPICS) and resolved("gps/fix", namespace) in present
    names = ", ".join(resolved(name, namespace) for name in (lacking if alone else lacking[-1:]))
    on_gps = "; the filter uses ordinary GPS" if alone else ""
    return "ekf", f"method ekf: the bag has no {names}{on_gps}"


def has_rates(reader: BagReader, namespace: str) -> bool:
    """Return whether the first message of a bag's imu/data has more than an attitude.

    True without a message that can be read.
    """
    name, typename = resolved("imu/data", namespace), TOPIC_TYPES["imu/data"]
    if reader.topics().get(name) == typename:
        for message in islice(reader.messages([name]), 1):
            with suppress(MessageError):
                sample = SAMPLES["imu/data"](Cdr().deserialize(message.data, typename))
                return not (isinstance(sample, ImuSample) and sample.is_attitude_alone)
    return True


def without_rates(reader: BagReader, namespace: str, given: Collection[str]) -> dict[str, Any]:
    """Return the parameters for a bag whose imu/data has no rates, but for those that are given.

    Attitudes, gimbal and pictures of such a bag come from one file: their stamps are the same, and
    may be too rare for joints to become steady. Empty for any other bag.
    """
    if has_rates(reader, namespace):
        return {}
    present = reader.topics()
    on_rtk = resolved("rtk/fix", namespace) in present
    values: dict[str, Any] = {"method": "rtk" if on_rtk else "raw", "video_latency_s": 0.0}
    gimbal = [name for name in GIMBAL_TOPICS["auto"] if resolved(name, namespace) in present]
    if gimbal == [*GIMBAL_TOPICS["encoders"]]:
        values["composition"] = "encoders"
    return {name: value for name, value in values.items() if name not in given}


def done_without(present: Collection[str], method: str, namespace: str) -> str:
    """Return the names in a bag of the topics that a method uses but that are not present.

    Ordinary GPS is the filter's fallback and the barometer is optional, so neither is returned,
    except for the method ``raw``.
    """
    return ", ".join(
        resolved(name, namespace)
        for name in METHOD_TOPICS[method]
        if name not in present and (method == "raw" or name in _RTK_TOPICS)
    )
