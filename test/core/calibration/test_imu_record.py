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
"""Records: stamps of all kinds placed on a grid, and movement in one that should be at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from imu_noise import record, walk, white

from tirgeo_ros.core.calibration.imu_record import (
    Interval,
    Seconds,
    drifts,
    movements,
    record_of,
    seconds_of,
)
from tirgeo_ros.core.types.errors import CalibrationError

STEP_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000


def laid(stamps_ns, values=None):
    stamps_ns = START_NS + np.asarray(stamps_ns, np.int64)
    values = np.arange(float(len(stamps_ns)))[:, None] if values is None else values
    return record_of(stamps_ns, values)


def there(record):
    return np.isfinite(np.concatenate(record.runs)[:, 0])


def even(number):
    return np.arange(number) * STEP_NS


def test_even_stamps_fill_each_slot_once():
    record = laid(even(2500))
    (run,) = record.runs
    assert run[:, 0].tolist() == list(range(2500))
    assert record.starts_s == [0.0]
    assert record.step_s == pytest.approx(STEP_NS * 1e-9, rel=1e-9)
    assert record.jitter_s < 1e-9
    assert record.samples == 2500
    assert not any(record.irregular.values())


def test_gaps_are_slots_without_samples():
    gone = [*range(1500, 1700), 2000, 2400]
    record = laid(np.delete(even(3000), gone))
    assert np.flatnonzero(~there(record)).tolist() == gone
    assert (record.irregular["gaps"], record.irregular["missing"]) == (3, 202)


@pytest.mark.parametrize("step_ns", [60_000_000_000, -3_600_000_000_000])
def test_a_long_gap_and_a_clock_that_goes_back_split(step_ns):
    stamps = even(2000)
    stamps[1200:] += step_ns
    record = laid(stamps)
    assert [len(run) for run in record.runs] == [1200, 800]
    after_s = 12 + 60 if step_ns > 0 else 11.99 + 10
    assert record.starts_s == pytest.approx([0, after_s], abs=1e-8)
    assert (record.irregular["splits"], record.irregular["missing"]) == (1, 0)
    assert record.irregular["late_stamps"] == 0


def test_late_and_repeated_samples_are_left_out():
    stamps = even(1000)
    stamps[500] = stamps[499]
    stamps[700] = stamps[690]
    record = laid(stamps)
    faults = record.irregular
    assert (faults["repeated_stamps"], faults["late_stamps"], record.samples) == (1, 1, 998)
    assert np.flatnonzero(~there(record)).tolist() == [500, 700]


def test_values_that_are_not_finite_are_left_out_and_repeated_ones_counted():
    values = np.repeat(np.arange(500.0), 2)[:, None] + np.zeros(6)
    values[300, 2], values[301, 5] = np.nan, np.inf
    record = laid(even(1000), values)
    assert record.irregular["not_finite"] == 2
    assert record.irregular["same_as_before"] == 499
    assert np.flatnonzero(~there(record)).tolist() == [300, 301]


@settings(max_examples=30, deadline=None)
@given(
    jitter=st.floats(0, 0.3),
    rate_hz=st.floats(40, 500),
    unit_ns=st.sampled_from([1, 1000, 1_000_000]),
    seed=st.integers(0, 99),
)
def test_shaking_stamps_keep_every_sample_and_its_time(jitter, rate_hz, unit_ns, seed):
    """Stamps of any rate, rounded as clocks round them, with up to 0.3 of a step of jitter."""
    rng = np.random.default_rng(seed)
    step_ns = 1e9 / rate_hz
    shaken = np.arange(5000) * step_ns + rng.uniform(-jitter, jitter, 5000) * step_ns
    stamps = np.sort(np.round(shaken / unit_ns) * unit_ns).astype(np.int64)
    record = laid(stamps)
    assert record.samples + record.irregular["repeated_stamps"] == 5000
    # Its length equals the stamps', within rounding and the jitter of both ends.
    assert len(there(record)) == pytest.approx(5000, abs=2 + 2 * unit_ns / step_ns)


def test_samples_keep_their_order_and_time_in_bursts_and_by_a_coarse_clock():
    """Bursts of ten, microseconds apart; steps of 6, 6, 8, 6, 9 ms in whole milliseconds."""
    bursts = np.repeat(even(3000)[9::10], 10) + np.tile(np.arange(10) * 1000, 300)
    coarse = np.cumsum(np.resize([6, 6, 8, 6, 9], 3000)) * 1_000_000
    for stamps, step_s in ((bursts, 0.01), (coarse, 0.007)):
        record = laid(stamps)
        (run,) = record.runs
        assert run[there(record), 0].tolist() == list(range(3000))
        # The record ends with a burst, so its step has an error of one burst in 300.
        assert record.step_s == pytest.approx(step_s, rel=0.005)
        assert len(run) == pytest.approx(3000, rel=0.005)


@pytest.mark.parametrize(
    ("stamps_ns", "reason"),
    [
        (even(2), "2 samples are too few to find their rate"),
        (even(3000)[np.random.default_rng(1).random(3000) > 0.4], "missing or not finite"),
    ],
)
def test_records_without_a_rate_are_refused(stamps_ns, reason):
    with pytest.raises(CalibrationError, match=reason):
        laid(stamps_ns)


RATE_HZ = 100
STEP_S = 1 / RATE_HZ
SIZE = 120_000  # 20 min
NOISE = np.repeat([1.7e-4, 1.3e-2], 3)


def rest(seed, size=SIZE):
    rng = np.random.default_rng(seed)
    values = white(rng, (size, 6), NOISE, 1 / RATE_HZ)
    values[:, 5] += 9.8
    return values


def in_seconds(values):
    return seconds_of(record(values, STEP_S))


@pytest.mark.parametrize("seed", range(3))
def test_rest_is_rest(seed):
    seconds = in_seconds(rest(seed))
    assert len(seconds.starts_s) == 1200
    assert movements(seconds) == []
    assert not drifts(seconds)[1].any()


def test_a_turn_a_tilt_and_a_knock_are_named():
    values = rest(2)
    values[30_000:30_250, 2] += 0.05  # turned by 7 deg within 2.5 s
    values[60_000:, 3] += 9.8 * np.sin(np.radians(2))  # put down tilted
    values[90_050, 4] += 20.0  # a knock of one sample
    result = movements(in_seconds(values))
    assert result == [Interval(299, 304), Interval(599, 601), Interval(899, 902)]


def test_a_flight_has_moved_all_along():
    values = rest(4, 12_000)
    values[:, 0] += 0.05 * np.sin(np.arange(12_000) / RATE_HZ)
    assert movements(in_seconds(values)) == [Interval(0, 120)]
    values = rest(4, 12_000)
    values[:, :3] *= 30  # 0.3 deg/sqrt(s): the noisiest gyroscope on sale lies still
    assert movements(in_seconds(values)) == []


def test_a_slow_drift_is_reported_with_its_slope():
    values = rest(3)
    slope = 2e-5 / 60  # rad/s a second
    values[:, 1] += slope * np.arange(SIZE) / RATE_HZ
    changes, steady = drifts(in_seconds(values))
    assert steady.tolist() == [False, True, False, False, False, False]
    # White noise of N lets a slope scatter by N sqrt(12 / T^3): 1.4e-8.
    tolerance = 4 * 1.7e-4 * np.sqrt(12 / 1200**3)
    assert changes[1] / 1199 == pytest.approx(slope, abs=tolerance)


def test_few_random_walks_pass_for_a_drift():
    """A drift explains nine tenths of one random walk in twenty or so."""
    rng = np.random.default_rng(4)
    result = 0
    for _ in range(60):
        means = np.stack([walk(rng, 1200, 1.0, 1.0) for _ in range(6)], axis=1)
        result += drifts(Seconds(np.arange(1200.0), means, means))[1].sum()
    assert result < 0.15 * 360
