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
        "delay of the RTK stamps: stamp minus time of measurement. Positive where a receiver "
        "stamps at arrival, negative where stamps are early",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    velocity_delay_s: float = param(
        0.0,
        "additional delay of the velocities, on top of delay_s, in receivers that smooth them",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    position_sigma_floor_m: float = param(
        0.01,
        "smallest standard deviation accepted for a position, per axis; smaller reported ones "
        "are raised to it",
        unit="m",
        low=1e-4,
        high=100,
    )
    velocity_sigma_floor_m_s: float = param(
        0.02,
        "smallest standard deviation accepted for a velocity, per axis; smaller reported ones "
        "are raised to it",
        unit="m/s",
        low=1e-4,
        high=100,
    )
    gate_sigma: float = param(
        5.0,
        "innovation gate: reject measurements further than this many standard deviations from "
        "the prediction",
        low=1,
        high=1e6,
    )
    float_sigma_m: float = param(
        0.3,
        "smallest standard deviation accepted for a float position; smaller reported ones are "
        "raised to it",
        unit="m",
        low=0,
        high=100,
    )
    float_time_s: float = param(
        20.0, "correlation time of the error of a float position", unit="s", low=1e-3, high=1e5
    )
    reset_after_s: float = param(
        2.0,
        "reset the state to the positions or velocities that have been rejected for this long "
        "while agreeing with each other",
        unit="s",
        low=0.1,
        high=3600,
    )


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The heading of the two RTK antennas."""

    delay_s: float = param(
        math.nan,
        "delay of the heading stamps: stamp minus time of measurement; unset = rtk.delay_s",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    sigma_floor_deg: float = param(
        0.6,
        "smallest standard deviation accepted for a heading; smaller reported ones are raised "
        "to it. 0.6 suits headings in whole degrees, whose rounding error stays the same along "
        "a leg",
        unit="deg",
        low=1e-3,
        high=180,
    )
    resolution_deg: float = param(
        0.0,
        "rounding step of the headings: each is used as an interval of this width, with "
        "sigma_floor_deg as the noise before rounding; 0 = use headings as plain numbers. 1.0 "
        "suits whole degrees of a receiver whose own noise is 0.2 deg or less",
        unit="deg",
        low=0,
        high=90,
    )
    gate_sigma: float = param(
        4.0,
        "innovation gate: reject headings further than this many standard deviations from the "
        "prediction",
        low=1,
        high=1e6,
    )
    start_after_s: float = param(
        1.0,
        "time for which rtk/fix must have been fixed before headings are used",
        unit="s",
        low=0,
        high=60,
    )
    reset_after_s: float = param(
        5.0,
        "reset the heading to the headings that have been rejected for at least this long while "
        "agreeing with each other",
        unit="s",
        low=0.1,
        high=3600,
    )
    bias_sigma_deg: float = param(
        0.0,
        "standard deviation of a slowly varying heading error, which the filter then estimates; "
        "0 = none",
        unit="deg",
        low=0,
        high=30,
    )
    bias_time_s: float = param(
        600.0, "correlation time of the slowly varying heading error", unit="s", low=1, high=1e9
    )


@dataclass(frozen=True, slots=True)
class GpsConfig:
    """The autopilot's ordinary GPS."""

    position_sigma_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017),
        "standard deviation north, east, down of a position without covariance",
        unit="m",
        low=1e-3,
        high=1e4,
    )
    position_time_s: float = param(
        45.0, "correlation time of the position error", unit="s", low=0.1, high=1e6
    )
    position_noise_m: float = param(
        0.05,
        "standard deviation of the part of the position error that is new in each fix",
        unit="m",
        low=1e-3,
        high=100,
    )
    velocity_sigma_floor_m_s: float = param(
        0.1,
        "smallest standard deviation accepted for a velocity, per axis; smaller reported ones "
        "are raised to it",
        unit="m/s",
        low=1e-3,
        high=100,
    )
    delay_s: float = param(
        0.0,
        "delay of the GPS stamps: stamp minus time of measurement",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    gate_sigma: float = param(
        5.0,
        "innovation gate: reject measurements further than this many standard deviations from "
        "the prediction",
        low=1,
        high=1e6,
    )


@dataclass(frozen=True, slots=True)
class BarometerConfig:
    """The barometer, which holds the height while satellites are missing.

    It is used where baro/pressure is published.
    """

    delay_s: float = param(
        0.0,
        "delay of the pressure's stamps: stamp minus time of measurement",
        unit="s",
        low=-_LONGEST_DELAY_S,
        high=_LONGEST_DELAY_S,
    )
    noise_m: float = param(
        0.2,
        "smallest standard deviation of the white noise of one reading, as a height; smaller "
        "reported ones are raised to it",
        unit="m",
        low=1e-3,
        high=100,
    )
    sigma_m: float = param(
        0.5,
        "standard deviation of the slow error by airspeed, rotor wash and gusts",
        unit="m",
        low=1e-2,
        high=100,
    )
    time_s: float = param(20.0, "correlation time of the slow error", unit="s", low=0.1, high=1e5)
    drift: float = param(
        0.05,
        "random walk of the pressure of the day, as a height",
        unit="m/sqrt(s)",
        low=0,
        high=10,
    )
    scale_sigma: float = param(
        0.05,
        "standard deviation of the relative error of a change of height; 0.035 for each 10 K "
        "by which the air differs from the standard atmosphere",
        low=0,
        high=1,
    )
    gate_sigma: float = param(
        5.0,
        "innovation gate: reject heights further than this many standard deviations from the "
        "prediction",
        low=1,
        high=1e6,
    )
    reset_after_s: float = param(
        2.0,
        "take a new reference after heights that have been rejected for this long while "
        "agreeing with each other",
        unit="s",
        low=0.1,
        high=3600,
    )
