"""What a map is made of, as its file tells it: features in layers, each layer with a style."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tirgeo_ros.core.types.arrays import Array

Colour = tuple[int, int, int]  # blue, green, red, 0 to 255


@dataclass(frozen=True, slots=True)
class GeoFeature:
    """A line, an outline or a point of a map. One point alone is drawn as a mark."""

    label: str
    closed: bool  # an outline: its last point joins its first
    points: Array  # (N, 3) latitude, longitude (rad), ellipsoidal height (m), nan = unknown
    group: int = -1  # parts of one feature share a number >= 0 and one label; of closed ones the
    # inner are holes (even-odd)


@dataclass(frozen=True, slots=True)
class LayerStyle:
    """How a layer is drawn."""

    line_bgr: Colour = (0, 255, 255)
    width_px: int = 1  # 1 to 5
    fill_bgr: Colour | None = None  # inside of outlines; None: not filled
    fill_opacity: float = 0.25  # 0 to 1
    labels: bool = True
    #: Shown where a pixel at the middle of the picture spans so many metres of ground.
    scale_m_px: tuple[float, float] = (0.0, math.inf)


@dataclass(frozen=True, slots=True)
class MapLayer:
    """Features of one kind, drawn alike, over those of the layers before it."""

    name: str
    features: Sequence[GeoFeature]
    style: LayerStyle = LayerStyle()
    sigma_m: float | None = None  # standard deviation of its horizontal positions; None: not told
    left_out: tuple[str, ...] = ()  # what of the file is not in it, or not as told: a line each
