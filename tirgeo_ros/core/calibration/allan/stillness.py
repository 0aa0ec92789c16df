"""Check whether an IMU was at rest during a record: movement, drift, settling, by seconds."""

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
    means = [np.nanmean(block, axis=0) for _, block in blocks]
    scatters = [np.nanstd(block, axis=0) for _, block in blocks]
    starts_s = np.array([start_s for start_s, _ in blocks])
    return Seconds(starts_s, *(np.array(column).reshape(-1, 6) for column in (means, scatters)))


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
    return _intervals(seconds.starts_s[moved | (seconds.scatters > limit).any(axis=1)])


def largest_move(seconds: Seconds, found: Sequence[Interval]) -> tuple[float, float]:
    """Return the largest move in these intervals, of any axis: rad/s, m/s2."""
    moves = [np.zeros(6)]
    for one in found:
        # Include the previous second, with the attitude before the move.
        inside = (seconds.starts_s >= one.from_s - 1.5) & (seconds.starts_s < one.to_s)
        spread = np.ptp(seconds.means[inside], axis=0)
        moves.append(np.maximum(spread, seconds.scatters[inside].max(axis=0)))
    worst = np.max(moves, axis=0)
    return float(worst[:3].max()), float(worst[3:].max())


def longest_stillness(found: Sequence[Interval], from_s: float, to_s: float) -> Interval:
    """Return the longest time between movements."""
    edges = [from_s, *(edge for one in found for edge in one), to_s]
    rests = [Interval(*edges[i : i + 2]) for i in range(0, len(edges), 2)]
    return max(rests, key=lambda rest: rest.to_s - rest.from_s)


def drifts(seconds: Seconds) -> tuple[Array, BoolArray]:
    """Return slopes (6,), unit/s, and whether the record drifts steadily along them (6,).

    A warming sensor does. So does one random walk in twenty; one record cannot separate the two.
    """
    t = seconds.starts_s - seconds.starts_s.mean() if len(seconds.starts_s) else np.zeros(0)
    if len(t) < _FEWEST_OF_DRIFT:
        return np.zeros(6), np.zeros(6, bool)
    slopes, explained, sure = _along(seconds, t)
    return slopes, (explained > _STEADY) & sure


def settlings(seconds: Seconds) -> tuple[Array, BoolArray]:
    """Return changes (6,), unit, of exponential settling from first to last second, and whether.

    A sensor that was switched on settles exponentially from the start. Pure random walks seem to
    settle no more often than they seem to drift steadily; flicker noise does not.
    """
    change, settles, best = np.zeros(6), np.zeros(6, bool), np.zeros(6)
    if len(seconds.starts_s) < _FEWEST_OF_DRIFT:
        return change, settles
    t = seconds.starts_s - seconds.starts_s[0]
    for part in _SETTLED_IN.tolist():
        shape = -np.exp(-t / (part * t[-1]))
        shape -= shape.mean()
        factors, explained, sure = _along(seconds, shape)
        better = factors**2 * (shape @ shape) > best
        best = np.where(better, factors**2 * (shape @ shape), best)
        change = np.where(better, factors * (shape[-1] - shape[0]), change)
        settles = np.where(better, (explained > _STEADY) & sure, settles)
    return change, settles


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


def _intervals(starts_s: Array) -> list[Interval]:
    found: list[Interval] = []
    for start in starts_s.tolist():
        if found and start - found[-1].to_s <= _JOIN_S:
            found[-1] = Interval(found[-1].from_s, start + 1.0)
        else:
            found.append(Interval(start, start + 1.0))
    return found
