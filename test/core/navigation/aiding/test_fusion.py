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
"""Fusion: median, gate, floors, positions eased in, and GPS on standby or in RTK's place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import (
    LEVEL as HOVER,
    LEVER_B,
    MEASURED,
    NOW_NS,
    ZERO,
    antenna_fix,
    armed_config,
    ekf_config,
    estimate_of,
    fix,
    ns,
    state_of,
    used_at,
    velocity,
)
from flights import GPS, RTK, config_for, filtered, flight, navigation_samples, without
from hypothesis import given, strategies as st

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate, floored
from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.satellite_position import GpsPositionAid, innovation_n
from tirgeo_ros.core.navigation.aiding.satellite_velocity import GpsVelocityAid
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA, GPS_ERROR, POSITION
from tirgeo_ros.core.navigation.ins.strapdown import rotate
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome

LEVEL = state_of(0.0, 0.0, 0.0)
GOOD = ((0.01, 0.0, -0.01), (-0.01, 0.01, 0.0))


def fused_position(config: dict, shift: np.ndarray, offsets: tuple = ()):
    estimate = estimate_of(LEVEL, covariance=0.01 * np.eye(ANTENNA.start))
    aids = estimate.aids._replace(rtk=estimate.aids.rtk._replace(offsets_n=offsets))
    estimate = estimate._replace(aids=aids)
    return estimate, Fusion(armed_config(**config)).fuse(antenna_fix(LEVEL, shift), estimate, ZERO)


def test_direct_position_is_the_rtk_position():
    """Section 3.3: after the cycle the antenna stands where RTK says, whatever the gain."""
    shift = np.array([0.1, -0.2, 0.3])
    before, fused = fused_position({"position_update": "rtk_direct"}, shift)
    assert fused.verdict.used
    sample = antenna_fix(before.state, shift)
    lever_n = rotate(rotation_of(before.state.q_nb), tuple(LEVER_B))
    assert innovation_n(fused.estimate.state, sample, lever_n) == pytest.approx(ZERO, abs=2e-6)
    turned = rotate(rotation_of(fused.estimate.state.q_nb), tuple(LEVER_B))
    moved_m = innovation_n(fused.estimate.state, sample, turned)
    assert np.abs(moved_m).max() < 0.1  # the lever arm turned with the corrected attitude


@pytest.mark.parametrize("before", [GOOD, (*GOOD, ZERO)])
def test_median_filter_ignores_one_jump(before):
    """Window of three: the middle of two good offsets and the jump is a good one."""
    shift = np.array([0.0, 5.0, 0.0])
    _, fused = fused_position({"rtk__median_window": 3}, shift, before)
    assert fused.verdict.used
    middle = np.sort([*before[-2:], shift], axis=0)[1]
    assert fused.verdict.innovation == pytest.approx(middle, abs=2e-6)
    assert fused.estimate.aids.rtk.offsets_n[:2] == before[-2:]
    assert fused.estimate.aids.rtk.offsets_n[2] == pytest.approx(shift, abs=2e-6)


def test_velocity_enters_with_its_floor():
    sample = replace(velocity(0.0, (3.5, -1.0, 0.2), variance=0.0), stamp_ns=NOW_NS)
    covariance = np.diag(np.r_[np.zeros(3), np.full(3, 4e-4), np.zeros(ANTENNA.start - 6)])
    fused = Fusion(MEASURED).fuse(sample, estimate_of(LEVEL, covariance=covariance), ZERO)
    # Variance 0.02^2 against the floor 0.02^2: half of the 0.5 m/s, but that is 17 sigma: refused.
    assert fused.verdict.outcome is Outcome.GATED
    near = LEVEL._replace(velocity_n=(3.45, -1.0, 0.2))
    fused = Fusion(MEASURED).fuse(sample, estimate_of(near, covariance=covariance), ZERO)
    assert fused.estimate.state.velocity_n[0] == pytest.approx(3.475, abs=1e-9)


def test_gps_error_takes_the_part_that_the_position_does_not():
    """If the position is certain, a GPS position shows the error of the receiver."""
    covariance = np.zeros((ANTENNA.start,) * 2)
    covariance[POSITION, POSITION], covariance[GPS_ERROR, GPS_ERROR] = (
        np.eye(3) * 1e-4,
        np.eye(3) * 4.0,
    )
    estimate = estimate_of(LEVEL, covariance=covariance)
    sample = antenna_fix(LEVEL, np.array([1.0, -2.0, 3.0]), Source.GPS_POSITION)
    sample = replace(sample, covariance_n=np.zeros((3, 3)))
    fused = Fusion(armed_config(gps__position_noise_m=0.05)).fuse(sample, estimate, ZERO)
    assert fused.verdict.used
    # Shares of the innovation: 4 and 1e-4 of 4 + 1e-4 + 0.05^2.
    shift = np.array([1.0, -2.0, 3.0]) / (4 + 1e-4 + 0.05**2)
    assert fused.estimate.aids.receivers.gps_error_n == pytest.approx(4 * shift, abs=2e-6)
    moved = np.subtract(fused.estimate.state.correction_n, estimate.state.correction_n)
    assert moved == pytest.approx(1e-4 * shift, abs=2e-9)
    sigma_m = np.sqrt(np.diag(fused.estimate.covariance)[GPS_ERROR])
    assert sigma_m == pytest.approx(math.sqrt(0.05**2 + 1e-4), rel=1e-3)


@pytest.mark.parametrize(
    ("variances", "expected"),
    [
        ([4e-4, 1e-6, 1e-2], [4e-4, 1e-4, 1e-2]),
        ([0, 0, 0], [1e-4] * 3),
        ([-1, 1, 1], [1e-4, 1, 1]),
    ],
)
def test_floor_of_a_covariance(variances, expected):
    assert np.diag(floored(np.diag(variances).astype(float), 0.01)) == pytest.approx(expected)


@given(st.lists(st.floats(1e-6, 1.0), min_size=3, max_size=3), st.floats(-0.99, 0.99))
def test_floor_only_adds(variances, correlation):
    covariance = np.diag(variances)
    covariance[0, 1] = covariance[1, 0] = correlation * math.sqrt(variances[0] * variances[1])
    result = floored(covariance, 0.1)
    assert (np.diag(result) >= 0.01 * (1 - 1e-12)).all()
    assert np.linalg.eigvalsh(result - covariance)[0] >= -1e-15
    assert result[0, 1] == covariance[0, 1]


# Positions that come back after a silence


def drifted(sigma_m: float = 1.0) -> StateEstimate:
    """After an outage: the position is known to a metre, RTK was used 12 s ago."""
    aids = used_at({Source.RTK_POSITION: ns(0)}, FixStatus.FIXED)
    covariance = 1e-4 * np.eye(ANTENNA.start)
    covariance[2, 2] = math.radians(0.1) ** 2
    covariance[6:9, 6:9] = sigma_m**2 * np.eye(3)
    return StateEstimate(HOVER, covariance, aids)


def test_position_comes_back_in_equal_steps():
    fusion, estimate = Fusion(MEASURED), drifted()
    places, sigmas = [], []
    for k in range(6):
        result = fusion.fuse(fix(12.0 + 0.2 * k, (0.8, 0, 0)), estimate, ZERO)
        assert result.verdict.used
        estimate = result.estimate
        places.append(estimate.state.correction_n[0])
        sigmas.append(math.sqrt(estimate.covariance[6, 6]))
    # Equal but for the noise's share, 1e-4 of the state's variance, five times.
    assert places[:5] == pytest.approx([0.16, 0.32, 0.48, 0.64, 0.8], abs=5 * 1e-3 * 0.8)
    assert places[5] == pytest.approx(0.8, abs=0.01)
    # The rest is never more than the covariance says: 0.8 m was 0.8 sigma.
    left = 0.8 - np.array(places)
    assert (left[:5] <= 1.01 * np.array(sigmas[:5])).all()
    assert sigmas == sorted(sigmas, reverse=True)
    # The fifth is taken in full, and the sixth: of two fixes of a centimetre each.
    assert sigmas[5] == pytest.approx(0.01 / math.sqrt(2), rel=1e-3)


def test_position_that_was_used_lately_is_not_eased():
    estimate = drifted()
    aids = estimate.aids.with_track(Source.RTK_POSITION, AidTrack(ns(11.5)))
    aids = aids.with_status(FixStatus.FIXED, ns(11.5), ns(12) - ns(0))
    result = Fusion(MEASURED).fuse(fix(12.0, (0.8, 0, 0)), estimate._replace(aids=aids), ZERO)
    assert result.estimate.state.correction_n[0] == pytest.approx(0.8, abs=1e-3)


def test_covariance_of_an_eased_position_is_not_too_small():
    """Monte Carlo: error over sigma is at most one while easing, and one at the end."""
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(300):
        estimate, fusion = drifted(1.0), Fusion(MEASURED)
        truth = rng.normal()
        for k in range(6):
            sample = fix(12.0 + 0.2 * k, (truth + 0.01 * rng.normal(), 0, 0))
            estimate = fusion.fuse(sample, estimate, ZERO).estimate
            left = truth - estimate.state.correction_n[0]
            ratios.append(left / math.sqrt(estimate.covariance[6, 6]))
    result = np.sqrt(np.mean(np.square(np.reshape(ratios, (-1, 6))), axis=0))
    # 300 draws: 4 % one sigma. While easing, sigma is too large: each fix has too little weight.
    assert (result < 1.16).all()
    assert result[5] == pytest.approx(1.0, abs=0.16)


def test_float_positions_weigh_as_their_slow_error_allows():
    """Monte Carlo over minutes: a Gauss-Markov error of the float, and the sigma after it.

    The state stands still with a random walk of its own, as an inertial position does.
    """
    config = MEASURED
    sigma_m, time_s = config.rtk.float_sigma_m, config.rtk.float_time_s
    rng, step_s, walk = np.random.default_rng(6), 0.2, 0.05
    ratios = []
    for _ in range(20):
        estimate, fusion = drifted(0.01), Fusion(config)
        truth = 0.01 * rng.normal()
        error = sigma_m * rng.normal()
        keep = math.exp(-step_s / time_s)
        for k in range(200):
            covariance = estimate.covariance.copy()
            covariance[6, 6] += walk**2 * step_s
            estimate = estimate._replace(covariance=covariance)
            truth += walk * math.sqrt(step_s) * rng.normal()
            error = keep * error + sigma_m * math.sqrt(1 - keep**2) * rng.normal()
            sample = fix(0.2 * (k + 1), (truth + error, 0, 0), status=FixStatus.FLOAT)
            estimate = fusion.fuse(sample, estimate, ZERO).estimate
            if k >= 50:
                left = truth - estimate.state.correction_n[0]
                ratios.append(left / math.sqrt(estimate.covariance[6, 6]))
    # White noise of the same power over long times is what a slow state sees: the estimate of
    # a state that walks as fast as the error is not far from honest on either side.
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


CONFIG = ekf_config(trust__aid_timeout_s=1.0)


def gps_fix(t_s, shift_n=ZERO, variances=ZERO, status=FixStatus.SINGLE):
    return fix(t_s, shift_n, Source.GPS_POSITION, status, variances)


def aids_used(rtk_s=None, gps_s=None, status=FixStatus.FIXED):
    """RTK's position and velocity and the GPS were used at these times."""
    times = dict.fromkeys((Source.RTK_POSITION, Source.RTK_VELOCITY), rtk_s)
    times[Source.GPS_POSITION] = gps_s
    aids = used_at({source: ns(t_s) for source, t_s in times.items() if t_s is not None})
    if rtk_s is not None:
        aids = aids.with_status(status, ns(rtk_s), ns(1) - ns(0))
    return aids._replace(receivers=Receivers(ns(0)))


@pytest.mark.parametrize(
    ("aids", "spare"),
    [
        (aids_used(rtk_s=9.9, gps_s=9.05), True),  # a second less the jitter of stamps
        (aids_used(rtk_s=9.9, gps_s=9.04), False),
        (aids_used(rtk_s=9.9), False),  # never learned
        (aids_used(rtk_s=9.0, gps_s=9.9), True),
        (aids_used(rtk_s=8.9, gps_s=9.9), False),  # RTK is silent
        (aids_used(rtk_s=9.9, gps_s=9.9, status=FixStatus.FLOAT), False),
        (aids_used(gps_s=9.9), False),
    ],
)
def test_positions_are_spare_while_rtk_is_fixed_but_for_one_a_second(aids, spare):
    assert GpsPositionAid(CONFIG).spare(gps_fix(10.0), aids) is spare


@pytest.mark.parametrize(("rtk_s", "spare"), [(9.0, True), (8.999, False), (None, False)])
def test_velocities_are_spare_while_rtk_s_are_used(rtk_s, spare):
    sample = velocity(10.0, source=Source.GPS_VELOCITY)
    assert GpsVelocityAid(CONFIG).spare(sample, aids_used(rtk_s)) is spare


def test_a_position_without_a_fix_is_not_used():
    estimate = StateEstimate(HOVER, np.eye(ANTENNA.start), aids_used())
    result = Fusion(CONFIG).fuse(gps_fix(10.0, status=FixStatus.NONE), estimate, ZERO)
    assert (result.verdict.outcome, result.verdict.reason) == (Outcome.NOT_FIXED, "status none")


@pytest.mark.parametrize(
    ("gps_s", "share", "more", "added"),
    [
        (None, 1.0, 0.0, 0.0),
        (None, 0.1, 0.0, 0.0),
        (None, 1.0, 9.0, 9.0),  # at the first position it is all there
        (9.9, 1.0, 9.0, 9.0 * (1 - math.exp(-0.2 / 45))),
        (5.0, 1.0, 9.0, 9.0 * (1 - math.exp(-10 / 45))),
    ],
)
def test_reported_variance_beyond_the_slow_error_is_white_and_slow(gps_s, share, more, added):
    """A Gauss-Markov process of this variance takes up its share since the last position."""
    gps, before = CONFIG.gps, np.eye(ANTENNA.start)
    known = np.square(gps.position_sigma_m) + gps.position_noise_m**2
    estimate = StateEstimate(HOVER, before, aids_used(None, gps_s))
    sample = gps_fix(10.0, variances=share * known + more)
    aid, after = GpsPositionAid(CONFIG).measured(sample, estimate, ZERO)
    white = np.eye(3) * (gps.position_noise_m**2 + more)
    np.testing.assert_allclose(aid.measurement.noise, white, rtol=1e-9)
    result = after.covariance - before
    np.testing.assert_allclose(result[GPS_ERROR, GPS_ERROR], added * np.eye(3), atol=1e-12)
    # Beside a barometer the mean of the heights counts alone: 2 x 45 s over the interval.
    aids = estimate.aids.with_track(Source.BAROMETER, AidTrack(ns(9.9)))
    aid, after = GpsPositionAid(CONFIG).measured(sample, estimate._replace(aids=aids), ZERO)
    white[2, 2] += more * ({9.9: 900}.get(gps_s, 90) - 1)
    np.testing.assert_allclose(aid.measurement.noise, white, rtol=1e-9)
    assert (after.covariance - before)[GPS_ERROR, GPS_ERROR][2, 2] == 0.0


def with_error(covariance):
    """An estimate whose GPS error was learned at 0 s."""
    aids = aids_used()._replace(receivers=Receivers(ns(0), (3.0, 0.0, -6.0)))
    return StateEstimate(HOVER, covariance, aids)


def fade(t_s):
    return math.exp(-t_s / CONFIG.gps.position_time_s)


@pytest.mark.parametrize("looked_at_s", [(), (10.0, 20.0)])
def test_learned_error_fades_with_time_alone(looked_at_s):
    """By a third of its correlation time in 30 s; fixes that are refused do not fade it twice."""
    fusion, estimate = Fusion(CONFIG), with_error(1e-6 * np.eye(ANTENNA.start))
    for t_s in looked_at_s:
        verdict, estimate = fusion.fuse(gps_fix(t_s, (50.0, 0.0, 0.0)), estimate, ZERO)
        assert verdict.outcome is Outcome.GATED
    result = fusion.fuse(gps_fix(30.0), estimate, ZERO).verdict.innovation
    # Metres through radians at 6.4e6 m: 1e-9.
    assert result == pytest.approx([-3.0 * fade(30), 0.0, 6.0 * fade(30)], abs=1e-6)


def test_fading_does_not_depend_on_how_often_something_is_used():
    """Twenty updates in between or none give the same estimate, if they do not observe it."""
    covariance = 1e-6 * np.eye(ANTENNA.start)
    covariance[GPS_ERROR, GPS_ERROR] = np.eye(3)
    fusion, estimate = Fusion(CONFIG), with_error(covariance)
    for k in range(1, 21):
        sample = velocity(0.5 * k, source=Source.GPS_VELOCITY, variance=0.01)
        result = fusion.fuse(sample, estimate, ZERO)
        assert result.verdict.used
        estimate = result.estimate._replace(covariance=covariance, state=HOVER)
    expected = (3.0 * fade(10), 0.0, -6.0 * fade(10))
    assert estimate.aids.receivers.gps_error_n == pytest.approx(expected, abs=1e-12)


# Outages of RTK in flight


@pytest.mark.slow
def test_a_constant_height_above_the_geoid_is_learned():
    """A receiver that gives another height by 30 m: learned, and held through an outage."""
    outage = without(*RTK, begin_s=40.0, end_s=52.0)

    def higher(sample, t_s):
        if isinstance(sample, PositionSample) and sample.source in GPS:
            return replace(sample, height_m=sample.height_m + 30.0)
        return outage(sample, t_s)

    during = filtered(flight(43, 55.0), higher).errors.after(41.0)
    keep = during.t_s < 52.0
    assert (np.abs(during.state / during.sigma)[keep, :3] < 4.0).all()


def test_position_and_gps_error_start_correlated():
    """After a start from GPS, the error of the position is the GPS error, negated."""
    flown = flight(44, 12.0)
    navigation = Navigation(config_for(flown, method="ekf"))
    for sample in navigation_samples(flown):
        if sample.source not in RTK:
            navigation.process(sample)
        if navigation._ekf is not None:
            break
    covariance = navigation._ekf.estimate().covariance
    both = np.diag(covariance)[POSITION], np.diag(covariance)[GPS_ERROR]
    tie = np.diag(covariance[POSITION, GPS_ERROR]) / np.sqrt(both[0] * both[1])
    assert (tie < -0.9).all()
    scales = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scales, scales))[0] > -1e-12
