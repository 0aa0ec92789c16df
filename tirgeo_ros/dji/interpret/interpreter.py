"""Convert readings of the aircraft to the core's samples."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput
from tirgeo_ros.dji.interpret.autopilot_attitude import AutopilotAttitudes
from tirgeo_ros.dji.interpret.gimbal_samples import GimbalInterpreter
from tirgeo_ros.dji.interpret.gps_samples import GpsInterpreter
from tirgeo_ros.dji.interpret.imu_samples import ImuInterpreter
from tirgeo_ros.dji.interpret.rtk_samples import NOT_SET, RtkInterpreter
from tirgeo_ros.dji.sources.readings import (
    AttitudeReading,
    GimbalReading,
    GpsReading,
    ImuReading,
    Reading,
    RtkReading,
)

Sample = NavigationInput | JointSample | CameraAttitudeSample


class Interpreter:
    """Convert readings to samples by the parameters; everything that is dropped is counted.

    Stamps are the readings' minus ``delay`` of their kind. Those of a stream increase, unless the
    aircraft's clock goes back by a second or more, which is passed on for the filter to judge.
    """

    def __init__(self, config: DjiConfig) -> None:
        self._counts: Counter[str] = Counter()
        self._undulation_m = config.geoid_undulation_m
        self._one_antenna = not config.aircraft.second_antenna_m
        undulation_m = 0.0 if math.isnan(self._undulation_m) else self._undulation_m
        attitudes = AutopilotAttitudes(self._counts)
        self._imu = ImuInterpreter(config, attitudes, self._counts)
        self._rtk = RtkInterpreter(config, undulation_m, self._counts)
        self._gps = GpsInterpreter(config, undulation_m, self._counts)
        self._gimbal = GimbalInterpreter(config, attitudes, self._counts)
        self._takers: dict[type, Callable[[Any], list[Any]]] = {
            ImuReading: self._imu.take,
            AttitudeReading: self._imu.take_attitude,
            GpsReading: self._gps.take,
            RtkReading: self._rtk.take,
            GimbalReading: self._gimbal.take,
        }

    def configure(self, config: DjiConfig) -> None:
        """Take other sigmas and delays in flight; the rest of the parameters must be the same."""
        for part in (self._imu, self._rtk, self._gps, self._gimbal):
            part.configure(config)

    def take(self, reading: Reading) -> list[Sample]:
        """Return the samples of a reading, and of earlier ones that waited for it."""
        samples: list[Sample] = self._takers[type(reading)](reading)
        if self._gimbal.waiting:
            samples = [*samples, *self._gimbal.resolve(reading.stamp_ns)]
        return samples

    def flush(self) -> list[Sample]:
        """Return the samples of waiting readings, at the end of a recording."""
        return [*self._imu.flush(), *self._gimbal.flush()]

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of readings that gave no sample, or gave it in an unusual way."""
        found = Counter(self._counts)
        found.update(self._imu.counts)
        return {name: number for name, number in sorted(found.items()) if number}

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the current interpretation of the aircraft's data, for people."""
        unset = math.isnan(self._undulation_m)
        return {
            **self._imu.diagnostics,
            **self._rtk.diagnostics,
            **self._gimbal.diagnostics,
            "geoid_undulation_m": "0 (not set)" if unset else f"{self._undulation_m:g}",
        }

    @property
    def warnings(self) -> list[str]:
        """Return what a person should set right."""
        found = self._imu.warnings
        if self._one_antenna:
            found.append(NOT_SET)
        if math.isnan(self._undulation_m):
            found.append(
                "geoid_undulation_m is not set: heights above sea level are published as "
                "ellipsoidal, wrong by up to 100 m; set the geoid's height in the area of flight"
            )
        return [warning for warning in found if warning]
