"""Define the parameters of what aids the filter: RTK, its heading, the ordinary GPS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.config.schema import param

_DELAY, _PATIENCE = ("s", -2, 2), ("s", 0.1, 3600)


def _gate(default: float, what: str) -> Any:
    return param(
        default,
        f"innovation gate: reject {what} further than this many standard deviations from the "
        "prediction",
        ("", 1, 1e6),
    )


def _floor(default: float, of: str, within: tuple[str, float, float]) -> Any:
    text = f"smallest standard deviation accepted for {of}; smaller reported ones are raised to it"
    return param(default, text, within)


@dataclass(frozen=True, slots=True)
class RtkConfig:
    """The RTK receiver's position and velocity."""

    median_window: int = param(1, "number of positions in the median filter; 1 = off", ("", 1, 99))
    delay_s: float = param(
        0.0,
        "delay of the RTK stamps: stamp minus time of measurement. Positive where a receiver "
        "stamps at arrival, negative where stamps are early",
        _DELAY,
    )
    velocity_delay_s: float = param(
        0.0, "extra delay of the velocities, for receivers that smooth them", _DELAY
    )
    position_sigma_floor_m: float = _floor(0.01, "a position, per axis", ("m", 1e-4, 100))
    velocity_sigma_floor_m_s: float = _floor(0.02, "a velocity, per axis", ("m/s", 1e-4, 100))
    gate_sigma: float = _gate(5.0, "measurements")
    float_sigma_m: float = _floor(0.3, "a float position", ("m", 0, 100))
    float_time_s: float = param(
        20.0, "correlation time of the error of a float position", ("s", 1e-3, 1e5)
    )
    reset_after_s: float = param(
        2.0,
        "reset the state to the positions or velocities that have been rejected for this long "
        "while agreeing with each other",
        _PATIENCE,
    )


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The heading of the two RTK antennas."""

    delay_s: float = param(
        math.nan, "delay of the stamps, as rtk.delay_s; unset = rtk.delay_s", _DELAY
    )
    sigma_floor_deg: float = param(
        0.6,
        "smallest standard deviation accepted for a heading; smaller reported ones are raised "
        "to it. 0.6 suits headings in whole degrees, whose rounding error stays the same along "
        "a leg",
        ("deg", 1e-3, 180),
    )
    resolution_deg: float = param(
        0.0,
        "rounding step of the headings: each is used as an interval of this width, with "
        "sigma_floor_deg as the noise before rounding; 0 = use headings as plain numbers. 1.0 "
        "suits whole degrees of a receiver whose own noise is 0.2 deg or less",
        ("deg", 0, 90),
    )
    gate_sigma: float = _gate(4.0, "headings")
    start_after_s: float = param(
        1.0, "time for which rtk/fix must be fixed before headings are used", ("s", 0, 60)
    )
    reset_after_s: float = param(
        5.0,
        "reset the heading to the headings that have been rejected for at least this long while "
        "agreeing with each other",
        _PATIENCE,
    )
    bias_sigma_deg: float = param(
        0.0,
        "sigma of a slowly varying error that the filter estimates; 0 = none",
        ("deg", 0, 30),
        live=False,  # it decides the filter's states
    )
    set_sigma_deg: float = param(
        5.0,
        "standard deviation of a heading on ~/set_heading that comes without a variance",
        ("deg", 0.1, 90),
    )
    bias_time_s: float = param(600.0, "correlation time of that error", ("s", 1, 1e9))


@dataclass(frozen=True, slots=True)
class GpsConfig:
    """The autopilot's ordinary GPS."""

    position_sigma_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017),
        "standard deviation north, east, down of a position without covariance",
        ("m", 1e-3, 1e4),
    )
    position_time_s: float = param(45.0, "correlation time of the position error", ("s", 0.1, 1e6))
    position_noise_m: float = param(
        0.05, "sigma of the position error that is new in each fix", ("m", 1e-3, 100)
    )
    velocity_sigma_floor_m_s: float = _floor(0.1, "a velocity, per axis", ("m/s", 1e-3, 100))
    delay_s: float = param(0.0, "delay of the stamps, as rtk.delay_s", _DELAY)
    gate_sigma: float = _gate(5.0, "measurements")


@dataclass(frozen=True, slots=True)
class BarometerConfig:
    """The barometer, which holds the height while satellites are missing.

    It is used where baro/pressure is published.
    """

    delay_s: float = param(0.0, "delay of the stamps, as rtk.delay_s", _DELAY)
    noise_m: float = param(
        0.2,
        "smallest standard deviation of the white noise of one reading, as a height; smaller "
        "reported ones are raised to it",
        ("m", 1e-3, 100),
    )
    sigma_m: float = param(
        0.5, "sigma of the slow error by airspeed, rotor wash and gusts", ("m", 1e-2, 100)
    )
    time_s: float = param(20.0, "correlation time of the slow error", ("s", 0.1, 1e5))
    drift: float = param(
        0.05, "random walk of the pressure of the day, as a height", ("m/sqrt(s)", 0, 10)
    )
    scale_sigma: float = param(
        0.05,
        "standard deviation of the relative error of a change of height; 0.035 for each 10 K "
        "by which the air differs from the standard atmosphere",
        ("", 0, 1),
    )
    gate_sigma: float = _gate(5.0, "heights")
    reset_after_s: float = param(
        2.0,
        "take a new reference after heights that have been rejected for this long while "
        "agreeing with each other",
        _PATIENCE,
    )
