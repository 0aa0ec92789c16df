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
"""The barometer: its height, when it is used, what its errors do, and what refuses it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import LEVEL, ZERO, used_at
from flights import GPS, RTK, filtered, rms, without

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack
from tirgeo_ros.core.navigation.aiding.barometer import (
    UNKNOWN_M,
    metres_per_pa,
    standard_height_m,
    standard_pressure_pa,
)
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import BAROMETER_OFFSET, states_of
from tirgeo_ros.core.types.measurements import FixStatus, PressureSample, Source
from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.io.messages import SENSED_SAMPLES, TOPIC_TYPES, Messages, sensed
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

CONFIG = EkfConfig()
BAROMETER = CONFIG.barometer
HEIGHT_M, OFFSET_M, DOWN, OFFSET = LEVEL.height_m, 35.0, 8, BAROMETER_OFFSET.start


def ns(t_s: float) -> int:
    return round(t_s * 1e9)


def pressure(t_s: float, off_m: float = 0.0, variance_pa2: float = 0.0) -> PressureSample:
    """A reading whose height differs by ``off_m`` from the height that the filter expects."""
    height_m = HEIGHT_M + OFFSET_M + off_m
    return PressureSample(ns(t_s), standard_pressure_pa(height_m), variance_pa2)


def estimate_of(sigma_m, *, offset_m=OFFSET_M, offset_sigma_m=0.1) -> StateEstimate:
    """A level state with these sigmas of height and offset, and no aid used so far."""
    aids = used_at({})
    receivers = aids.receivers._replace(barometer_offset_m=offset_m)
    covariance = np.eye(states_of(CONFIG)) * 1e-4
    covariance[DOWN, DOWN] = sigma_m**2
    covariance[OFFSET, OFFSET] = offset_sigma_m**2
    return StateEstimate(LEVEL, covariance, aids._replace(receivers=receivers))


def beside_rtk(estimate: StateEstimate, t_s: float) -> StateEstimate:
    """The estimate after an RTK position that is fixed was used at ``t_s``."""
    aids = estimate.aids.with_track(Source.RTK_POSITION, AidTrack(ns(t_s)))
    aids = aids.with_status(FixStatus.FIXED, ns(t_s), 10**9)
    return estimate._replace(aids=aids)


def offset_of(estimate: StateEstimate) -> tuple[float, float]:
    """The offset and its sigma, m."""
    sigma_m = math.sqrt(estimate.covariance[OFFSET, OFFSET])
    return estimate.aids.receivers.barometer_offset_m, sigma_m


@pytest.mark.parametrize(
    ("height_m", "pressure_pa"),
    # ISO 2533:1975, table 5: pressures at geopotential heights.
    [(-1000, 113_929), (0, 101_325), (500, 95_460.8), (1000, 89_874.6), (5000, 54_019.9)],
)
def test_height_is_that_of_the_standard_atmosphere(height_m, pressure_pa):
    # The table's digits: half of the last is 0.5 Pa at most, or 5 cm.
    assert standard_height_m(pressure_pa) == pytest.approx(height_m, abs=0.06)
    assert standard_pressure_pa(height_m) == pytest.approx(pressure_pa, abs=0.6)
    slope = standard_height_m(pressure_pa - 0.5) - standard_height_m(pressure_pa + 0.5)
    assert metres_per_pa(pressure_pa) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("sigma_m", [0.02, 3.0])
def test_the_first_reading_sets_the_offset_and_not_the_height(sigma_m):
    unknown = estimate_of(sigma_m, offset_m=0.0, offset_sigma_m=UNKNOWN_M)
    verdict, after = Fusion(CONFIG).fuse(pressure(10.0), unknown, ZERO)
    assert verdict.outcome is Outcome.USED
    # The share of 35 m that goes to the height: its variance over that of the offset, 300 m.
    assert after.state.height_m == pytest.approx(HEIGHT_M, abs=35 * (sigma_m / UNKNOWN_M) ** 2)
    offset_m, offset_sigma_m = offset_of(after)
    assert offset_m == pytest.approx(OFFSET_M, abs=1e-2)
    assert offset_sigma_m == pytest.approx(math.hypot(sigma_m, BAROMETER.noise_m), rel=1e-3)
    # An error of the height is the offset's, negated: their sum is what the barometer read.
    tie = after.covariance[DOWN, OFFSET] / sigma_m / offset_sigma_m
    assert tie == pytest.approx(sigma_m / offset_sigma_m, rel=1e-3)


def test_the_offset_is_learned_beside_rtk_once_a_second_and_the_height_stays():
    fusion, estimate, outcomes = Fusion(CONFIG), estimate_of(0.02, offset_sigma_m=1.0), []
    for t_s in np.arange(1.0, 21.0, 0.1):
        estimate = beside_rtk(estimate, t_s)
        verdict, estimate = fusion.fuse(pressure(t_s, 0.5), estimate, ZERO)
        outcomes.append(verdict.outcome)
    assert outcomes.count(Outcome.USED) == 20
    assert set(outcomes) == {Outcome.USED, Outcome.STANDBY}
    offset_m, sigma_m = offset_of(estimate)
    # Twenty readings with a noise of 1 m, and a prior of 1 m.
    assert sigma_m == pytest.approx(math.sqrt(1 / 21), rel=0.01)
    assert offset_m == pytest.approx(OFFSET_M + 0.5 * 20 / 21, abs=0.01)
    assert estimate.state.height_m == pytest.approx(HEIGHT_M, abs=1e-3)


@pytest.mark.parametrize("sigma_m", [2.0, 5.0, 30.0])
def test_many_readings_do_not_average_the_offset_away(sigma_m):
    """A minute of readings, 1 m higher: what is not known of the offset stays in the height."""
    fusion, estimate = Fusion(CONFIG), estimate_of(sigma_m, offset_sigma_m=1.0)
    for t_s in np.arange(5.0, 65.0, 0.1):
        verdict, estimate = fusion.fuse(pressure(t_s, 1.0), estimate, ZERO)
        assert verdict.outcome is Outcome.USED
    left = estimate.covariance[DOWN, DOWN]
    # Of height and offset, both unknown, 600 readings show the sum to 1 m / sqrt(600).
    assert left == pytest.approx(1 / (1 + 1 / sigma_m**2), rel=0.01)
    share = 1 / (1 + 1 / sigma_m**2)
    assert estimate.state.height_m == pytest.approx(HEIGHT_M + share, abs=0.01)


def test_innovations_scatter_as_the_filter_says():
    """NIS of 400 draws of the errors of the state, of the offset and of a reading."""
    rng, fusion, sigma_m = np.random.default_rng(33), Fusion(CONFIG), 1.5
    result = []
    for state, known, white in rng.standard_normal((400, 3)):
        off_m = sigma_m * state + 0.1 * known + BAROMETER.noise_m * white
        result.append(fusion.fuse(pressure(10.0, off_m), estimate_of(sigma_m), ZERO).verdict)
    # Chi-square with 400 degrees of freedom: 95 % of the means are in 1 +- 1.96 sqrt(2 / 400).
    assert np.mean([verdict.nis for verdict in result]) == pytest.approx(1.0, abs=0.139)
    assert {verdict.outcome for verdict in result} == {Outcome.USED}


@pytest.mark.parametrize(
    ("value", "variance"),
    [(v, 0.0) for v in (math.nan, math.inf, 0.0, -1.0, 1013.25, 1e9)]
    + [(1e5, v) for v in (math.nan, math.inf, -1.0)],
)
def test_bad_pressures_are_invalid(value, variance):
    verdict = Navigation(CONFIG).process(PressureSample(ns(1), value, variance)).verdict
    assert (verdict.source, verdict.outcome) == (Source.BAROMETER, Outcome.INVALID)
    assert ("not 22632 to 113930 Pa" in verdict.reason) is (value != 1e5)


@pytest.mark.parametrize(("sigma_m", "position"), [(0.02, True), (0.02, False), (2.0, False)])
def test_a_step_is_refused_and_then_becomes_the_offset(sigma_m, position):
    """A door opens: 40 m at once. The height stays in all cases."""
    fusion, estimate, outcomes = Fusion(CONFIG), estimate_of(sigma_m), []
    for t_s in np.arange(5.0, 7.05, 0.1):
        estimate = beside_rtk(estimate, t_s) if position else estimate
        verdict, estimate = fusion.fuse(pressure(t_s, 40.0), estimate, ZERO)
        outcomes.append(verdict.outcome)
        assert estimate.state.height_m == pytest.approx(HEIGHT_M, abs=1e-6)
    assert outcomes[:20] == [Outcome.GATED] * 20  # reset_after_s at 10 Hz
    assert outcomes[20] is Outcome.RESET
    assert str(estimate.aids.last_reset) == "offset of baro/pressure changed by 40.00 m"
    offset_m, sigma = offset_of(estimate)
    assert offset_m == pytest.approx(OFFSET_M + 40.0, abs=0.1)
    assert sigma == pytest.approx(math.hypot(sigma_m, BAROMETER.noise_m), rel=1e-6)
    again = fusion.fuse(pressure(8.0, 40.0), estimate, ZERO)
    assert again.verdict.outcome is Outcome.USED
    assert again.verdict.nis < 1e-3


def test_a_single_wrong_reading_changes_nothing():
    fusion, estimate = Fusion(CONFIG), estimate_of(2.0)
    off = fusion.fuse(pressure(5.0, -60.0), estimate, ZERO)
    assert off.verdict.outcome is Outcome.GATED
    assert off.verdict.reason == "60.0 m off"
    assert offset_of(off.estimate) == offset_of(estimate)
    assert fusion.fuse(pressure(5.1), off.estimate, ZERO).verdict.outcome is Outcome.USED


def test_readings_of_less_than_a_tenth_of_a_second_are_skipped():
    fusion, estimate = Fusion(CONFIG), estimate_of(2.0)
    estimate = fusion.fuse(pressure(5.0), estimate, ZERO).estimate
    skipped = fusion.fuse(pressure(5.05), estimate, ZERO)
    assert skipped.verdict.outcome is Outcome.STANDBY
    assert skipped.estimate is estimate


def test_message_is_the_sample_both_ways():
    cdr = Cdr()
    sample = PressureSample(1_700_000_000_123_456_789, 101_325.25, 9.0)
    topic, message = sensed(Messages(), sample)
    data = cdr.serialize(message, TOPIC_TYPES[topic])
    read = cdr.deserialize(data, "sensor_msgs/msg/FluidPressure")
    assert topic == "baro/pressure"
    assert SENSED_SAMPLES[topic](read) == sample


# Whole flights


def flown(seed: int, duration_s: float = 107.0):
    return fly(scenario_from({"barometer.rate_hz": 10.0, "duration_s": duration_s}, "test"), seed)


def without_barometer(change=lambda s, _: s):
    """The same change, without readings of the barometer."""
    return lambda s, t_s: None if isinstance(s, PressureSample) else change(s, t_s)


@pytest.mark.slow
def test_height_after_sixty_seconds_without_satellites():
    """The table of docs/filter.md: six flights, all receivers silent from 40 to 100 s."""
    off, sigmas = {True: [], False: []}, {True: [], False: []}
    for seed in range(1, 7):
        flight = flown(seed)
        silent = without(*RTK, *GPS, begin_s=40.0, end_s=100.0)
        for barometer in (True, False):
            change = silent if barometer else without_barometer(silent)
            # Without a barometer the height may drift without a limit.
            result = filtered(flight, change, trust__lost_position_sigma_m=1e4).errors
            row = int(np.searchsorted(result.t_s, 99.9)) - 1
            off[barometer].append(result.state[row, 2])
            sigmas[barometer].append(result.sigma[row, 2])
    assert rms(np.array(off[False])) == pytest.approx(5.3, abs=0.1)
    assert rms(np.array(off[True])) == pytest.approx(0.9, abs=0.1)
    assert rms(np.array(sigmas[True])) == pytest.approx(1.2, abs=0.1)
    # Both sigmas are right: mean square of six errors over sigma, 99 % of chi-square / 6.
    for barometer in (True, False):
        assert np.mean(np.square(off[barometer]) / np.square(sigmas[barometer])) < 2.8


def test_a_barometer_beside_rtk_moves_nothing_even_where_it_walks_away():
    flight = flown(7, duration_s=40.0)
    plain = filtered(flight, without_barometer()).errors
    # The noise of one reading is as simulated.
    result, _, navigation = filtered(flight, barometer__noise_m=0.2)
    status = navigation.status()
    # Of an innovation of 0.3 m the height takes the ratio of variances, 1 cm and 0.3 m squared.
    assert np.abs(result.state - plain.state)[:, :3].max() < 1e-3
    outcomes = {o for source, o in status.counts if source == "barometer"}
    assert outcomes == {"standby", "used", "waiting"}
    # 30 innovations of a second: 95 % of chi-square / 30 are in 0.56 to 1.57.
    assert 0.5 < status.nis["barometer"] < 1.6

    def spoiled(sample, t_s):
        """Five metres within a minute, and a step of 20 m."""
        if not isinstance(sample, PressureSample):
            return sample
        height_m = standard_height_m(sample.pressure_pa) + t_s / 12 + 20.0 * (t_s > 25)
        return replace(sample, pressure_pa=standard_pressure_pa(height_m))

    result, _, navigation = filtered(flight, spoiled)
    status = navigation.status()
    assert np.abs(result.state[:, 2] - plain.state[:, 2]).max() < 1e-3
    assert status.counts["barometer", "gated"] >= 18
    assert status.resets["barometer"] == 1
