"""Collect what the checks of a flight know before it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.parameter_checks import parameter_findings
from tirgeo_ros.core.checks.recording_checks import RecordedTopics, recording_findings
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import SENSED_TOPICS, TOPIC_TYPES
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile
from tirgeo_ros.tools.replay.flight_topics import PICTURES
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

CAMERA_INFO = "thermal/camera_info"
#: The topics that are checked.
INPUTS = (*SENSED_TOPICS, *PICTURES, CAMERA_INFO)


@dataclass(frozen=True)
class CheckSetting:
    """Hold parameters, ground and map, and the findings that need no look into the flight."""

    ekf: EkfConfig
    gimbal: GimbalConfig
    overlay: OverlayConfig
    given: frozenset[str]  # names of parameters that a file or an option sets
    ground: Ground | None = None
    layers: Sequence[MapLayer] | None = None
    camera: Camera | None = None  # overrides thermal/camera_info
    found: tuple[Finding, ...] = ()


def setting_of(
    configs: NodeConfigs,
    reader: BagReader,
    params: Files,
    namespace: str,
    *,
    ground: Ground | None = None,
    layers: Sequence[MapLayer] | None = None,
    camera: Camera | None = None,
    pictures: bool = False,
) -> CheckSetting:
    """Return the setting for a command's checks of a bag; ``pictures``: the bag must have some."""
    recording = RecordedTopics(
        reader.topics(),
        {topic: TOPIC_TYPES[topic] for topic in INPUTS},
        namespace,
        has_camera=camera is not None,
        has_map=layers is not None,
        wants_pictures=pictures,
    )
    seen = recording.there.intersection((*PICTURES, "gimbal/joint_states", "gimbal/attitude"))
    unused = ParameterFile(params).elsewhere(namespace)
    found = (
        *recording_findings(recording),
        *parameter_findings(configs.given, unused, namespace, pictures=bool(seen)),
    )
    ekf, gimbal, overlay, given = configs
    return CheckSetting(ekf, gimbal, overlay, given, ground, layers, camera, found)
