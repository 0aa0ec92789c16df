"""The parameters of overlay_node."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.config.renamed import NodeParameters
from tirgeo_ros.core.config.schema import group, param

PALETTES = ("white_hot", "black_hot", "iron", "rainbow", "arctic", "lava")


@dataclass(frozen=True, slots=True)
class PictureConfig:
    """How the thermal picture itself is shown."""

    stretch_percent: tuple[float, ...] = param(
        (1.0, 99.0),
        "a 16-bit picture is stretched between the values at these shares of its pixels",
        unit="%",
        low=0,
        high=100,
        sizes=(2,),
    )
    stretch_time_s: float = param(
        1.0,
        "time in which the stretch follows the scene, against flicker",
        unit="s",
        low=0,
        high=60,
    )
    local_contrast: float = param(
        0.0, "limit of the local contrast's gain; 0 = off, 2 is plain, 8 strong", low=0, high=40
    )


@dataclass(frozen=True, slots=True)
class ConfidenceConfig:
    """What is drawn of the overlay's own uncertainty, and what goes into it beside the pose's."""

    ellipses: bool = param(True, "points and labels carry the ellipse of 95 %")
    lines: str = param(
        "fade",
        "what becomes of lines whose place is uncertain: fade, band (of 95 %, along them) or none",
        choices=("fade", "band", "none"),
    )
    fade_px: float = param(
        60.0,
        "95 % radius at which a line has faded to its faintest",
        unit="px",
        low=1,
        high=1e4,
    )
    latency_sigma_s: float = param(
        0.005, "standard deviation of video_latency_s", unit="s", low=0, high=1
    )
    lens_sigma_px: float = param(
        0.5, "standard deviation of the lens model", unit="px", low=0, high=100
    )
    map_sigma_m: float = param(
        0.1,
        "standard deviation of the map's horizontal positions, where its layer does not tell",
        unit="m",
        low=0,
        high=1e3,
    )
    ground_sigma_m: float = param(
        0.1, "standard deviation of the ground's height", unit="m", low=0, high=1e3
    )
    scale_bar: bool = param(True, "a bar of known length on the ground")
    heading_rose: bool = param(True, "where north is, and the camera's heading")


@dataclass(frozen=True, slots=True)
class OverlayConfig(NodeParameters):
    """Parameters of overlay_node."""

    map: str = param(
        "", "the map's file (GeoJSON, GeoPackage, Shapefile, KML, KMZ); several with commas"
    )
    style: str = param(
        "", "style sheet (YAML) with the layers of the map; empty = one style for all"
    )
    network: bool = param(
        False,
        "map and dem may be fetched over the network, where they name other places (a VRT, a WFS)",
    )
    label_field: str = param("name", "property of a map feature that is its label")
    reload_s: float = param(
        2.0,
        "map and style are looked at so often, and read again if changed; 0 = never",
        unit="s",
        low=0,
        high=3600,
    )
    ground_height_m: float = param(
        math.nan,
        "ellipsoidal height of the ground; unset = the DEM, else the map's own heights",
        unit="m",
        low=-500,
        high=9000,
    )
    dem: str = param(
        "", "elevation model of the ground (GeoTIFF); tiles of one with commas; empty = a plane"
    )
    dem_undulation_m: float = param(
        0.0,
        "height of the DEM's zero above the ellipsoid: 0 for ellipsoidal heights, the geoid's for "
        "heights above sea level",
        unit="m",
        low=-120,
        high=100,
    )
    camera: str = param(
        "",
        "the camera's calibration (YAML of camera_calibration), in place of thermal/camera_info; "
        "empty = that topic",
    )
    video_latency_s: float = param(0.05, "image stamp minus exposure", unit="s", low=-1, high=5)
    max_pose_wait_s: float = param(
        0.1,
        "a frame waits this long for the camera pose around its exposure",
        unit="s",
        low=0,
        high=5,
    )
    max_prediction_s: float = param(
        0.1,
        "a frame that has waited in vain is drawn with a pose that is predicted no further than "
        "this, and marked; 0 = never",
        unit="s",
        low=0,
        high=1,
    )
    palette: str = param("white_hot", "colours of a picture without colour", choices=PALETTES)
    rectify: bool = param(False, "show the picture without the lens's distortion")
    jpeg_quality: int = param(80, "quality of overlay/image/compressed", low=1, high=100)
    picture: PictureConfig = group(PictureConfig)
    confidence: ConfidenceConfig = group(ConfidenceConfig)
