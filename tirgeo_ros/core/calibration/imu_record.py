# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Place an IMU's samples on a regular grid in time, and find movement and drift in the record.

Time stamps have jitter, repeat, come in bursts and go back, and samples are missing. On the grid
each sample has a slot of its own, in order, as near to its stamp as the earlier ones permit; slots
without a sample are NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import CalibrationError

#: A longer gap splits the record; so does a clock that goes back by more than _BACK_NS.
_SPLIT_NS = 10_000_000_000
_BACK_NS = 1_000_000_000
_FEWEST = 100  # samples needed for a rate
_NEAR = 0.75  # of the median step: at other steps a sample is missing or late
_BURSTS = 0.3  # a median step below this share of the mean: samples come in bursts
_AROUND = 101  # steps whose mean is the local one
_LONG_GAP = 30.0  # times the mean step: longer than the pause between bursts
_MOST_MISSING = 0.2  # share of the samples, or the record is refused

# Movement and drift.
#: A second counts as moved if it changes by more than this many usual changes, and by _LEAST.
_SCATTERS = 8.0
_LEAST = np.array([0.005] * 3 + [0.05] * 3)  # by hands or wind: 0.3 deg/s; 0.3 deg of tilt
_SHAKEN = 3.0  # times the usual scatter within a second
_FEWEST_SECONDS = 20  # needed for the usual scatter
_FEWEST_OF_DRIFT = 120
_ALL_ALONG_RAD_S = 0.01  # usual change of rate over two seconds: larger than of any sensor at rest
_JOIN_S = 5.0  # moved seconds no further apart are one interval
_SURE = 5.0  # standard deviations of a slope of white noise
_STEADY = 0.9  # share of a series' variance that its slope must explain


@dataclass(frozen=True)
class ImuRecord:
    """Hold a record on its grid; gyroscope x, y, z (rad/s), accelerometer x, y, z (m/s2)."""

    runs: list[Array]  # pieces (n, 6) without a break; NaN where a sample is missing
    starts_s: list[float]  # of the pieces, from the first sample, without clock steps
    step_s: float
    jitter_s: float  # of the stamps: that of the times between samples, over sqrt(2)
    samples: int  # on the grid
    irregular: dict[str, int]  # faults of stamps and values: name -> number

    def blocks(self, size: int, least: float) -> Iterator[tuple[float, Array]]:
        """Yield start (s) and values (size, 6) of blocks with a share of ``least`` or more."""
        for start_s, run in zip(self.starts_s, self.runs, strict=True):
            for begin in range(0, len(run) - size + 1, size):
                block = run[begin : begin + size]
                if np.isfinite(block[:, 0]).mean() >= least:
                    yield start_s + begin * self.step_s, block


def record_of(stamps_ns: IntArray, values: Array) -> ImuRecord:
    """Return the record of samples with stamps (n,) and values (n, 6).

    Raises CalibrationError for a record without a rate, or with too many samples missing.
    """
    finite = np.isfinite(values).all(axis=1)
    times_ns = stamps_ns[finite] - stamps_ns[finite][0]  # small numbers: exact in floats
    steps_ns = np.diff(times_ns, prepend=0)
    # A split where the clock went back far.
    times_ns = times_ns + np.cumsum(np.where(steps_ns < -_BACK_NS, _SPLIT_NS + 1 - steps_ns, 0))
    newest_ns = np.maximum.accumulate(times_ns)[:-1]
    rising = np.concatenate([[True], times_ns[1:] > newest_ns])
    irregular = {
        "not_finite": int((~finite).sum()),
        "repeated_stamps": int((times_ns[1:] == newest_ns).sum()),
        "late_stamps": int((times_ns[1:] < newest_ns).sum()),
        "same_as_before": int((values[1:] == values[:-1]).all(axis=1).sum()),
    }
    kept, times_ns = np.flatnonzero(finite)[rising], times_ns[rising]
    step_ns, places = _places(times_ns)
    edges = [0, *(np.flatnonzero(np.diff(times_ns) > _SPLIT_NS) + 1).tolist(), len(times_ns)]
    runs: list[Array] = []
    off: list[Array] = []
    gaps = 0
    for begin, end in pairwise(edges):
        slots, jitter = _slots(places[begin:end])
        run = values[kept[begin] : kept[end - 1] + 1]
        if not len(run) == end - begin == slots[-1] + 1:  # samples are missing
            run = np.full((int(slots[-1]) + 1, values.shape[1]), np.nan)
            run[slots] = values[kept[begin:end]]
        runs.append(run)
        off.append(jitter)
        gaps += int((np.diff(slots) > 1).sum())
    missing = sum(map(len, runs)) - len(kept)
    lost = missing + irregular["not_finite"]
    if lost > _MOST_MISSING * (len(kept) + lost):
        raise CalibrationError(
            f"{lost} samples are missing or not finite beside {len(kept)} good ones; record "
            "again without loss, with the sensor's own stamps"
        )
    irregular |= {"missing": missing, "gaps": gaps, "splits": len(runs) - 1}
    return ImuRecord(
        runs=runs,
        starts_s=[float(times_ns[begin]) * 1e-9 for begin in edges[:-1]],
        step_s=step_ns * 1e-9,
        jitter_s=float(np.std(np.concatenate(off))) * step_ns * 1e-9 / math.sqrt(2),
        samples=len(kept),
        irregular=irregular,
    )


def _places(times_ns: IntArray) -> tuple[float, Array]:
    """Return the time between samples where none is missing (ns), and the times (n,) in steps.

    A step is the mean of those around, since clocks and rates wander; where samples come in bursts
    it includes the pauses.
    """
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415  slow to import

    steps = np.diff(times_ns).astype(float)
    within = steps <= _SPLIT_NS
    if within.sum() + 1 < _FEWEST:
        raise CalibrationError(
            f"{within.sum() + 1} samples are too few to find their rate; record longer"
        )
    usual = float(np.median(steps[within]))
    for _ in range(2):
        within &= steps <= _LONG_GAP * steps[within].mean()
    if usual >= _BURSTS * steps[within].mean():
        # A late sample makes a long step and then a short one: both count, or neither.
        within = np.abs(steps - usual) <= _NEAR * usual
    step_ns = float(steps[within].mean())
    around = min(_AROUND, len(steps))
    number = uniform_filter1d(within.astype(float), around)
    local = uniform_filter1d(np.where(within, steps, 0.0), around)
    local = np.where(number > 0.5, local / np.maximum(number, 0.5), step_ns)
    return step_ns, np.concatenate([[0.0], np.cumsum(steps / local)])


def _slots(places: Array) -> tuple[IntArray, Array]:
    """Return rising slots (n,) from 0 for samples at times in steps, and steps less slots."""
    # The grid's phase is that of most stamps, whatever the jitter of the first one.
    phase = float(np.angle(np.exp(2j * np.pi * places).mean())) / math.tau
    own = np.arange(len(places))
    slots = np.maximum.accumulate(np.rint(places - phase).astype(np.int64) - own) + own
    return slots - slots[0], np.diff(places) - np.diff(slots)


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
    if len(seconds.starts_s) < _FEWEST_SECONDS:
        return []
    moved = np.zeros(len(seconds.starts_s), bool)
    # From the previous second to the next one: an IMU that stays tilted has moved once.
    jumps = np.abs(seconds.means[2:] - seconds.means[:-2])
    usual = 1.4826 * np.median(jumps, axis=0)
    if usual[:3].max() > _ALL_ALONG_RAD_S:  # moved all the time, so that nothing stands out
        return [Interval(float(seconds.starts_s[0]), float(seconds.starts_s[-1]) + 1.0)]
    moved[1:-1] = (jumps > np.maximum(_SCATTERS * usual, _LEAST)).any(axis=1)
    limit = np.maximum(_SHAKEN * np.median(seconds.scatters, axis=0), _LEAST)
    intervals: list[Interval] = []
    for start in seconds.starts_s[moved | (seconds.scatters > limit).any(axis=1)].tolist():
        joined = intervals and start - intervals[-1].to_s <= _JOIN_S
        begin = intervals.pop().from_s if joined else start
        intervals.append(Interval(begin, start + 1.0))
    return intervals


def longest_stillness(moved: Sequence[Interval], from_s: float, to_s: float) -> Interval:
    """Return the longest time between movements."""
    edges = [from_s, *(edge for interval in moved for edge in interval), to_s]
    rests = [Interval(*edges[i : i + 2]) for i in range(0, len(edges), 2)]
    return max(rests, key=lambda rest: rest.to_s - rest.from_s)


def drifts(seconds: Seconds) -> tuple[Array, BoolArray]:
    """Return changes (6,), unit, from first to last second, and which of them are steady drifts.

    A sensor that warms up drifts so. So does one random walk in twenty; one record cannot separate
    the two. A line must explain most of the minutes' variance, beyond the scatter of the seconds.
    """
    if len(seconds.starts_s) < _FEWEST_OF_DRIFT:
        return np.zeros(6), np.zeros(6, bool)
    line = seconds.starts_s - seconds.starts_s.mean()
    slopes = line @ seconds.means / (line @ line)
    minutes = len(line) // 60
    part = len(line) // minutes * minutes
    series = seconds.means[:part].reshape(minutes, -1, 6).mean(axis=1)
    steps = slopes * line[:part].reshape(minutes, -1).mean(axis=1)[:, None]
    explained = steps.var(axis=0) / np.maximum(series.var(axis=0), 1e-300)
    rest = (seconds.means - line[:, None] * slopes).std(axis=0)
    sure = np.abs(slopes) * math.sqrt(float(line @ line)) > _SURE * rest
    return slopes * np.ptp(line), (explained > _STEADY) & sure
