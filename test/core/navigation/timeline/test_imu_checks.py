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
"""The IMU's stamps and readings: order, gaps, glitches, a frozen sensor, the end of its range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flights import filtered, flight

from tirgeo_ros.core.navigation.timeline.imu_checks import Clipping, ImuClock
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.calibrate.imu import imu_block

SECOND_NS = 1_000_000_000
NOISE = np.random.default_rng(3).normal(size=(4000, 6)) * 0.01


def live(k, t_s=None):
    """The k-th sample of a 100 Hz IMU."""
    t_s = 0.01 * k if t_s is None else t_s
    force_b, rate_b = np.split(NOISE[k % len(NOISE)], 2)
    return ImuSample(
        1000 * SECOND_NS + round(t_s * SECOND_NS), force_b + np.array([0, 0, -9.8]), rate_b
    )


def outcomes(clock, samples):
    return [clock.check(s).outcome for s in samples]


def started(max_gap_s=0.2, number=100):
    clock = ImuClock(max_gap_s)
    assert set(outcomes(clock, [live(k) for k in range(number)])) == {Outcome.USED}
    return clock


@pytest.mark.parametrize(
    "late",
    # Of one stamp, late, or the last 15 again, as from a bridge.
    [[live(100, 0.99 - back_s)] for back_s in (0.0, 0.01, 0.19)] + [[*map(live, range(85, 100))]],
)
def test_late_and_doubled_samples_are_dropped(late):
    clock = started()
    newest = clock.newest_ns
    for checked in map(clock.check, late):
        assert (checked.outcome, checked.use) == (Outcome.OUT_OF_ORDER, ())
    assert clock.newest_ns == newest
    assert clock.check(live(101)).outcome is Outcome.USED


def test_stamps_grow_whatever_comes():
    """In any disorder, the accepted samples are in order within each time line."""
    rng = np.random.default_rng(8)
    for _ in range(30):
        clock, newest_ns = ImuClock(0.2), -1
        for k in range(400):
            off_s = rng.choice([0.0, rng.normal() * 0.1, rng.normal() * 3], p=[0.6, 0.3, 0.1])
            checked = clock.check(live(k, 10.0 + 0.01 * k + off_s))
            for number, used in enumerate(checked.use):
                if not (checked.begins and number == 0):
                    assert used.stamp_ns > newest_ns
                newest_ns = used.stamp_ns


@pytest.mark.parametrize("glitch_s", [0.06, 0.3, 5.0, 1e6, -0.3, -5.0, -900.0])
def test_a_single_glitched_stamp_is_that_sample_s_fault(glitch_s):
    clock = started()
    checked = clock.check(live(100, 1.0 + glitch_s))
    assert checked.use == ()
    assert not checked.begins
    for k in range(101, 150):
        after = clock.check(live(k))
        assert (after.outcome, after.begins, len(after.use)) == (Outcome.USED, False, 1)


@pytest.mark.parametrize("gap_s", [0.05, 0.1, 0.19, 0.2])
def test_a_gap_up_to_the_limit_is_bridged_with_no_sample_lost(gap_s):
    clock = started()
    used = []
    for k in range(20):
        checked = clock.check(live(100 + k, 0.99 + gap_s + 0.01 * k))
        assert not checked.begins
        used += [s.stamp_ns for s in checked.use]
    assert used == [live(0, 0.99 + gap_s + 0.01 * k).stamp_ns for k in range(20)]


@pytest.mark.parametrize(
    ("max_gap_s", "gap_s"),
    # Gaps shorter than two samples of a slow IMU, too.
    [(0.2, 0.21), (0.2, 1.0), (0.2, 3600.0), (0.025, 0.045), (0.04, 0.045)],
)
def test_a_longer_gap_begins_a_new_time_line_and_is_reported(max_gap_s, gap_s):
    clock = started(max_gap_s)
    first = clock.check(live(100, 0.99 + gap_s))
    assert (first.outcome, first.use) == (Outcome.WAITING, ())
    assert first.reason == f"{gap_s:.3f} s after the previous one: the next one decides"
    second = clock.check(live(101, 1.0 + gap_s))
    assert (second.outcome, second.begins, len(second.use)) == (Outcome.GAP, True, 2)
    assert second.reason == f"no imu/data for {gap_s + 0.01:.3f} s"
    assert clock.check(live(102, 1.01 + gap_s)).outcome is Outcome.USED


@pytest.mark.parametrize(
    ("back_s", "number"),
    [
        (0.5, 5),  # might be disorder: five in order decide
        (1.0, 5),
        (1.2, 2),  # no network delays a sample for so long
        (100.0, 2),
        (1.7e9, 2),  # from epoch to a clock since power-up
    ],
)
def test_a_clock_that_goes_back(back_s, number):
    clock = ImuClock(0.2)
    start_s = 2.0 if back_s < 1e6 else 1.8e9
    steady = [live(k, start_s + 0.01 * k) for k in range(300)]
    assert set(outcomes(clock, steady)) == {Outcome.USED}
    newest_s = start_s + 2.99
    result = [clock.check(live(k, newest_s - back_s + 0.01 * k)) for k in range(1, 20)]
    jump = [c.begins for c in result].index(True)
    assert [c.outcome for c in result[:jump]] == [Outcome.OUT_OF_ORDER] * jump
    assert result[jump].outcome is Outcome.TIME_JUMP
    assert jump + 1 == pytest.approx(number, abs=1)
    assert "went back by" in result[jump].reason
    assert {(c.outcome, c.begins) for c in result[jump + 1 :]} == {(Outcome.USED, False)}


# A frozen sensor


def frozen(begin, end):
    """The last reading of ``started``, repeated with later stamps."""
    return [replace(live(99), stamp_ns=live(k).stamp_ns) for k in range(begin, end)]


def test_a_frozen_sensor_is_noticed_within_a_tenth_of_a_second():
    clock = started()
    result = outcomes(clock, frozen(100, 200))
    first = result.index(Outcome.REPEATED)
    assert 5 <= first + 1 <= 10
    assert Outcome.USED not in result[first:]
    assert clock.check(*frozen(199, 200)).use == ()


@pytest.mark.parametrize(("number", "begins"), [(10, False), (100, True)])
def test_a_sensor_that_thaws_goes_on_or_begins(number, begins):
    """Frozen for 0.1 s it was a gap to bridge; after a second, a new time line begins."""
    clock = started()
    outcomes(clock, frozen(100, 100 + number))
    result = [clock.check(live(k)) for k in range(100 + number, 140 + number)]
    assert any(c.begins for c in result) is begins
    assert {c.outcome for c in result[-30:]} == {Outcome.USED}


@pytest.mark.parametrize(
    "readings",
    [
        # A simulator without noise: readings that never changed prove nothing.
        [replace(live(0), stamp_ns=live(k).stamp_ns) for k in range(500)],
        # Each reading sent four times at 400 Hz: repeats, but not for long.
        [live(k // 4, 0.0025 * k) for k in range(4000)],
    ],
    ids=["no noise", "filled up"],
)
def test_an_imu_that_repeats_itself_is_not_frozen(readings):
    assert set(outcomes(ImuClock(0.2), readings)) == {Outcome.USED}


START_NS = 1_700_000_000_000_000_000
RATE_HZ = 200


def shaken(seed=1, duration_s=10.0, sigma_m_s2=20.0, sigma_rad_s=0.5):
    """(n, 6) force and rate, FRD, of white vibration in z and about x."""
    rng = np.random.default_rng(seed)
    values = 0.05 * rng.standard_normal((round(duration_s * RATE_HZ), 6))
    values[:, 2] += sigma_m_s2 * rng.standard_normal(len(values)) - 9.8
    values[:, 3] += sigma_rad_s * rng.standard_normal(len(values))
    return values


def samples(values, rate_hz=RATE_HZ):
    return [
        ImuSample(START_NS + round(k * SECOND_NS / rate_hz), row[:3], row[3:])
        for k, row in enumerate(values)
    ]


def followed(values, rate_hz=RATE_HZ):
    clipping = Clipping()
    for sample in samples(values, rate_hz):
        clipping.add(sample)
    return clipping


def stepped(values, step_m_s2):
    """Quantised; a gyroscope of 2000 deg/s has a quarter of the step of 16 g, in SI units."""
    steps = np.repeat([step_m_s2, step_m_s2 / 4.5], 3)
    return np.round(values / steps) * steps


@pytest.mark.parametrize("range_m_s2", [39.2266, 78.4532, 37.0])
def test_an_accelerometer_at_its_end_is_counted(range_m_s2):
    values = shaken(sigma_m_s2=0.6 * range_m_s2)
    clipped = values.copy()
    clipped[:, 2] = np.clip(values[:, 2], -range_m_s2, range_m_s2)
    clipping = followed(clipped)
    # Those of the first second may be missed: the end is not known yet.
    true = int((np.abs(values[:, 2]) > range_m_s2).sum())
    assert list(clipping.counts) == ["accelerometer z"]
    assert 0.8 * true < clipping.counts["accelerometer z"] <= true
    now_ns = START_NS + 10 * SECOND_NS
    assert clipping.active(now_ns)
    (warning,) = clipping.warnings(now_ns)
    assert warning.startswith(f"imu/data: accelerometer z clipped at {range_m_s2:.3g} m/s2 (")
    assert warning.endswith(" samples in 1 s): vibration beyond its range")


def test_clipping_ends():
    values = np.clip(shaken(sigma_m_s2=30.0), -39.2, 39.2)
    clipping = followed(values)
    end_ns = clipping.newest_ns
    assert clipping.active(end_ns + SECOND_NS)
    assert not clipping.active(end_ns + SECOND_NS + 1)
    assert clipping.warnings(end_ns + 2 * SECOND_NS)
    assert clipping.warnings(end_ns + 6 * SECOND_NS) == ()
    assert clipping.counts["accelerometer z"] > 0
    for sample in samples(values):  # again, 60 s later
        clipping.add(replace(sample, stamp_ns=sample.stamp_ns + 60 * SECOND_NS))
    assert clipping.newest_ns >= end_ns + 59 * SECOND_NS


@pytest.mark.slow
@pytest.mark.parametrize("step_m_s2", [0.0, 0.0048, 0.02, 0.08])
@pytest.mark.parametrize("seed", range(4))
def test_strong_vibration_within_the_range_is_no_clipping(seed, step_m_s2):
    """White, and a line that wanders; readings of 10 to 16 bits."""
    values = shaken(seed, 60.0)
    rng = np.random.default_rng(seed)
    phase = np.cumsum(rng.uniform(20, 90) + rng.standard_normal(len(values))) / RATE_HZ
    values[:, 1] += 25.0 * np.sin(2 * np.pi * phase)
    values[:, 4] += 4.0 * np.sin(2 * np.pi * phase)
    if step_m_s2:
        values = stepped(values, step_m_s2)
    assert followed(values).counts == {}


def test_long_turns_rest_and_repeated_readings_are_no_clipping():
    values = shaken(2, 60.0, 0.1, 0.01)
    values[:, 2] -= 12.0 * np.hanning(len(values))  # 2.2 g
    values[:, 5] += 3.0 * np.hanning(len(values))
    frozen = shaken(3)
    frozen[1000:] = frozen[1000]
    frozen[1000:, 2] = -60.0
    slow = np.repeat(shaken(4), 6, axis=0)
    half_slow = slow.copy()
    half_slow[:, 3:] = np.random.default_rng(1).standard_normal((len(slow), 3))
    rest = np.tile([0.0, 0.0, -9.8, 0, 0, 0], (2000, 1))
    for still in (values, stepped(values, 0.3), rest, frozen):
        assert followed(still).counts == {}
    for repeated in (slow, half_slow):
        assert followed(repeated, 6 * RATE_HZ).counts == {}


def test_navigation_counts_and_warns():
    rng = np.random.default_rng(1)

    def shaken_too(sample, _):
        if not isinstance(sample, ImuSample):
            return sample
        force_b = sample.specific_force_b + np.array([0, 0, 25.0 * rng.standard_normal()])
        return replace(sample, specific_force_b=np.clip(force_b, -39.2, 39.2))

    status = filtered(flight(duration_s=8.0), shaken_too).status
    assert status.clipped["accelerometer z"] > 50
    assert "accelerometer z clipped at 39.2 m/s2" in status.warnings[0]
    assert status.counts["imu", "used"] > 0  # clipped samples are used nevertheless


def test_no_recorded_flight_clips(sample, shared):
    bags = [sample / "flight.mcap", *sorted((shared / "real_flights").glob("*.mcap"))]
    assert len(bags) > 1
    for bag in bags:
        block = imu_block([m.data for m in BagReader(bag).messages(["/imu/data"])])
        frd = block.values[:, [3, 4, 5, 0, 1, 2]] * [1, -1, -1, 1, -1, -1]
        assert followed(frd, 120).counts == {}, bag
