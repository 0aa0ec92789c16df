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
"""Define the parameters of overlay_node."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft_parameters import FramesConfig
from tirgeo_ros.core.config.schema import group, param

PALETTES = ("white_hot", "black_hot", "iron", "rainbow", "arctic", "lava")
#: The parameters of ConfidenceConfig that enter the covariance of a located point.
POINT_SIGMAS = ("latency_sigma_s", "lens_sigma_px", "focal_sigma", "ground_sigma_m")


@dataclass(frozen=True, slots=True)
class PictureConfig:
    """How the thermal picture itself is shown."""

    stretch_percent: tuple[float, ...] = param(
        (1.0, 99.0), "percentiles of a 16-bit picture shown as black and white", ("%", 0, 100)
    )
    stretch_time_s: float = param(
        1.0, "time in which the stretch follows 95 % of a change of the scene", ("s", 0, 60)
    )
    local_contrast: float = param(
        0.0, "limit of the local contrast's gain; 0 = off, 2 = plain, 8 = strong", ("", 0, 40)
    )
    celsius_per_count: float = param(
        0.0, "step of temperature of a 16-bit picture's values; 0 = unknown", ("deg C", 0, 10)
    )
    celsius_offset: float = param(
        -273.15, "temperature of a 16-bit picture's value 0", ("deg C", -1000, 1000)
    )


@dataclass(frozen=True, slots=True)
class ConfidenceConfig:
    """How the overlay's uncertainty is drawn, and which errors it includes besides the pose's."""

    ellipses: bool = param(True, "draw the 95 % ellipse at points and labels")
    lines: str = param(
        "fade",
        "how lines of uncertain position are drawn: fade or none (like all others)",
        choices=("fade", "none"),
    )
    fade_px: float = param(
        60.0, "95 % radius at which a line has faded to its faintest", ("px", 1, 1e4)
    )
    latency_sigma_s: float = param(0.005, "standard deviation of video_latency_s", ("s", 0, 1))
    lens_sigma_px: float = param(0.5, "standard deviation of the lens model", ("px", 0, 100))
    focal_sigma: float = param(
        0.0,
        "relative standard deviation of the focal length: 0.02 suits a lens known only by its "
        "data sheet",
        ("", 0, 1),
    )
    map_sigma_m: float = param(
        0.1, "sigma of horizontal map positions, unless the style sets it", ("m", 0, 1e3)
    )
    ground_sigma_m: float = param(0.1, "standard deviation of the ground's height", ("m", 0, 1e3))
    scale_bar: bool = param(True, "draw a bar of known length on the ground")
    heading_rose: bool = param(True, "draw where north is, and the camera's heading")


@dataclass(frozen=True, slots=True)
class OverlayConfig(FramesConfig):
    """Parameters of overlay_node."""

    map: str = param(
        "", "map (GeoJSON, GeoPackage, Shapefile, KML, KMZ); several separated by commas"
    )
    style: str = param("", "style sheet (YAML) of the map's layers; empty = one style for all")
    network: bool = param(
        False, "let map and dem read from the network (a VRT or WFS file may contain addresses)"
    )
    label_field: str = param("name", "property of a map feature that is drawn as its label")
    reload_s: float = param(
        2.0, "interval at which map and style are checked for changes; 0 = never", ("s", 0, 3600)
    )
    ground_height_m: float = param(
        math.nan,
        "ellipsoidal height of level ground; unset = the DEM's heights, else the map's own",
        ("m", -500, 9000),
    )
    dem: str = param(
        "", "elevation model (GeoTIFF), tiles separated by commas; empty = level ground"
    )
    dem_undulation_m: float = param(
        0.0,
        "height of the DEM's zero above the ellipsoid; that of the geoid if the DEM's heights are "
        "above sea level",
        ("m", -120, 100),
    )
    camera: str = param(
        "",
        "calibration of the camera (YAML of camera_calibration); empty = thermal/camera_info",
    )
    video_latency_s: float = param(
        0.05,
        "delay of the video: an image's stamp minus its time of exposure",
        ("s", -1, 5),
        live=True,
    )
    max_pose_wait_s: float = param(
        0.1,
        "longest wait of a frame for the camera pose at its exposure",
        ("s", 0, 5),
        live=True,
    )
    max_prediction_s: float = param(
        0.1,
        "longest prediction of a pose for a frame whose pose did not come in time; 0 = never",
        ("s", 0, 1),
        live=True,
    )
    palette: str = param(
        "white_hot", "colours for pictures without colour", choices=PALETTES, live=True
    )
    rectify: bool = param(False, "show the picture without the lens's distortion", live=True)
    footprint_rate_hz: float = param(5.0, "highest rate of tirgeo/footprint", ("Hz", 0.1, 100))
    compressed_rate_hz: float = param(
        100.0,
        "highest rate of tirgeo/overlay/image/compressed and clean/compressed; lower it for a "
        "slow link",
        ("Hz", 0.1, 1000),
        live=True,
    )
    jpeg_quality: int = param(
        80,
        "quality of tirgeo/overlay/image/compressed and clean/compressed",
        ("", 1, 100),
        live=True,
    )
    picture: PictureConfig = group(PictureConfig, live=True)
    confidence: ConfidenceConfig = group(ConfidenceConfig, live=True)
