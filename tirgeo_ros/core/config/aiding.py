"""The parameters of what aids the filter: RTK, its heading, the ordinary GPS."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.config.schema import param

_LONGEST_DELAY_S = 2.0


@dataclass(frozen=True, slots=True)
class RtkConfig:
    """The RTK receiver's position and velocity."""

    median_window: int = param(
        1, "number of positions in the median filter; 1 = off", low=1, high=99
    )
    delay_s: float = param(
        0.0,
        "stamp less time of measurement, as of receivers that stamp at arrival; negative for "
        "stamps that are early",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    velocity_delay_s: float = param(
        0.0,
        "by how much velocities are later than that, as of receivers that smooth them",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    position_sigma_floor_m: float = param(
        0.01,
        "smallest standard deviation believed of a position, per axis",
        unit="m",
        low=1e-4,
        high=100,
    )
    velocity_sigma_floor_m_s: float = param(
        0.02,
        "smallest standard deviation believed of a velocity, per axis",
        unit="m/s",
        low=1e-4,
        high=100,
    )
    gate_sigma: float = param(
        5.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )
    float_sigma_m: float = param(
        0.3, "smallest standard deviation believed of a float position", unit="m", low=0, high=100
    )
    float_time_s: float = param(
        20.0, "correlation time of a float position's error", unit="s", low=1e-3, high=1e5
    )
    reset_after_s: float = param(
        2.0,
        "positions or velocities that agree with each other but are refused for so long set the "
        "state",
        unit="s",
        low=0.1,
        high=3600,
    )


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The heading of the two RTK antennas."""

    delay_s: float = param(
        math.nan,
        "stamp less time of measurement, as of rtk.delay_s; unset = the same as that",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    sigma_floor_deg: float = param(
        0.6, "smallest standard deviation believed of a heading", unit="deg", low=1e-3, high=180
    )
    resolution_deg: float = param(
        0.0,
        "headings are read as intervals of this width, sigma_floor_deg being the least noise "
        "before the rounding; 0 = as numbers with noise",
        unit="deg",
        low=0,
        high=90,
    )
    gate_sigma: float = param(
        4.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )
    start_after_s: float = param(
        1.0, "rtk/fix must be fixed for so long before headings are used", unit="s", low=0, high=60
    )
    reset_after_s: float = param(
        5.0,
        "headings that agree with each other but are refused for at least so long set the state",
        unit="s",
        low=0.1,
        high=3600,
    )
    bias_sigma_deg: float = param(
        0.0,
        "standard deviation of a slow error of the headings that is estimated; 0 = none",
        unit="deg",
        low=0,
        high=30,
    )
    bias_time_s: float = param(600.0, "correlation time of that error", unit="s", low=1, high=1e9)


@dataclass(frozen=True, slots=True)
class GpsConfig:
    """The autopilot's ordinary GPS."""

    position_sigma_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017),
        "north, east, down standard deviation where the message has none",
        unit="m",
        low=1e-3,
        high=1e4,
    )
    position_time_s: float = param(
        45.0, "correlation time of the position's error", unit="s", low=0.1, high=1e6
    )
    position_noise_m: float = param(
        0.05, "part of the position's error that is new in each fix", unit="m", low=1e-3, high=100
    )
    velocity_sigma_floor_m_s: float = param(
        0.1,
        "smallest standard deviation believed of a velocity, per axis",
        unit="m/s",
        low=1e-3,
        high=100,
    )
    delay_s: float = param(
        0.0,
        "stamp less time of measurement, as of rtk.delay_s",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    gate_sigma: float = param(
        5.0, "innovations beyond this many standard deviations are refused", low=1, high=1e6
    )
