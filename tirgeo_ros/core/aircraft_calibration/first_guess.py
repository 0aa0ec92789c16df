"""Estimate the antenna baseline and the headings' delay roughly, to start the search from."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tirgeo_ros.core.aircraft_calibration.filter_run import FilterRun, FlightRuns
from tirgeo_ros.core.aircraft_calibration.parameters import (
    AZIMUTH,
    DELAYS,
    Floors,
    reported_direction_rad,
)
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import HeadingSample, Source

_FLOORS = Floors(0.5, 0.5, math.radians(5))
_DELAYS_S = np.arange(-0.5, 0.501, 0.02)
_DIRECTIONS_RAD = np.arange(8) * math.tau / 8


#: Runs the filter with values and floors, perhaps without a source.
_Runner = Callable[..., FilterRun]


def started(run: _Runner, runs: FlightRuns, values: Array, held: bool) -> Array:
    """Return the values to begin with; ``held``: the baseline stays as it is."""
    if held:
        return values
    if not runs.recorded.has_attitude:
        return _best_direction(run, values)
    headings = [s for s in runs.recorded.aids if isinstance(s, HeadingSample)]
    found = run(values, _FLOORS, without=Source.RTK_HEADING)
    times_s = np.array([s.stamp_ns - found.attitude_ns[0] for s in headings]) * 1e-9
    reported = np.array([s.heading_rad for s in headings]) + reported_direction_rad(runs.config)
    delay_s, azimuth_rad = _matched(found, times_s, reported)
    values = values.copy()
    values[AZIMUTH], values[DELAYS[Source.RTK_HEADING]] = azimuth_rad, delay_s
    return values


def _matched(run: FilterRun, times_s: Array, azimuths_rad: Array) -> tuple[float, float]:
    """Return delay and azimuth for which the headings scatter least about the filter's own yaw."""
    yaw_s = np.array([stamp - run.attitude_ns[0] for stamp in run.attitude_ns]) * 1e-9
    yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
    found = []
    for delay_s in _DELAYS_S:
        off = np.exp(1j * (azimuths_rad - np.interp(times_s - delay_s, yaw_s, yaw)))
        middle = complex(np.mean(off))
        apart = np.angle(off * middle.conjugate())
        found.append((float(np.median(np.abs(apart))), float(delay_s), float(np.angle(middle))))
    _, delay_s, direction_rad = min(found)
    return delay_s, direction_rad


def _best_direction(run: _Runner, values: Array) -> Array:
    """Return the values with the azimuth that fits the motion best; no attitude is needed."""
    found = []
    for number, direction_rad in enumerate(_DIRECTIONS_RAD):
        tried = values.copy()
        tried[AZIMUTH] = direction_rad
        error = run(tried, _FLOORS).error
        found.append((float(np.mean(np.minimum(error**2, 25.0))), number, tried))
    return min(found, key=lambda one: one[:2])[2]
