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
