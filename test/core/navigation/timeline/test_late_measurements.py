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
"""Measurements late, early or absent, wrong stamps, and clocks that are not the IMU's."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from alignments import aligned
from filter_states import ekf_config
from flights import (
    GPS,
    RTK,
    config_for,
    flight,
    navigation_samples,
    solutions,
    without,
)

from tirgeo_ros.core.navigation.aiding.fusion import Delays, longest_hold_s
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.timeline.ekf import Ekf
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, ImuSample, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from


def started(flown, samples, **values):
    """A filter that has just been aligned, and the samples that follow."""
    config, rest = config_for(flown, **values), iter(samples)
    result, _ = aligned(rest, config)
    filter_ = Ekf(config, result)
    run(filter_, (*result.imu[1:], *result.later))
    return filter_, list(rest)


def run(filter_, samples):
    """The verdicts, including those on held samples."""
    verdicts = []
    for sample in samples:
        if isinstance(sample, ImuSample):
            verdicts += filter_.add_imu(sample)
        else:
            verdicts.append(filter_.add_aiding(sample))
    return verdicts


def fixes_of(samples):
    return [s for s in samples if s.source is Source.RTK_POSITION]


def between_imu_samples(sample, _):
    return replace(sample, stamp_ns=sample.stamp_ns + 3_300_000)


def gps_between_imu_samples(sample, _):
    return between_imu_samples(sample, _) if sample.source in GPS else sample


outage = without(*RTK, begin_s=4.0, end_s=8.0)


def rtk_position(begin_s=3.0, end_s=7.0, height_m=0.0, **changes):
    """RTK's positions changed for a while."""

    def change(sample, t_s):
        if sample.source is not Source.RTK_POSITION or not begin_s < t_s < end_s:
            return sample
        return replace(sample, height_m=sample.height_m + height_m, **changes)

    return change


def wrong_headings(sample, t_s):
    if isinstance(sample, HeadingSample) and 2.0 < t_s < 9.0:
        return replace(sample, heading_rad=sample.heading_rad + 1.0)
    return sample


def changed_samples(flown, change):
    """All samples but the last; ``change`` takes each aiding one and its time, s."""
    start_ns, end_ns = flown.truth.stamp_ns[0], flown.truth.stamp_ns[-1] - 500_000_000
    samples = [
        s if isinstance(s, ImuSample) else change(s, (s.stamp_ns - start_ns) * 1e-9)
        for s in navigation_samples(flown)
        if isinstance(s, ImuSample) or s.stamp_ns <= end_ns
    ]
    return [sample for sample in samples if sample is not None]


def shuffled_by(rng, samples):
    """In the order of arrival where each measurement has its own 0 to 0.45 s of delay."""
    arrival = [
        s.stamp_ns + (0 if isinstance(s, ImuSample) else int(rng.integers(0, 450_000_000)))
        for s in samples
    ]
    return [samples[i] for i in np.argsort(arrival, kind="stable")]


CHANGES = {
    "plain": lambda sample, _: sample,
    "between": between_imu_samples,
    "gps_between": gps_between_imu_samples,
    "outage": outage,
    "float": rtk_position(status=FixStatus.FLOAT),
    "no_fix": rtk_position(status=FixStatus.NONE),
    # For four seconds, so the state follows: refusals, a reset, and another one back.
    "jump": rtk_position(height_m=5.0),
    "wrong_headings": wrong_headings,
    "barometer": without(*RTK, *GPS, begin_s=4.0),
    "outage_between": lambda sample, t_s: outage(gps_between_imu_samples(sample, t_s), t_s),
}


#: An antenna's place to estimate, and a barometer good enough to be used within seconds.
VALUES = {
    "aircraft__rtk_antenna_sigma_m": (0.05, 0.05, 0.05),
    "barometer__sigma_m": 0.01,
    "barometer__noise_m": 0.02,
    "barometer__drift": 0.001,
}


@functools.cache
def with_barometer():
    return fly(scenario_from({"barometer.rate_hz": 10.0, "duration_s": 12.0}, "test"), 2)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_late_measurements_give_the_timely_result(change):
    """Each measurement delayed by its own 0 to 0.45 s, any order: the state of timely arrival.

    Of what the aids have done too, so their decisions are those of the measurements' order.
    """
    flown = with_barometer()
    samples = changed_samples(flown, change)
    timely, rest = started(flown, samples, **VALUES)
    by_stamp = sorted(rest, key=lambda s: (s.stamp_ns, not isinstance(s, ImuSample)))
    run(timely, by_stamp)
    expected = timely.estimate()
    for seed in range(3):
        late, _ = started(flown, samples, **VALUES)
        run(late, shuffled_by(np.random.default_rng(seed), by_stamp))
        result = late.estimate()
        # The same operations in the same order: equal to the last bit.
        np.testing.assert_equal(result.aids, expected.aids)
        assert result.state == expected.state
        assert np.array_equal(result.covariance, expected.covariance)


def test_a_measurement_before_its_imu_sample_is_held_and_used():
    flown = flight(duration_s=8.0)
    filter_, rest = started(flown, navigation_samples(flown))
    imu = [s for s in rest if isinstance(s, ImuSample)]
    fix = next(s for s in fixes_of(rest) if s.stamp_ns > imu[0].stamp_ns)
    early = [s for s in imu if s.stamp_ns < fix.stamp_ns]
    run(filter_, early)
    assert filter_.add_aiding(fix).outcome is Outcome.WAITING
    assert filter_.add_aiding(fix).outcome is Outcome.REPEATED
    result = run(filter_, imu[len(early) : len(early) + 2])
    assert [(v.source, v.outcome) for v in result] == [(Source.RTK_POSITION, Outcome.USED)]
    assert run(filter_, imu[len(early) + 2 : len(early) + 4]) == []


def test_refusals():
    flown = flight(duration_s=8.0)
    filter_, rest = started(flown, navigation_samples(flown))
    run(filter_, rest)
    fix = fixes_of(rest)[-1]
    newest = filter_.newest_ns
    assert filter_.add_aiding(fix).outcome is Outcome.REPEATED
    old = replace(fix, stamp_ns=newest - 500_000_001)
    assert filter_.add_aiding(old).outcome is Outcome.TOO_OLD
    new = replace(fix, stamp_ns=newest + 500_000_001)
    assert filter_.add_aiding(new).outcome is Outcome.TOO_NEW
    before = filter_.estimate().state
    jump = replace(fix, stamp_ns=newest - 10_000_000, height_m=fix.height_m + 5)
    assert filter_.add_aiding(jump).outcome is Outcome.GATED
    # A measurement at the newest stamp is applied again with a covariance that took its steps at
    # other instants: second order in 20 ms.
    for a, b in zip(filter_.estimate().state[0], before[0], strict=True):
        assert a == pytest.approx(b, abs=1e-6)


def test_the_history_is_as_long_as_the_delay():
    """Memory does not grow, and what is within the delay is always there."""
    flown = flight(duration_s=30.0)
    filter_, rest = started(flown, navigation_samples(flown))
    lengths = []
    for sample in rest:
        run(filter_, [sample])
        lengths.append(len(filter_._epochs))
    # 0.5 s at 100 Hz, forgotten in batches of 64, one before.
    assert max(lengths) <= 50 + 64 + 2
    fix = fixes_of(rest)[-1]
    oldest = replace(fix, stamp_ns=filter_.newest_ns - 500_000_000)
    assert filter_.add_aiding(oldest).outcome is not Outcome.TOO_OLD


def test_headings_have_the_delay_of_rtk_unless_they_have_their_own():
    shared = Delays.from_config(ekf_config(rtk__delay_s=0.08, gps__delay_s=-0.1))
    assert [shared.aid_ns[s] for s in RTK] == [80_000_000] * 3
    assert shared.aid_ns[Source.GPS_VELOCITY] == -100_000_000
    values = {"rtk__delay_s": 0.08, "heading__delay_s": 0.0, "rtk__velocity_delay_s": 0.05}
    own = Delays.from_config(ekf_config(**values))
    assert [own.aid_ns[s] for s in RTK] == [80_000_000, 130_000_000, 0]


@pytest.mark.parametrize(
    ("values", "hold_s"),
    [
        ({}, 0.5),
        ({"max_delay_s": 0.0}, 0.2),
        ({"rtk__delay_s": 1.0, "gps__delay_s": 1.0}, 0.5),
        ({"rtk__delay_s": 1.0, "rtk__velocity_delay_s": -1.5}, 1.0),
        ({"gps__delay_s": -1.0, "imu__delay_s": 0.25}, 1.75),
        # A barometer without a delay does not count; one that is early does.
        ({"rtk__delay_s": 0.1, "gps__delay_s": 0.1, "imu__delay_s": 0.1}, 0.5),
        ({"barometer__delay_s": -0.3, "imu__delay_s": 0.1}, 0.9),
    ],
)
def test_measurements_ahead_of_the_imu_by_their_delay_are_held_for_longer(values, hold_s):
    assert longest_hold_s(ekf_config(**values)) == pytest.approx(hold_s, abs=1e-9)


@pytest.mark.parametrize(
    ("imu_s", "position_s", "velocity_s", "heading_s"),
    [(0.0, -0.3, -0.3, -0.3), (0.005, 0.08, 0.2, -0.25), (-0.4, 0.3, -1.2, 2.0)],
)
def test_stamps_less_their_delay_are_those_of_measurement(
    imu_s, position_s, velocity_s, heading_s
):
    """Each kind has its own: the same solutions to the last bit, from the alignment on."""
    flown = flight(duration_s=12.0)
    kinds = {
        "imu__delay_s": imu_s,
        "rtk__delay_s": position_s,
        "rtk__velocity_delay_s": velocity_s - position_s,
        "heading__delay_s": heading_s,
    }
    by_s = dict(zip(RTK, (position_s, velocity_s, heading_s), strict=True)) | {Source.IMU: imu_s}
    fed = [s for s in navigation_samples(flown) if s.source not in GPS]
    late = [replace(s, stamp_ns=s.stamp_ns + round(by_s[s.source] * 1e9)) for s in fed]
    timely = solutions(flown, config_for(flown), fed)
    moved = solutions(flown, config_for(flown, **kinds), late)
    assert len(moved) == len(timely) > 0
    for a, b in zip(timely, moved, strict=True):
        assert (a.stamp_ns, a.height_m, a.latitude_rad) == (b.stamp_ns, b.height_m, b.latitude_rad)
        assert np.array_equal(a.q_nb, b.q_nb)


def moved(samples, by_s):
    """RTK's stamps by another clock."""
    return [
        replace(s, stamp_ns=s.stamp_ns + round(by_s * 1e9)) if s.source in RTK else s
        for s in samples
    ]


def statuses(flown, fed, **values):
    """The status after each sample up to the IMU's last one: aids go on after that."""
    navigation = Navigation(config_for(flown, **values))
    last = max(k for k, sample in enumerate(fed) if isinstance(sample, ImuSample))
    result = []
    for sample in fed[: last + 1]:
        navigation.process(sample)
        result.append(navigation.status())
    return result


CLOCK = "imu/data: do both use the same clock?"


@pytest.mark.parametrize(
    ("by_s", "outcome", "reason"),
    [
        (18.0, "too_new", f"17.9 s ahead of {CLOCK} (GPS time is 18 s ahead of UTC)"),
        (-18.0, "too_old", f"18.1 s behind {CLOCK} (GPS time is 18 s ahead of UTC)"),
        (130.0, "too_new", f"129.9 s ahead of {CLOCK}"),
    ],
)
def test_another_clock_is_named_while_aligning(by_s, outcome, reason):
    flown = flight(duration_s=12.0)
    fed = [s for s in moved(navigation_samples(flown), by_s) if s.source not in GPS]
    last = statuses(flown, fed)[-1]
    assert last.state is FilterState.ALIGNING
    assert last.reason == f"rtk/fix is {reason}; rtk/vel, rtk/heading too"
    assert last.counts["rtk_position", outcome] == 60  # 12 s at 5 Hz; the IMU was there first
    assert ("rtk_position", "waiting") not in last.counts


def test_on_ordinary_gps_it_starts_and_still_names_the_clock():
    """Bursts of aids between two IMU samples, as at 50 Hz, do not silence the IMU."""
    flown = flight(duration_s=12.0)
    fed = moved(navigation_samples(flown), 18.0)
    burst = [s for sample in fed for s in [sample] * (5 if sample.source in RTK else 1)]
    result = statuses(flown, burst)
    assert {s.state for s in result[-200:]} == {FilterState.DEGRADED}
    assert "no imu/data" not in " ".join(s.reason for s in result)
    assert f"rtk/fix is 17.9 s ahead of {CLOCK}" in result[-1].reason


def test_a_delay_longer_than_allowed_is_named():
    flown = flight(duration_s=12.0)
    late = moved(navigation_samples(flown), -0.7)
    late.sort(
        key=lambda s: s.stamp_ns + (780_000_000 if s.source in RTK else 0)
    )  # in order of arrival
    last = statuses(flown, late, alignment__wait_s=1.0)[-1]
    assert "rtk/fix is 0.8 s behind imu/data: more than max_delay_s, 0.5 s" in last.reason


def test_a_clock_that_is_right_again_is_not_named_any_more():
    flown = flight(duration_s=16.0)
    samples = navigation_samples(flown)
    half = len(samples) // 2
    result = statuses(flown, moved(samples[:half], 18.0) + samples[half:])
    assert CLOCK in result[half - 1].reason
    assert result[-1].reason == ""
    assert result[-1].state is FilterState.RUNNING
