"""Make an endless flight from one minute of hover, to measure cost and memory over hours.

The aircraft turns a quarter right and a quarter left every 12 seconds, in still air, with an IMU
of constant bias and GPS without slow errors. Its state after a minute is that at the start, so the
same samples can follow again with shifted stamps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from dev.flight_errors import NAVIGATION_SAMPLES, fitting_config
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.measurements import NavigationInput
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario, scenario_from

PERIOD_S = 60.0
#: A whole number of turns; later the spline no longer depends on the start.
_FIRST_S = 12.0
_NO_ERROR = (0.0, 0.0, 0.0)


class LoopedFlight:
    """Yield the same samples for the filter each minute, with new stamps."""

    def __init__(self, imu_rate_hz: float = 100.0) -> None:
        """Simulate the minute."""
        flight = fly(hover(imu_rate_hz))
        first_ns = flight.scenario.start_ns + round(_FIRST_S * 1e9)
        end_ns = first_ns + round(PERIOD_S * 1e9)
        self.config: EkfConfig = fitting_config(flight)
        self.imu_samples = round(PERIOD_S * imu_rate_hz)  # in each minute
        self._samples: list[NavigationInput] = [
            sample
            for arrival_ns, sample in flight.samples
            if first_ns <= arrival_ns < end_ns and isinstance(sample, NAVIGATION_SAMPLES)
        ]

    def minutes(self) -> Iterator[list[NavigationInput]]:
        """Yield one minute of samples after another, without end, in order of arrival."""
        shift_ns = 0
        while True:
            yield [
                dataclasses.replace(sample, stamp_ns=sample.stamp_ns + shift_ns)
                for sample in self._samples
            ]
            shift_ns += round(PERIOD_S * 1e9)


def hover(imu_rate_hz: float) -> Scenario:
    """Return the scenario of the minute and of what comes before it."""
    # A quarter turn in 2 s and 4 s of rest, to and fro: 12 s.
    return scenario_from(
        {
            "duration_s": _FIRST_S + PERIOD_S + 1.0,
            "route.shape": "hover",
            "route.yaw_rate_deg_s": 45.0,
            "route.hover_s": 4.0,
            "route.hold_error_m": 0.0,
            "wind.gust_m_s": 0.0,
            "imu.rate_hz": imu_rate_hz,
            "imu.noise.gyro_bias_instability": _NO_ERROR,
            "imu.noise.accel_bias_instability": _NO_ERROR,
            "gps.position_rms_m": _NO_ERROR,
            "autopilot.heading_rms_deg": 0.0,
            "autopilot.tilt_rms_deg": (0.0, 0.0),
        }
    )
