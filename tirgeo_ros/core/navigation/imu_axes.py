"""The IMU's axes, where they are not the body's."""

from __future__ import annotations

from dataclasses import replace

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.types.measurements import ImuSample


class ImuAxes:
    """Turns what the IMU feels into the body's axes, as ``imu_rpy_deg`` says.

    The autopilot's attitude is the body's already and stays.
    """

    def __init__(self, aircraft: AircraftConfig) -> None:
        self._rotation_bi = aircraft.rotation_bi
        self.turned = self._rotation_bi is not None

    def to_body(self, sample: ImuSample) -> ImuSample:
        """Return the sample in body axes: the very sample where these are the IMU's."""
        rotation_bi = self._rotation_bi
        if rotation_bi is None:
            return sample
        return replace(
            sample,
            specific_force_b=rotation_bi @ sample.specific_force_b,
            angular_rate_b=rotation_bi @ sample.angular_rate_b,
        )
