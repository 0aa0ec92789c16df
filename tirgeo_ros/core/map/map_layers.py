"""Define a map as read from its file: features in layers, each layer with a style."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tirgeo_ros.core.types.arrays import Array

Colour = tuple[int, int, int]  # blue, green, red, 0 to 255


@dataclass(frozen=True, slots=True)
class GeoFeature:
    """Hold a line, an outline or a point of a map; a single point is drawn as a mark."""

    label: str
    closed: bool  # an outline: its last point is joined to its first
    points: Array  # (N, 3) latitude, longitude (rad), ellipsoidal height (m), nan = unknown
    group: int = -1  # parts of one feature share a number >= 0 and one label


@dataclass(frozen=True, slots=True)
class LayerStyle:
    """Hold how a layer is drawn."""

    line_bgr: Colour = (0, 255, 255)
    width_px: int = 1  # 1 to 5
    labels: bool = True
    #: The layer is shown while a pixel at the picture's centre spans this range of ground, m.
    scale_m_px: tuple[float, float] = (0.0, math.inf)


@dataclass(frozen=True, slots=True)
class MapLayer:
    """Hold features of one style; they are drawn over those of the layers before."""

    name: str
    features: Sequence[GeoFeature]
    style: LayerStyle = LayerStyle()
    sigma_m: float | None = None  # standard deviation of its horizontal positions; None: unknown
    left_out: tuple[str, ...] = ()  # what is left out or changed from the file, one line each
