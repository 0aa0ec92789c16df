"""Recorded flights as the checks get them: samples, poses and frames, in order of arrival."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.checks.finding import Finding
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.config import GimbalConfig, OverlayConfig
from tirgeo_ros.core.gimbal import GimbalComposer
from tirgeo_ros.core.locating import Ground
from tirgeo_ros.core.samples import JointSample
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bag import BagReader, Cdr
from tirgeo_ros.tools.node_configs import NodeConfigs, node_configs
from tirgeo_ros.tools.registration import SAMPLES, Registration

Event = tuple[str, Any, int]  # kind, what came, when (ns)


@dataclass(frozen=True)
class CheckedFlight:
    """What a flight gives to the checks, with its parameters."""

    configs: NodeConfigs
    events: tuple[Event, ...]


@functools.lru_cache(maxsize=4)
def checked_flight(folder: Path) -> CheckedFlight:
    """A simulated flight through the filter, with its frames."""
    configs = node_configs([folder / "params.yaml"])
    registration = Registration(configs.ekf, configs.gimbal)
    cdr, events = Cdr(), []
    for message in BagReader(folder / "flight.mcap").messages():
        topic = message.topic.lstrip("/")
        decoded = cdr.deserialize(message.data, message.typename)
        made = (
            _sampled(registration, topic, decoded) if topic in SAMPLES else _seen(topic, decoded)
        )
        events += [(kind, what, message.log_time_ns) for kind, what in made]
    return CheckedFlight(configs, tuple(events))


def _sampled(registration: Registration, topic: str, message: Any) -> Iterator[tuple[str, Any]]:
    sample = SAMPLES[topic](message)
    found = registration.take(sample)
    yield topic, sample
    if found.body is not None:
        yield "plane", registration.navigation.plane
        yield "body", found.body
    for pose in found.cameras:
        yield "pose", pose


def _seen(topic: str, message: Any) -> Iterator[tuple[str, Any]]:
    if topic == "thermal/camera_info":
        yield "camera", convert.camera(message)
    elif topic == "thermal/image_raw/compressed":
        yield "frame", (convert.stamp_ns(message), convert.compressed_pixels(message))


def picture_findings(
    flight: CheckedFlight,
    *,
    overlay: OverlayConfig | None = None,
    ground: Ground | None = None,
    lens: Callable[[Camera], Camera] = lambda camera: camera,
    bodies: bool = False,
) -> list[Finding]:
    """What the checks of the pictures find in a flight, with other parameters or another lens."""
    overlay = overlay or flight.configs.overlay
    checks = PictureChecks(overlay, overlay.ground_height_m if ground is None else ground, None)
    for kind, what, arrival_ns in flight.events:
        if kind == "camera":
            checks.camera(lens(what))
        elif kind == "frame":
            checks.frame(*what, arrival_ns)
        elif kind in ("plane", "pose") or (kind == "body" and bodies):
            getattr(checks, kind)(what)
    return checks.findings()


def recomposed(
    flight: CheckedFlight,
    change: Callable[[JointSample], JointSample],
    gimbal: GimbalConfig | None = None,
) -> CheckedFlight:
    """A flight with the camera poses of other joint angles, or of another gimbal's parameters."""
    composer = GimbalComposer(gimbal or flight.configs.gimbal)
    events: list[Event] = []
    for kind, what, arrival_ns in flight.events:
        if kind == "pose":
            continue
        sample = change(what) if kind == "gimbal/joint_states" else what
        events.append((kind, sample, arrival_ns))
        if kind == "body" or isinstance(sample, JointSample):
            take = composer.add_body if kind == "body" else composer.add_joints
            poses = take(sample)
            events += [("pose", pose, arrival_ns) for pose in poses]
    return CheckedFlight(flight.configs, tuple(events))
