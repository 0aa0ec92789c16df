"""Rotate IMU samples to body axes, where the IMU is mounted at an angle."""

from __future__ import annotations

from dataclasses import replace

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.types.measurements import ImuSample


class ImuAxes:
    """Rotate specific force and angular rate to the body axes by ``imu_rpy_deg``.

    The autopilot's attitude is that of the body already and is not changed.
    """

    def __init__(self, aircraft: AircraftConfig) -> None:
        self._rotation_bi = aircraft.rotation_bi
        self.turned = self._rotation_bi is not None

    def to_body(self, sample: ImuSample) -> ImuSample:
        """Return the sample in body axes: the same object where the IMU's axes are the body's."""
        rotation_bi = self._rotation_bi
        if rotation_bi is None:
            return sample
        return replace(
            sample,
            specific_force_b=rotation_bi @ sample.specific_force_b,
            angular_rate_b=rotation_bi @ sample.angular_rate_b,
        )
