"""Convert rows of a table to samples: one class for each quantity of a columns file."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import numpy as np

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    PressureSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.logs.columns_keys import Keys
from tirgeo_ros.io.logs.columns_parts import (
    Attitude,
    Row,
    Status,
    covariance,
    rotation_bi,
    sigmas,
    sigmas_if_known,
    vector,
)
from tirgeo_ros.io.logs.log_contents import DATUMS, LogOptions, Refused
from tirgeo_ros.io.messages import SensedSample


class Quantity(Protocol):
    """Convert a row with its time to a sample."""

    def sample(self, stamp_ns: int, row: Row) -> SensedSample:
        """Return the sample; raise Refused if a value is missing."""


class Imu:
    """Convert specific force, angular rate, and the attitude if the file has it."""

    def __init__(self, keys: Keys, _source: Source | None) -> None:
        self._force = vector(keys, "accel", "acceleration")
        self._rate = vector(keys, "gyro", "rate")
        self._rotation_bi = rotation_bi(keys)
        self._attitude = Attitude(keys.inner("attitude")) if "attitude" in keys else None

    def sample(self, stamp_ns: int, row: Row) -> ImuSample:
        """Return the sample; without an attitude where the row has none."""
        force_b = self._rotation_bi @ [cell.of(row) for cell in self._force]
        rate_b = self._rotation_bi @ [cell.of(row) for cell in self._rate]
        q_nb = None
        if self._attitude is not None:
            with suppress(Refused):
                q_nb = self._attitude.of(row)
        return ImuSample(stamp_ns, force_b, rate_b, q_nb)


class Position:
    """Convert latitude, longitude and height of an antenna."""

    def __init__(self, keys: Keys, source: Source | None) -> None:
        assert source is not None
        self._source = source
        self._place = keys.cells("latitude longitude", "angle")
        height = keys.inner("height")
        self._height = height.cell("column", height.unit("length"))
        self.datum = height.choice("above", DATUMS)
        height.finish()
        self._status = Status(keys)
        wanted = sigmas if source is Source.RTK_POSITION else sigmas_if_known
        self._sigma = wanted(keys, "length")
        self.offset_m = 0.0  # what makes the height ellipsoidal

    def sample(self, stamp_ns: int, row: Row) -> PositionSample:
        """Return the sample; longitudes may be 0 to 360 deg in the table."""
        latitude_rad, longitude_rad = (cell.of(row) for cell in self._place)
        if math.pi < longitude_rad <= math.tau:
            longitude_rad -= math.tau
        height_m = self._height.of(row) + self.offset_m
        covariance_n = covariance(self._sigma, row)
        status = self._status.of(row)
        return PositionSample(
            stamp_ns, self._source, status, latitude_rad, longitude_rad, height_m, covariance_n
        )


class Velocity:
    """Convert a velocity north, east and down or up."""

    def __init__(self, keys: Keys, source: Source | None) -> None:
        assert source is not None
        self._source = source
        self._signs = np.array([1.0, 1.0, -1.0 if "up" in keys else 1.0])
        third = "up" if "up" in keys else "down"
        self._cells = keys.cells(f"north east {third}", "speed")
        wanted = sigmas if source is Source.RTK_VELOCITY else sigmas_if_known
        self._sigma = wanted(keys, "speed")

    def sample(self, stamp_ns: int, row: Row) -> VelocitySample:
        """Return the sample."""
        velocity_n = self._signs * [cell.of(row) for cell in self._cells]
        return VelocitySample(stamp_ns, self._source, velocity_n, covariance(self._sigma, row))


class Heading:
    """Convert the azimuth of the nose, or of the line between two antennas."""

    def __init__(self, keys: Keys, _source: Source | None) -> None:
        self.is_of_baseline = keys.choice("of", ("nose", "baseline")) == "baseline"
        self._cell = keys.cell("column", keys.unit("angle"))
        self._sigma = sigmas(keys, "angle")
        self.baseline_rad = 0.0

    def sample(self, stamp_ns: int, row: Row) -> HeadingSample:
        """Return the sample."""
        heading_rad = (self._cell.of(row) - self.baseline_rad) % math.tau
        return HeadingSample(stamp_ns, heading_rad, float(covariance(self._sigma, row)[0, 0]))


class Pressure:
    """Convert a barometer's pressure; without a sigma its variance is unknown."""

    def __init__(self, keys: Keys, _source: Source | None) -> None:
        self._cell = keys.cell("column", keys.unit("pressure"))
        self._sigma = sigmas_if_known(keys, "pressure")

    def sample(self, stamp_ns: int, row: Row) -> PressureSample:
        """Return the sample."""
        variance = float(covariance(self._sigma, row)[0, 0])
        return PressureSample(stamp_ns, self._cell.of(row), variance)


class GimbalJoints:
    """Convert encoder angles: yaw, then roll, then pitch, in FLU or FRD axes."""

    def __init__(self, keys: Keys, _source: Source | None) -> None:
        self._sign = -1.0 if keys.choice("axes", ("flu", "frd")) == "flu" else 1.0
        self._cells = keys.cells("yaw roll pitch", "angle")

    def sample(self, stamp_ns: int, row: Row) -> JointSample:
        """Return the sample."""
        yaw_rad, roll_rad, pitch_rad = (cell.of(row) for cell in self._cells)
        return JointSample(stamp_ns, self._sign * yaw_rad, roll_rad, self._sign * pitch_rad)


class GimbalAttitude:
    """Convert the camera's attitude."""

    def __init__(self, keys: Keys, _source: Source | None) -> None:
        self._attitude = Attitude(keys.inner("attitude"))

    def sample(self, stamp_ns: int, row: Row) -> CameraAttitudeSample:
        """Return the sample."""
        return CameraAttitudeSample(stamp_ns, self._attitude.of(row))


def prepare(quantity: Quantity, path: Path, options: LogOptions) -> None:
    """Give a quantity what the file does not tell. Raise LogError if it is not known."""
    if isinstance(quantity, Position):
        quantity.offset_m = options.to_ellipsoid_m(quantity.datum, path)
    elif isinstance(quantity, Heading) and quantity.is_of_baseline:
        if options.baseline_m is None:
            raise LogError(
                f"{path}: headings of a baseline: set aircraft.rtk_antenna_m and "
                "aircraft.second_antenna_m in --params"
            )
        quantity.baseline_rad = options.baseline_rad


#: Key of a columns file -> its class, and the source of its samples.
QUANTITIES: dict[str, tuple[type, Source | None]] = {
    "imu": (Imu, None),
    "rtk_position": (Position, Source.RTK_POSITION),
    "rtk_velocity": (Velocity, Source.RTK_VELOCITY),
    "rtk_heading": (Heading, None),
    "gps_position": (Position, Source.GPS_POSITION),
    "gps_velocity": (Velocity, Source.GPS_VELOCITY),
    "pressure": (Pressure, None),
    "gimbal_joints": (GimbalJoints, None),
    "gimbal_attitude": (GimbalAttitude, None),
}
