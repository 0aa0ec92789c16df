"""Aids whose clock is not the IMU's: counted, bounded and named, before alignment and after."""

from __future__ import annotations

from dataclasses import replace

import pytest
from flights import GPS, RTK, config_for, flight, navigation_samples

from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import FilterState


def moved(samples, by_s):
    """RTK's stamps by another clock."""
    return [
        replace(s, stamp_ns=s.stamp_ns + round(by_s * 1e9)) if s.source in RTK else s
        for s in samples
    ]


def statuses(flown, fed, **values):
    """After each sample up to the last of the IMU: aids go on to come for a while after it."""
    navigation = Navigation(config_for(flown, **values))
    last = max(k for k, sample in enumerate(fed) if isinstance(sample, ImuSample))
    found = []
    for sample in fed[: last + 1]:
        navigation.process(sample)
        found.append(navigation.status())
    return found


@pytest.mark.parametrize(
    ("by_s", "outcome", "said"),
    [
        (18.0, "too_new", "17.9 s ahead of imu/data: same clock? (GPS time is 18 s ahead of UTC)"),
        (-18.0, "too_old", "18.1 s behind imu/data: same clock? (GPS time is 18 s ahead of UTC)"),
        (130.0, "too_new", "129.9 s ahead of imu/data: same clock?"),
    ],
)
def test_another_clock_is_named_while_aligning(by_s, outcome, said):
    flown = flight(duration_s=12.0)
    fed = [s for s in moved(navigation_samples(flown), by_s) if s.source not in GPS]
    last = statuses(flown, fed)[-1]
    assert last.state is FilterState.ALIGNING
    assert last.reason == f"rtk/fix is {said}; rtk/vel, rtk/heading too"
    assert last.counts["rtk_position", outcome] == 60  # 12 s at 5 Hz; the IMU was there first
    assert ("rtk_position", "waiting") not in last.counts


def test_on_ordinary_gps_it_starts_and_goes_on_telling():
    flown = flight(duration_s=12.0)
    found = statuses(flown, moved(navigation_samples(flown), 18.0))
    assert {s.state for s in found[-200:]} == {FilterState.DEGRADED}
    assert "no imu/data" not in " ".join(s.reason for s in found)
    assert "rtk/fix is 17.9 s ahead of imu/data: same clock?" in found[-1].reason


def test_a_delay_longer_than_allowed_is_named_as_such():
    flown = flight(duration_s=12.0)
    late = moved(navigation_samples(flown), -0.7)
    late.sort(key=lambda s: s.stamp_ns + (780_000_000 if s.source in RTK else 0))  # as they came
    last = statuses(flown, late, alignment__wait_s=1.0)[-1]
    assert "rtk/fix is 0.8 s behind imu/data: more than max_delay_s, 0.5 s" in last.reason


def test_a_clock_that_is_right_again_is_not_named_any_more():
    flown = flight(duration_s=16.0)
    samples = navigation_samples(flown)
    half = len(samples) // 2
    found = statuses(flown, moved(samples[:half], 18.0) + samples[half:])
    assert "same clock?" in found[half - 1].reason
    assert found[-1].reason == ""
    assert found[-1].state is FilterState.RUNNING


def test_an_aid_of_another_clock_does_not_silence_the_imu():
    """Bursts of aids between two IMU samples, as at 50 Hz: it is there, whatever they stamp."""
    flown = flight(duration_s=6.0)
    fed = moved(navigation_samples(flown), 18.0)
    burst = [s for sample in fed for s in [sample] * (5 if sample.source in RTK else 1)]
    assert not any("no imu/data" in status.reason for status in statuses(flown, burst))
