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
"""The filter's start by stamps, its state from the records of the aids, LOST, and mean NIS."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from filter_states import RTK, SECOND_NS, TIMEOUT_NS, ekf_config, used_at
from flights import config_for, filtered, flight, navigation_samples

from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.estimator.filter_status import FilterHealth, VerdictLog
from tirgeo_ros.core.navigation.estimator.start_up import StampOrder
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import FilterState, Outcome, Verdict

NOW_NS = 1000 * SECOND_NS


def health(**values):
    return FilterHealth(ekf_config(trust__aid_timeout_s=1.0, **values))


def aids_used(*sources, status=FixStatus.FIXED, age_ns=0):
    """The records after these sources were used ``age_ns`` ago."""
    aids = used_at(dict.fromkeys(sources, NOW_NS - age_ns))
    return aids.with_status(status, NOW_NS - age_ns, TIMEOUT_NS)


ALL_MISSING = "no rtk/fix, rtk/vel, rtk/heading, gps/fix"


@pytest.mark.parametrize(
    ("aids", "state", "reason"),
    [
        (aids_used(*RTK), FilterState.RUNNING, ""),
        (aids_used(*RTK, Source.GPS_POSITION, Source.GPS_VELOCITY), FilterState.RUNNING, ""),
        (aids_used(*RTK[:2]), FilterState.DEGRADED, "no rtk/heading"),
        (aids_used(RTK[0], RTK[2]), FilterState.DEGRADED, "no rtk/vel"),
        (aids_used(*RTK[1:]), FilterState.DEAD_RECKONING, "no rtk/fix, gps/fix"),
        (aids_used(*RTK[1:], Source.GPS_POSITION), FilterState.DEGRADED, "no rtk/fix"),
        (
            aids_used(Source.GPS_POSITION, Source.GPS_VELOCITY),
            FilterState.DEGRADED,
            "no rtk/fix, rtk/vel, rtk/heading",
        ),
        (aids_used(), FilterState.DEAD_RECKONING, ALL_MISSING),
        (aids_used(Source.GPS_VELOCITY), FilterState.DEAD_RECKONING, ALL_MISSING),
        # Missing after their time out.
        (aids_used(*RTK, age_ns=TIMEOUT_NS), FilterState.RUNNING, ""),
        (aids_used(*RTK, age_ns=TIMEOUT_NS + 1), FilterState.DEAD_RECKONING, ALL_MISSING),
        (
            aids_used(*RTK[:2], status=FixStatus.FLOAT),
            FilterState.DEGRADED,
            "rtk/fix is float, no rtk/heading",
        ),
    ],
)
def test_state_names_missing_aids(aids, state, reason):
    assert health().state(aids, NOW_NS) == (state, reason)


def test_an_aid_that_is_refused_is_not_reported_as_missing():
    gated = Verdict(Source.RTK_HEADING, Outcome.GATED, "90 deg off; antennas swapped?")
    poor = Verdict(Source.RTK_VELOCITY, Outcome.NOT_FIXED, "status single")
    log = VerdictLog()
    for verdict in (gated, poor):
        log.add(verdict, NOW_NS - TIMEOUT_NS)
    reports = log.unused
    result = health().state(aids_used(Source.GPS_POSITION), NOW_NS, reports)
    reason = (
        "rtk/vel not used: status single, "
        "rtk/heading refused: 90 deg off; antennas swapped?, no rtk/fix"
    )
    assert result == (FilterState.DEGRADED, reason)
    silent = health().state(aids_used(Source.GPS_POSITION), NOW_NS + 1, reports)
    assert silent == (FilterState.DEGRADED, "no rtk/fix, rtk/vel, rtk/heading")


# Lost


STATES = range(ANTENNA.start)
COVARIANCE = np.diag([1e-3] * 6 + [1e-2] * 3 + [1e-3] * (ANTENNA.start - 9)) ** 2


@pytest.mark.parametrize(
    ("place", "sigma", "why"),
    [
        (7, 9.99, ""),
        *((place, 10.1, "position sigma 10.1 m") for place in (6, 7, 8)),
        (2, math.radians(9.99), ""),
        (2, math.radians(10.01), "heading sigma 10.0 deg"),
        *((n, bad, "covariance not finite") for n in STATES for bad in (math.nan, math.inf)),
        *((place, 1e-9j, "covariance with a negative variance") for place in STATES),
    ],
)
def test_lost_beyond_the_sigmas(place, sigma, why):
    covariance = COVARIANCE.copy()
    covariance[place, place] = (sigma**2).real
    assert health().lost(aids_used(*RTK), covariance) == why
    spoiled = "covariance" in why
    assert health().spoiled(aids_used(*RTK), covariance) is spoiled


def test_lost_after_resets_that_do_not_help():
    aids = aids_used(*RTK)
    for second in range(3):
        assert health().lost(aids, COVARIANCE) == ""
        aids = aids.with_reset(Source.RTK_POSITION, NOW_NS + second * SECOND_NS, "moved")
    assert health().lost(aids, COVARIANCE) == "reset repeatedly: moved"
    assert health().spoiled(aids, COVARIANCE)


# The accuracy that a receiver reports


def fix(variances, source=Source.GPS_POSITION, status=FixStatus.SINGLE):
    return PositionSample(NOW_NS, source, status, 0.7, 2.0, 20.0, np.diag(variances))


def test_bounds_and_text_of_the_reported_accuracy():
    reported = health()
    assert reported.bounds_m2() == [100.0] * 3
    reported.take_position(fix((0.0, 0.0, 0.0)))
    reported.take_position(fix((1e4,) * 3, status=FixStatus.NONE))
    assert (reported.bounds_m2(), reported.poor_gps()) == ([100.0] * 3, "")
    reported.take_position(fix((400.0, 25.0, 1e4)))
    reported.take_position(fix((1e-4,) * 3, Source.RTK_POSITION, FixStatus.FIXED))
    assert reported.bounds_m2() == pytest.approx([900.0, 100.0, 22500.0])
    assert reported.poor_gps() == "gps/fix has a sigma of 20 m, 100 m in height"


# Counts and innovations


def filled(values, step_s=0.2, source=Source.RTK_VELOCITY):
    log = VerdictLog()
    for k, nis in enumerate(values):
        verdict = Verdict(source, Outcome.USED, "", 0.1, (0.0,) * 3, nis)
        log.add(verdict, round(k * step_s * SECOND_NS))
    return log, round((len(values) - 1) * step_s * SECOND_NS)


def test_the_mean_is_that_of_half_a_minute():
    log, now_ns = filled([9.0] * 150 + [1.0] * 151)
    assert log.nis(now_ns) == {"rtk_velocity": pytest.approx(1.0)}
    log, now_ns = filled([9.0] * 225 + [1.0] * 76)
    assert log.nis(now_ns)["rtk_velocity"] == pytest.approx((75 * 9 + 76) / 151)
    for number in (19, 20):  # fewer than 20 are not reported
        log, now_ns = filled([9.0] * number)
        assert bool(log.nis(now_ns)) is bool(list(log.warnings(now_ns))) is (number == 20)


def test_a_high_nis_is_named_with_the_parameters_to_check():
    log, now_ns = filled([4.1] * 100)
    (reports,) = log.warnings(now_ns)
    assert reports.startswith("rtk/vel: innovations are 2.0 times their sigma over 30 s: look at ")
    assert "rtk.velocity_delay_s" in reports
    assert ";" not in reports  # it separates warnings in diagnostics
    assert not list(filled([3.9] * 100)[0].warnings(now_ns))
    assert not list(log.warnings(now_ns + 31 * SECOND_NS))  # silent since


@pytest.mark.slow
def test_a_flight_whose_velocities_are_late_is_warned_of():
    """A good one has a NIS of 1 and no warning; 0.2 s at 1.5 m/s2 are 0.3 m/s, 15 sigma."""
    flown = flight(duration_s=45.0)
    result = filtered(flown).status
    late = filtered(flown, rtk__velocity_delay_s=-0.2, rtk__gate_sigma=1e3).status
    # 150 velocities of three axes: the mean of squares has a spread of sqrt(2 / 450).
    assert result.nis["rtk_velocity"] == pytest.approx(1.0, abs=4 * math.sqrt(2 / 450))
    assert set(result.nis) >= {"rtk_position", "rtk_velocity", "rtk_heading"}
    assert result.warnings == ()
    assert np.all(np.array(result.vibration) > 0)
    assert result.process_noise == "parameters"
    (reports,) = [text for text in late.warnings if text.startswith("rtk/vel")]
    assert "rtk.velocity_delay_s" in reports


def test_vibration_takes_over_from_the_parameters():
    rng = np.random.default_rng(3)

    def shaken(sample, _):
        if not isinstance(sample, ImuSample):
            return sample
        force_b = sample.specific_force_b + rng.normal(size=3) * 2.0
        return replace(sample, specific_force_b=force_b)

    status = filtered(flight(duration_s=12.0), shaken).status
    assert status.process_noise == "vibration"
    # 2 m/s2 at 100 Hz are 0.2 m/s/sqrt(s); the mean of 3 s is good to 8 %, five of these.
    assert status.vibration[3:] == pytest.approx([0.2] * 3, rel=0.4)


S = 10**9


def position(stamp_ns):
    return PositionSample(
        stamp_ns, Source.RTK_POSITION, FixStatus.FIXED, 0.5, 0.1, 20.0, 1e-4 * np.eye(3)
    )


def imu(stamp_ns):
    return ImuSample(stamp_ns, np.array([0.0, 0.0, -9.8]), np.zeros(3))


def delayed(rng, samples, longest_s):
    """In the order of arrival over links that halt at times; each source keeps its order."""
    free_ns, arrival = {}, []
    for sample in samples:
        link = getattr(sample, "source", type(sample))
        if rng.random() < 0.02:
            until_ns = sample.stamp_ns + int(rng.uniform(0, longest_s) * S)
            free_ns[link] = max(free_ns.get(link, 0), until_ns)
        arrival.append(max(sample.stamp_ns, free_ns.get(link, 0)))
    return [samples[i] for i in np.argsort(arrival, kind="stable")]


def started(flown, samples, method):
    """The first solution, and the estimate once all samples are there."""
    navigation = Navigation(config_for(flown, method=method))
    solutions = [navigation.process(sample).solution for sample in samples]
    first = next(solution for solution in solutions if solution is not None)
    return first, navigation._ekf.estimate()


@pytest.mark.parametrize("method", ["ekf", "ekf_heading"])
def test_the_start_does_not_depend_on_arrival(method):
    flown = flight(duration_s=6.0)
    samples = navigation_samples(flown)
    last_ns = samples[-1].stamp_ns - S  # of measurements: later ones may not have come
    samples = [s for s in samples if isinstance(s, ImuSample) or s.stamp_ns < last_ns]
    first, estimate = started(flown, samples, method)
    for seed in range(5):
        disturbed = delayed(np.random.default_rng(seed), samples, 0.45)  # max_delay_s is 0.5
        assert disturbed != samples
        other, other_estimate = started(flown, disturbed, method)
        assert abs(other.stamp_ns - first.stamp_ns) <= 0.5 * S  # when the IMU's samples come again
        np.testing.assert_allclose(other_estimate.state.q_nb, estimate.state.q_nb, atol=1e-12)
        np.testing.assert_allclose(
            other_estimate.covariance, estimate.covariance, rtol=1e-6, atol=1e-15
        )


def test_samples_come_out_by_stamp_once_the_imu_is_far_enough():
    order = StampOrder(0.5, 0.7, 7.5)
    assert order.add(position(3 * S)) == []
    assert order.add(position(2 * S)) == []
    assert order.add(imu(int(2.4 * S))) == []
    result = order.add(imu(int(2.6 * S)))
    assert [sample.stamp_ns for sample in result] == [2 * S]
    assert [s.stamp_ns for s in order.add(position(1 * S))] == [1 * S]  # late, and not lost
    assert [s.stamp_ns for s in order.pop_until()] == [int(2.4 * S), int(2.6 * S), 3 * S]
    assert order.pop_until() == []


def test_a_flood_of_aids_without_an_imu_stays_bounded_and_is_named():
    """Whatever their stamps: of one instant, going back, or far ahead."""
    order, source = StampOrder(0.5, 0.7, 7.5), Source.RTK_POSITION
    for k in range(10_000):
        order.add(position(10**12 - (k % 3) * k * 10**6))
    many = Verdict(source, Outcome.TOO_MANY, "120 newer samples wait for imu/data")  # 100 a second
    assert list(map(str, order.given_up())) == [str(many)] * (10_000 - 120)
    order.add(imu(10**11))
    assert {(v.source, v.outcome) for v in order.given_up()} == {
        (Source.RTK_POSITION, Outcome.TOO_NEW)
    }
    assert len(order.pop_until()) == 1  # all of them were ahead of its clock
    assert order.given_up() == []


def test_a_flood_beside_an_imu_stays_bounded_and_takes_nothing_from_the_others():
    """A receiver at 10 kHz ahead of an IMU that stands still, and an IMU at 1 MHz."""
    order = StampOrder(0.5, 0.7, 7.5)
    velocity = VelocitySample(S, Source.RTK_VELOCITY, np.zeros(3), np.eye(3))
    order.add(imu(S))
    order.add(velocity)
    for k in range(10_000):
        order.add(replace(position(S), stamp_ns=S + k * 10_000))
        order.add(imu(S + k * 1_000))
    reports = Counter(verdict.source for verdict in order.given_up())
    samples = order.pop_until()
    assert velocity in samples
    assert reports[Source.RTK_POSITION] == 10_000 - 120
    assert reports[Source.IMU] == 10_001 - 1200
    assert len(samples) == 120 + 1200 + 1


@pytest.mark.parametrize("flown_s", [0.0, 5.0])
def test_receivers_that_run_on_while_the_imu_stands_still_are_counted(flown_s):
    """Before the alignment and after it: as where the IMU's driver has halted."""
    flown = flight(duration_s=6.0)
    navigation = Navigation(config_for(flown, method="ekf"))
    samples = navigation_samples(flown)
    until_ns = samples[0].stamp_ns + max(round(flown_s * S), S // 10)
    for sample in samples:
        if sample.stamp_ns < until_ns:
            navigation.process(sample)
    for k in range(2000):  # at 10 kHz, each with another height
        fix = replace(position(until_ns + k * 100_000), height_m=20 + 1e-3 * k)
        navigation.process(fix)
    assert (navigation._ekf is not None) is (flown_s > 0)
    assert navigation.status().counts["rtk_position", "too_many"] > 1500
