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
"""Flights as the checks get them, in order of arrival: recorded or simulated, right or planted.

The checks of the filter's inputs get samples alone (``recorded``, ``simulated``, ``checked``);
those of gimbal and pictures what filter and gimbal make of them too (``checked_flight``).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dev.flight_errors import NAVIGATION_SAMPLES
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import JointSample
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import pictures as picture_messages, sensed
from tirgeo_ros.io.messages.result_messages import Messages
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs
from tirgeo_ros.tools.replay.registration import SAMPLES, Registration
from tirgeo_ros.tools.simulate.flight import SimulatedFlight

_SEEN = ("thermal/camera_info", "thermal/image_raw/compressed")


class Arrived(NamedTuple):
    """A sample with its topic, and the time of its arrival.

    Of ``checked_flight`` also, in place of a topic: ``camera``, ``frame`` (stamp and pixels), and
    ``plane``, ``body`` and ``pose``, which were made of the sample before.
    """

    topic: str
    sample: Any
    arrival_ns: int


#: What a fault makes of a sample; None loses it.
Change = Callable[[Arrived], Arrived | None]


@dataclass(frozen=True)
class CheckedFlight:
    """What a flight gives to the checks, with its parameters."""

    configs: NodeConfigs
    events: tuple[Arrived, ...]


def read(path: Path, topics: Collection[str]) -> Iterator[Arrived]:
    """What came on topics of a bag."""
    cdr = Cdr()
    for message in BagReader(path).messages([f"/{topic}" for topic in topics]):
        topic = message.topic[1:]
        decoded = cdr.deserialize(message.data, message.typename)
        if topic in SAMPLES:
            yield Arrived(topic, SAMPLES[topic](decoded), message.log_time_ns)
        elif topic == "thermal/camera_info":
            yield Arrived("camera", picture_messages.camera(decoded), message.log_time_ns)
        else:
            frame = convert.stamp_ns(decoded), picture_messages.compressed_pixels(decoded)
            yield Arrived("frame", frame, message.log_time_ns)


def recorded(path: Path) -> list[Arrived]:
    """The filter's inputs of a bag."""
    return [item for item in read(path, SAMPLES) if isinstance(item.sample, NAVIGATION_SAMPLES)]


def simulated(flight: SimulatedFlight) -> list[Arrived]:
    """The filter's inputs of a simulated flight."""
    messages = Messages()
    return [
        Arrived(sensed(messages, sample)[0], sample, arrival_ns)
        for arrival_ns, sample in flight.samples
        if isinstance(sample, NAVIGATION_SAMPLES)
    ]


def checked(
    flight: Iterable[Arrived],
    config: EkfConfig,
    *changes: Change,
    given: Collection[str] | None = None,
) -> list[Finding]:
    """Return what the checks find at the end of a flight with these changes, one after another."""
    checks = NavigationChecks(config, given)
    for change in changes:
        flight = filter(None, map(change, flight))
    for arrived in flight:
        checks.take(*arrived)
    return checks.findings()


def lost(*topics: str) -> Change:
    """Return a fault: these topics, or all that begin so, never come."""
    return lambda arrived: None if arrived.topic.startswith(topics) else arrived


def changed(topics: str, **fields: Callable[[Any], Any]) -> Change:
    """Return a fault: fields of the samples of topics (in one text) are functions of themselves.

    Arrays come as copies, so that a function may write into them.
    """

    def change(arrived: Arrived) -> Arrived:
        if arrived.topic not in topics.split():
            return arrived
        sample = arrived.sample
        values = {}
        for name, function in fields.items():
            value = getattr(sample, name)
            values[name] = function(value.copy() if isinstance(value, np.ndarray) else value)
        return arrived._replace(sample=replace(sample, **values))

    return change


@functools.lru_cache(maxsize=4)
def checked_flight(folder: Path) -> CheckedFlight:
    """A simulated flight through the filter, with its frames."""
    configs = node_configs([folder / "params.yaml"])
    registration, events = Registration(configs.ekf, configs.gimbal), []
    for arrived in read(folder / "flight.mcap", (*SAMPLES, *_SEEN)):
        events.append(arrived)
        if arrived.topic in SAMPLES:
            made = _made(registration, arrived.sample)
            events += [Arrived(kind, what, arrived.arrival_ns) for kind, what in made]
    return CheckedFlight(configs, tuple(events))


def _made(registration: Registration, sample: Any) -> Iterator[tuple[str, Any]]:
    result = registration.take(sample)
    if result.body is not None:
        yield "plane", registration.navigation.plane
        yield "body", result.body
    for pose in result.cameras:
        yield "pose", pose


def picture_findings(
    flight: CheckedFlight,
    *,
    overlay: OverlayConfig | None = None,
    ground: Ground | None = None,
    lens: Callable[[Camera], Camera] = lambda camera: camera,
    each_second: bool = False,
) -> list[Finding]:
    """What the checks of the pictures find in a flight, with other parameters or another lens.

    ``each_second``: what they find at any second, else what they find at the end.
    """
    overlay = overlay or flight.configs.overlay
    checks = PictureChecks(overlay, overlay.ground_height_m if ground is None else ground, None)
    result, asked_ns = [], 0
    for kind, what, arrival_ns in flight.events:
        if each_second and arrival_ns - asked_ns >= 10**9:
            asked_ns = arrival_ns
            result += checks.findings()
        if kind == "camera":
            checks.camera(lens(what))
        elif kind == "frame":
            checks.frame(*what, arrival_ns)
        elif kind in ("plane", "pose"):
            getattr(checks, kind)(what)
    return [*result, *checks.findings()]


def recomposed(
    flight: CheckedFlight,
    change: Callable[[JointSample], JointSample],
    gimbal: GimbalConfig | None = None,
) -> CheckedFlight:
    """A flight with the camera poses of other joint angles, or of another gimbal's parameters."""
    composer = GimbalComposer(gimbal or flight.configs.gimbal)
    events: list[Arrived] = []
    for kind, what, arrival_ns in flight.events:
        if kind == "pose":
            continue
        sample = change(what) if kind == "gimbal/joint_states" else what
        events.append(Arrived(kind, sample, arrival_ns))
        if kind == "body" or isinstance(sample, JointSample):
            take = composer.add_body if kind == "body" else composer.add_joints
            poses = take(sample)
            events += [Arrived("pose", pose, arrival_ns) for pose in poses]
    return CheckedFlight(flight.configs, tuple(events))
