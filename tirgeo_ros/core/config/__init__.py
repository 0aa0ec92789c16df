"""Define the parameters of nodes and commands, each default once, by node."""

from __future__ import annotations

from tirgeo_ros.core.config.aircraft_parameters import AircraftConfig, FrameIds, FramesConfig
from tirgeo_ros.core.config.bag_parameters import (
    BagPlayerConfig,
    RecorderConfig,
    SimulatedAircraftConfig,
)
from tirgeo_ros.core.config.dji_parameters import DjiConfig
from tirgeo_ros.core.config.filter_parameters import (
    METHODS,
    AutopilotConfig,
    EkfConfig,
    ImuConfig,
    ImuNoiseConfig,
    RtkConfig,
)
from tirgeo_ros.core.config.gimbal_parameters import GimbalConfig, NorthConfig
from tirgeo_ros.core.config.overlay_parameters import OverlayConfig
from tirgeo_ros.core.config.schema import RENAMED
from tirgeo_ros.core.config.viewer_parameters import VideoWriterConfig, ViewerConfig

__all__ = [
    "METHODS", "NODE_CONFIGS", "RENAMED", "AircraftConfig", "AutopilotConfig", "BagPlayerConfig",
    "DjiConfig", "EkfConfig", "FrameIds", "FramesConfig", "GimbalConfig", "ImuConfig",
    "ImuNoiseConfig", "NorthConfig", "OverlayConfig", "RecorderConfig", "RtkConfig",
    "SimulatedAircraftConfig", "VideoWriterConfig", "ViewerConfig",
]  # fmt: skip

#: Every node's parameter tree, by the node's name.
NODE_CONFIGS: dict[str, type] = {
    "dji_node": DjiConfig,
    "ekf_node": EkfConfig,
    "gimbal_node": GimbalConfig,
    "overlay_node": OverlayConfig,
    "viewer_node": ViewerConfig,
    "bag_player": BagPlayerConfig,
    "recorder": RecorderConfig,
    "video_writer": VideoWriterConfig,
}
