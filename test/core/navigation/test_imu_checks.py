"""Stamps and readings of the IMU: order, gaps, jumps of the clock, glitches, a frozen sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tirgeo_ros.core.navigation.imu_checks import ImuClock
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import Outcome

SECOND_NS = 1_000_000_000
RNG = np.random.default_rng(3)
GRAVITY = np.array([0, 0, -9.8])
NOISE = RNG.normal(size=(4000, 6)) * 0.01


def live(k, t_s=None):
    """The k-th sample of a 100 Hz IMU."""
    t_s = 0.01 * k if t_s is None else t_s
    noise = NOISE[k % len(NOISE)]
    return ImuSample(1000 * SECOND_NS + round(t_s * SECOND_NS), noise[:3] + GRAVITY, noise[3:])


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
    """Any disorder: what is for use is in order within each time."""
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


@pytest.mark.parametrize("gap_s", [0.21, 1.0, 3600.0])
def test_a_longer_gap_begins_another_time_and_says_so(gap_s):
    clock = started()
    first = clock.check(live(100, 0.99 + gap_s))
    assert (first.outcome, first.use) == (Outcome.WAITING, ())
    assert first.reason == f"{gap_s:.3f} s after the previous one: the next one decides"
    second = clock.check(live(101, 1.0 + gap_s))
    assert (second.outcome, second.begins) == (Outcome.GAP, True)
    assert second.reason == f"no imu/data for {gap_s + 0.01:.3f} s"
    assert len(second.use) == 2
    assert clock.check(live(102, 1.01 + gap_s)).outcome is Outcome.USED


@pytest.mark.parametrize(
    ("back_s", "number"),
    [
        (0.5, 5),  # might be disorder: five in order tell
        (1.0, 5),
        (1.2, 2),  # no network holds a sample back so long
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
    found = [clock.check(live(k, newest_s - back_s + 0.01 * k)) for k in range(1, 20)]
    jump = [c.begins for c in found].index(True)
    assert [c.outcome for c in found[:jump]] == [Outcome.OUT_OF_ORDER] * jump
    assert found[jump].outcome is Outcome.TIME_JUMP
    assert jump + 1 == pytest.approx(number, abs=1)
    assert "went back by" in found[jump].reason
    assert {(c.outcome, c.begins) for c in found[jump + 1 :]} == {(Outcome.USED, False)}


# A frozen sensor


def frozen(begin, end):
    """The reading of the last sample of ``started`` under the stamps of others."""
    return [replace(live(99), stamp_ns=live(k).stamp_ns) for k in range(begin, end)]


def test_a_frozen_sensor_is_noticed_within_a_tenth_of_a_second():
    clock = started()
    found = outcomes(clock, frozen(100, 200))
    first = found.index(Outcome.REPEATED)
    assert 5 <= first + 1 <= 10
    assert Outcome.USED not in found[first:]
    assert clock.check(*frozen(199, 200)).use == ()


@pytest.mark.parametrize(("number", "begins"), [(10, False), (100, True)])
def test_a_sensor_that_thaws_goes_on_or_begins(number, begins):
    """Frozen for a tenth of a second it was a gap to be bridged, for a second another time."""
    clock = started()
    outcomes(clock, frozen(100, 100 + number))
    found = [clock.check(live(k)) for k in range(100 + number, 140 + number)]
    assert any(c.begins for c in found) is begins
    assert {c.outcome for c in found[-30:]} == {Outcome.USED}


def test_a_simulator_without_noise_is_not_frozen():
    """Readings that never changed prove nothing."""
    clock = ImuClock(0.2)
    still = [replace(live(0), stamp_ns=live(k).stamp_ns) for k in range(500)]
    assert set(outcomes(clock, still)) == {Outcome.USED}


def test_a_400_hz_imu_that_is_filled_up_is_not_frozen():
    """Each reading sent four times at 400 Hz: repeats, but not for long."""
    clock = ImuClock(0.2)
    found = outcomes(clock, [live(k // 4, 0.0025 * k) for k in range(4000)])
    assert set(found) == {Outcome.USED}


# Spikes


@pytest.mark.parametrize("max_gap_s", [0.025, 0.04])
def test_a_gap_allowed_for_less_than_two_slow_samples_is_held_to(max_gap_s):
    clock = started(max_gap_s)
    first = clock.check(live(104, 1.035))  # 0.045 s after the newest: the next decides
    assert (first.outcome, first.use) == (Outcome.WAITING, ())
    second = clock.check(live(105, 1.045))
    assert (second.outcome, second.begins, len(second.use)) == (Outcome.GAP, True, 2)
