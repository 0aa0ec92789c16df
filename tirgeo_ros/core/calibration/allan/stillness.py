"""Check whether an IMU was at rest during a record: movement and drift, by seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.record import ImuRecord
from tirgeo_ros.core.types.arrays import Array, BoolArray

#: A second counts as moved beyond this many usual scatters, and at least the least change.
_SCATTERS = 8.0
_LEAST = np.array([0.005] * 3 + [0.05] * 3)  # by hands or wind: 0.3 deg/s; 0.3 deg of tilt
_SHAKEN = 3.0  # times the usual scatter within a second
_FEWEST = 20  # seconds needed for the usual scatter
_FEWEST_OF_DRIFT = 120
_ALL_ALONG_RAD_S = 0.01  # usual change of rate over two seconds: larger than of any sensor at rest
_JOIN_S = 5.0  # moved seconds no further apart are one interval
_SURE = 5.0  # standard deviations of a slope of white noise
_STEADY = 0.9  # share of a series' variance that its slope or its settling must explain
_SETTLED_IN = 2.0 ** np.arange(-5, -0.75, 0.25)  # time constants, as shares of the record


class Interval(NamedTuple):
    """Hold the start and end of an interval of the record."""

    from_s: float
    to_s: float


class Seconds(NamedTuple):
    """Hold the means and scatters of every second of a record."""

    starts_s: Array  # (n,)
    means: Array  # (n, 6) gyroscope, accelerometer
    scatters: Array  # (n, 6)


def seconds_of(record: ImuRecord) -> Seconds:
    """Return the seconds with at least half of their samples."""
    blocks = list(record.blocks(max(round(1 / record.step_s), 2), 0.5))
    means = np.array([np.nanmean(block, axis=0) for _, block in blocks])
    scatters = np.array([np.nanstd(block, axis=0) for _, block in blocks])
    starts_s = np.array([start_s for start_s, _ in blocks])
    return Seconds(starts_s, means.reshape(-1, 6), scatters.reshape(-1, 6))


def movements(seconds: Seconds) -> list[Interval]:
    """Return when the IMU was turned, tilted or shaken; slow wander does not count."""
    if len(seconds.starts_s) < _FEWEST:
        return []
    moved = np.zeros(len(seconds.starts_s), bool)
    # From the previous second to the next one: an IMU that stays tilted has moved once.
    jumps = np.abs(seconds.means[2:] - seconds.means[:-2])
    usual = 1.4826 * np.median(jumps, axis=0)
    if usual[:3].max() > _ALL_ALONG_RAD_S:  # moved all the time, so that nothing stands out
        return [Interval(float(seconds.starts_s[0]), float(seconds.starts_s[-1]) + 1.0)]
    moved[1:-1] = (jumps > np.maximum(_SCATTERS * usual, _LEAST)).any(axis=1)
    limit = np.maximum(_SHAKEN * np.median(seconds.scatters, axis=0), _LEAST)
    found: list[Interval] = []
    for start in seconds.starts_s[moved | (seconds.scatters > limit).any(axis=1)].tolist():
        joined = found and start - found[-1].to_s <= _JOIN_S
        begin = found.pop().from_s if joined else start
        found.append(Interval(begin, start + 1.0))
    return found


def longest_stillness(found: Sequence[Interval], from_s: float, to_s: float) -> Interval:
    """Return the longest time between movements."""
    edges = [from_s, *(edge for one in found for edge in one), to_s]
    rests = [Interval(*edges[i : i + 2]) for i in range(0, len(edges), 2)]
    return max(rests, key=lambda rest: rest.to_s - rest.from_s)


def drifts(seconds: Seconds) -> tuple[Array, BoolArray, BoolArray]:
    """Return changes (6,), unit, from first to last second, which are steady, which settle.

    A sensor that warms up drifts steadily, or settles exponentially after it was switched on. So
    does one random walk in twenty; one record cannot separate the two.
    """
    changes, found, linear = np.zeros(6), np.zeros(6, bool), np.zeros(6, bool)
    if len(seconds.starts_s) < _FEWEST_OF_DRIFT:
        return changes, found, found
    t = (seconds.starts_s - seconds.starts_s[0]) / np.ptp(seconds.starts_s)
    most = np.zeros(6)
    for number, form in enumerate([t, *(-np.exp(-t / part) for part in _SETTLED_IN)]):
        shape = form - form.mean()
        factors, explained, sure = _along(seconds, shape)
        power = factors**2 * (shape @ shape)
        better = power > most
        most = np.maximum(power, most)
        changes = np.where(better, factors * (shape[-1] - shape[0]), changes)
        found = np.where(better, (explained > _STEADY) & sure, found)
        linear = np.where(better, number == 0, linear)
    return changes, found & linear, found & ~linear


def _along(seconds: Seconds, shape: Array) -> tuple[Array, Array, BoolArray]:
    """Fit a shape (n,) of mean zero: return its factors (6,) and their significance.

    That is the share of the minutes' variance that they explain (6,), and whether they are beyond
    the scatter of the seconds (6,).
    """
    factors = shape @ seconds.means / (shape @ shape)
    minutes = max(len(shape) // 60, 1)
    part = len(shape) // minutes * minutes
    series = seconds.means[:part].reshape(minutes, -1, 6).mean(axis=1)
    line = factors * shape[:part].reshape(minutes, -1).mean(axis=1)[:, None]
    explained = line.var(axis=0) / np.maximum(series.var(axis=0), 1e-300)
    rest = (seconds.means - shape[:, None] * factors).std(axis=0)
    return factors, explained, np.abs(factors) * math.sqrt(float(shape @ shape)) > _SURE * rest
