"""Define what is said of a still in its metadata, with the words and numbers that tags share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.ground.camera_place import CameraPlace
from tirgeo_ros.core.types.arrays import Vector

#: Never "DJI": OpenDroneMap adds 90 deg to the pitch of pictures by that maker, and takes the
#: aircraft's heading for the camera's.
MAKE = "tirgeo"
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True, slots=True)
class Still:
    """Hold what is known of a still; nan and None are what is not known."""

    exposure_ns: int  # since 1970, UTC
    camera: Camera
    place: CameraPlace
    heading_rad: float  # of the view, from true north, clockwise
    body_rpy: Vector | None  # the aircraft's roll, pitch and heading, rad
    above_ground_m: float
    undulation_m: float  # of the geoid
    model: str  # names the camera
    pixel_pitch_um: float  # width of a pixel on the sensor

    @property
    def above_sea(self) -> bool:
        """Return whether ``altitude_m`` is above sea level, not above the ellipsoid."""
        return math.isfinite(self.undulation_m)

    @property
    def altitude_m(self) -> float:
        """Return the height above sea level if the undulation is known, else the ellipsoidal."""
        return self.place.altitude_m(self.undulation_m)

    @property
    def altitude_words(self) -> str:
        """Return what the altitude is measured from, for a person."""
        height = f"{self.place.height_m:.3f} m above the WGS84 ellipsoid"
        if self.above_sea:
            return f"altitude above sea level: {height}, geoid undulation {self.undulation_m:g} m"
        return f"altitude is ellipsoidal: {height}"

    @property
    def time(self) -> datetime:
        """Return the exposure's time, UTC, to a microsecond, rounded down."""
        return _EPOCH + timedelta(microseconds=self.exposure_ns // 1000)

    @property
    def focal_mm(self) -> float:
        """Return the focal length along the rows, by the pixels' width."""
        return self.camera.fx * self.pixel_pitch_um * 1e-3
