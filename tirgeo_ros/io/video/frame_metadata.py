"""Make the metadata of a picture: what was seen from where, and how sure that is."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config.overlay import ConfidenceConfig
from tirgeo_ros.core.ground.frame_geometry import FrameGeometry, Sight, frame_geometry
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.io.video.klv import ITEMS, Value, packet

#: Beyond the range of these items, the same angle goes into the item with the larger range.
_FULL = {6: 90, 7: 91}
_CORNERS, _OFFSETS = range(82, 90), range(26, 34)


class FrameMetadata:
    """Make packets for the pictures of one camera.

    ``confidence`` gives the sigmas besides the pose's; it may be renewed. Without
    ``undulation_m``, the height of the geoid above the ellipsoid, there are no heights above sea
    level. ``platform`` names the aircraft; it may be empty.
    """

    def __init__(
        self, confidence: ConfidenceConfig, undulation_m: float = math.nan, platform: str = ""
    ) -> None:
        self.confidence, self._undulation_m = confidence, undulation_m
        self._same: dict[int, Value] = {10: platform, 11: "Thermal", 12: "Geodetic WGS84"}

    def packet(self, time_ns: int, sight: Sight | None) -> bytes:
        """Return the packet of a picture that was exposed at ``time_ns``, ns since 1970.

        Without a trusted pose (None) it says the time alone, never an old place.
        """
        if sight is None:
            return packet(time_ns, {})
        geometry = frame_geometry(sight, self.confidence)
        return packet(time_ns, {**self._same, **items_of(geometry, self._undulation_m)})


def items_of(geometry: FrameGeometry, undulation_m: float) -> dict[int, Value]:
    """Return a picture's values by tag, in the items' units; nan for what is not known."""
    tilt, pitch, heading = geometry.platform_rpy
    roll, elevation, azimuth = geometry.sensor_rpy
    values: dict[int, Value] = {
        5: _turn_deg(heading),
        **_platform(6, pitch),
        **_platform(7, tilt),
        **_place((13, 14, 75, 15), geometry.sensor, undulation_m),
        16: math.degrees(geometry.fields_of_view[0]),
        17: math.degrees(geometry.fields_of_view[1]),
        18: _turn_deg(azimuth),
        19: math.degrees(elevation),
        20: _turn_deg(roll),
        21: geometry.slant_range_m,
        22: geometry.width_m,
        **_place((23, 24, 78, 25), geometry.centre, undulation_m),
        45: geometry.ce90_m,
        46: geometry.le90_m,
    }
    return values | _corners(geometry)


def _turn_deg(angle_rad: float) -> float:
    return math.degrees(angle_rad) % 360.0


def _platform(tag: int, angle_rad: float) -> dict[int, Value]:
    angle_deg = math.degrees(angle_rad)
    return {_FULL[tag] if abs(angle_deg) > ITEMS[tag].high else tag: angle_deg}


def _place(
    tags: tuple[int, int, int, int], place: Vector, undulation_m: float
) -> dict[int, Value]:
    """Return latitude, longitude, ellipsoidal height and height above sea level by tag."""
    latitude_rad, longitude_rad, height_m = place
    degrees = math.degrees(latitude_rad), math.degrees(longitude_rad)
    return dict(zip(tags, (*degrees, height_m, height_m - undulation_m), strict=True))


def _corners(geometry: FrameGeometry) -> dict[int, Value]:
    """Return the corners by tag, also as offsets from the centre if these reach all of them."""
    corners_deg = np.degrees(geometry.corners)
    offsets_deg = corners_deg - np.degrees(geometry.centre[:2])
    offsets_deg[:, 1] = (offsets_deg[:, 1] + 180.0) % 360.0 - 180.0
    reached = bool((np.abs(offsets_deg) <= ITEMS[_OFFSETS[0]].high).all())
    near = _by_tag(_OFFSETS, offsets_deg) if reached else {}
    return {**near, **_by_tag(_CORNERS, corners_deg)}


def _by_tag(tags: range, corners_deg: Array) -> dict[int, Value]:
    return dict(zip(tags, corners_deg.ravel().tolist(), strict=True))
