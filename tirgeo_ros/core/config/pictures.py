"""The parameters of overlay_node."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.parameter import param


@dataclass(frozen=True, slots=True)
class OverlayConfig:
    """Parameters of overlay_node."""

    map: str = param("", "the map's file")
    ground_height_m: float = param(
        math.nan,
        "ellipsoidal height of the ground; unset = the map's own heights",
        unit="m",
        low=-500,
        high=9000,
    )
    video_latency_s: float = param(0.05, "image stamp minus exposure", unit="s", low=-1, high=5)
    max_pose_wait_s: float = param(
        0.1,
        "a frame waits this long for the camera pose around its exposure",
        unit="s",
        low=0,
        high=5,
    )
    label_field: str = param("name", "property of a map feature that is its label")
    jpeg_quality: int = param(80, "quality of overlay/image/compressed", low=1, high=100)
