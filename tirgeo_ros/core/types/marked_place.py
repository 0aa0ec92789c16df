"""Define a place on the ground that is drawn with a label, wherever the map's plane is."""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.types.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class MarkedPlace:
    """Hold a place with the label that is written beside it."""

    label: str
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    covariance_n: Array  # (3, 3) m2, in NED axes at the place or near it
