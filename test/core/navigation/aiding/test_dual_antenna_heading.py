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
"""When headings are used or must wait, and headings that a person sets."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from filter_states import (
    LEVEL,
    SECOND_NS,
    ZERO,
    ekf_config,
    estimate_of,
    heading,
    heard,
    ns,
    state_of,
)
from flights import config_for, flight, navigation_samples

from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import heading_of, quat_from_euler, quat_multiply, wrapped
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    SetHeading,
    Source,
)
from tirgeo_ros.core.types.verdicts import FilterState, Outcome

CONFIG = ekf_config(
    heading__start_after_s=1.0, heading__reset_after_s=5.0, trust__aid_timeout_s=1.0
)


def fixed_estimate(fixed_s: float, now_s: float) -> StateEstimate:
    """Level, nose north, RTK fixed for ``fixed_s``, headings not used yet."""
    aids, t_s = heard(AidStatus(Receivers(ns(now_s))), now_s - fixed_s), now_s - fixed_s
    while t_s < now_s:  # the receiver reports it five times a second
        t_s = min(t_s + 0.2, now_s)
        aids = heard(aids, t_s)
    covariance = 1e-4 * np.eye(ANTENNA.start)
    covariance[2, 2] = math.radians(0.1) ** 2
    return StateEstimate(LEVEL, covariance, aids)


def fused(estimate, sample, q_nb=None):
    return Fusion(CONFIG).fuse(sample, estimate, ZERO, autopilot_q_nb=q_nb)


def while_fixed(estimate, t_s, degrees=0.0, q_nb=None):
    """A heading fused beside a fixed position."""
    estimate = estimate._replace(aids=heard(estimate.aids, t_s))
    return fused(estimate, heading(t_s, degrees), q_nb)


@pytest.mark.parametrize(
    ("fixed_s", "reason"), [(0.999, "rtk/fix has been fixed for only 1.0 s"), (1.0, "")]
)
def test_headings_start_after_a_while_of_fixed_positions(fixed_s, reason):
    result = fused(fixed_estimate(fixed_s, 5.0), heading(5.0)).verdict
    assert (result.outcome is Outcome.NOT_FIXED, result.reason) == (bool(reason), reason)


def test_headings_go_on_where_they_were_used_lately():
    """One float fix in between stops them for its own time only."""
    estimate = fused(fixed_estimate(3.0, 5.0), heading(5.0)).estimate
    estimate = estimate._replace(aids=heard(estimate.aids, 5.1, FixStatus.FLOAT))
    stopped = fused(estimate, heading(5.2))
    assert stopped.verdict.reason == "rtk/fix is not fixed"
    estimate = stopped.estimate._replace(aids=heard(stopped.estimate.aids, 5.3))
    assert fused(estimate, heading(5.4)).verdict.used


@pytest.mark.parametrize(("age_s", "reason"), [(1.0, ""), (1.001, "rtk/fix is silent")])
def test_headings_stop_where_the_status_is_silent(age_s, reason):
    estimate = fused(fixed_estimate(3.0, 5.0), heading(5.0)).estimate
    assert fused(estimate, heading(5.0 + age_s)).verdict.reason == reason
    # After a silence, the time with a fix counts anew.
    assert while_fixed(estimate, 65.0).verdict.outcome is Outcome.NOT_FIXED


# How long headings must contradict the state


def agreed(seconds: float) -> StateEstimate:
    """An estimate that headings of zero have confirmed for ``seconds``, five times a second."""
    estimate = fixed_estimate(3.0, 0.0)
    for k in range(round(seconds * 5) + 1):
        result = while_fixed(estimate, 0.2 * k)
        assert result.verdict.used
        estimate = with_sigma(result.estimate)
    return estimate


def with_sigma(estimate: StateEstimate) -> StateEstimate:
    """The estimate with its first covariance: nothing is learned, nothing drifts."""
    return estimate._replace(covariance=fixed_estimate(3.0, 0.0).covariance)


def given_up_after(estimate: StateEstimate, start_s: float, offs_deg, autopilot_deg=None):
    """Seconds from the first refusal until the state is set to headings that are off, or None."""
    q_nb = None
    if autopilot_deg is not None:
        q_nb = quat_from_euler(0.0, 0.0, math.radians(autopilot_deg))
    first_s = None
    for k, degrees in enumerate(offs_deg):
        t_s = start_s + 0.2 * k
        result = while_fixed(estimate, t_s, degrees, q_nb)
        estimate = with_sigma(result.estimate)
        if result.verdict.outcome is Outcome.RESET:
            return t_s - first_s
        if result.verdict.outcome is Outcome.GATED and first_s is None:
            first_s = t_s
    return None


@pytest.mark.parametrize(
    ("off_deg", "autopilot_deg", "patience_s"),
    [
        (90.0, None, None),
        (90.0, 3.0, None),
        (90.0, 80.0, 5.0),
        (-90.0, 80.0, None),
        (180.0, -170.0, 5.0),
        (10.0, 10.0, None),  # the autopilot may err by as little
    ],
)
def test_headings_that_step_are_refused_unless_the_autopilot_has_turned_as_well(
    off_deg, autopilot_deg, patience_s
):
    result = given_up_after(agreed(100.0), 100.2, [off_deg] * 400, autopilot_deg)
    assert result == (None if patience_s is None else pytest.approx(patience_s, abs=0.2001))


@pytest.mark.parametrize(
    ("agreed_s", "patience_s"),
    [
        (1.0, 5.0),  # reset_after_s at least
        (20.0, 20.0),  # as long as it had agreed
        (100.0, 60.0),  # a minute at most
    ],
)
def test_a_drift_must_last_as_long_as_the_agreement_before_it(agreed_s, patience_s):
    """Gyroscopes that fail turn the state by degrees: the headings are right then."""
    ramp = list(np.arange(0.0, 12.0, 1.0))
    result = given_up_after(agreed(agreed_s), agreed_s + 0.2, ramp + [12.0] * 400)
    # On the ramp, which lasts 2.4 s, headings do not agree with each other.
    assert patience_s <= result + 1e-9 <= patience_s + 2.4


def test_headings_that_come_late_and_far_off_do_not_win():
    """A start by the autopilot's heading; the antennas come later, 90 deg off."""
    assert given_up_after(fixed_estimate(3.0, 0.0), 0.2, [90.0] * 400, 2.0) is None
    assert given_up_after(fixed_estimate(3.0, 0.0), 0.2, [12.0] * 400, 2.0) >= 5.0


def test_contradictions_that_do_not_agree_prove_nothing():
    """A heading that turns all the time is refused for more than a minute; the state stays."""
    estimate = agreed(10.0)
    for k in range(500):
        t_s = 10.2 + 0.2 * k
        result = while_fixed(estimate, t_s, 60.0 + (37.0 * k) % 240.0)
        assert result.verdict.outcome is Outcome.GATED
        estimate = result.estimate
    assert estimate.state.q_nb == pytest.approx(LEVEL.q_nb, abs=1e-6)


def test_one_chance_agreement_does_not_spend_the_trust():
    """Headings agreed for a minute; then wrong, once right by chance, and wrong again."""
    estimate = agreed(60.0)
    for k in range(25):  # the mean of the innovations stays large for a while
        t_s = 60.2 + 0.2 * k
        estimate = while_fixed(estimate, t_s, 90.0 if k < 10 else 0.0).estimate
        if estimate.aids.track(Source.RTK_HEADING).run is None and k > 10:
            break
    assert estimate.aids.track(Source.RTK_HEADING).run is None  # the last heading has agreed
    assert given_up_after(with_sigma(estimate), t_s + 0.2, [90.0] * 400) is None


SIGMA = math.radians(3.0)
HOVER_S = 6.0


def begun(
    flown,
    *,
    off_rad=0.0,
    variance=SIGMA**2,
    method="ekf",
    at_s=3.0,
    late_s=0.0,
    autopilot_rad=None,
):
    """A hover without headings: the verdicts on one that is set, the first solution, the filter.

    ``autopilot_rad`` is the error of the autopilot's heading; None: it has no attitude.
    """
    verdicts, first, text = [], None, False
    navigation = Navigation(config_for(flown, method=method), verdicts.append)
    begin_ns, by_hand = flown.truth.stamp_ns[0], None
    for recorded in navigation_samples(flown):
        sample = recorded
        if sample.source is Source.RTK_HEADING:
            continue
        if isinstance(sample, ImuSample):
            q_nb = sample.autopilot_q_nb
            turn = quat_from_euler(0.0, 0.0, autopilot_rad or 0.0)
            turned = None if autopilot_rad is None else quat_multiply(turn, q_nb)
            sample = replace(sample, autopilot_q_nb=turned)
        t_s = (sample.stamp_ns - begin_ns) * 1e-9
        if by_hand is None and t_s >= at_s and sample.stamp_ns in flown.truth.stamp_ns:
            by_hand = SetHeading(sample.stamp_ns, heading_at(flown, sample) + off_rad, variance)
        if by_hand is not None and not text and t_s >= at_s + late_s:
            navigation.process(by_hand)
            text = True
        solution = navigation.process(sample).solution
        first = first or solution
    return [v for v in verdicts if v.source is Source.SET_HEADING], first, navigation


def heading_at(flown, sample) -> float:
    return heading_of(flown.truth.q_nb[flown.truth.stamp_ns.index(sample.stamp_ns)])


def test_error_over_sigma_of_a_filter_that_starts_with_a_set_heading():
    ratios = []
    for seed in range(10):
        flown = flight(seed, HOVER_S, "hover")
        off_rad = SIGMA * np.random.default_rng(seed).standard_normal()
        verdicts, first, navigation = begun(flown, off_rad=off_rad)
        assert [item.outcome for item in verdicts] == [Outcome.WAITING, Outcome.USED]
        status = navigation.status()
        assert status.state is FilterState.RUNNING
        assert status.counts["set_heading", "used"] == 1
        sigma = math.sqrt(first.covariance[5, 5])
        assert sigma == pytest.approx(SIGMA, rel=0.1)
        ratios.append(wrapped(heading_of(first.q_nb) - heading_at(flown, first)) / sigma)
    # Ten draws: rms 1 +- 0.22.
    assert 0.3 < math.sqrt(np.mean(np.square(ratios))) < 1.7


def test_while_antennas_are_awaited_a_set_heading_counts_before_the_autopilot():
    """Before wait_s, with a compass that is 40 deg off."""
    flown = flight(1, HOVER_S, "hover")
    _, first, navigation = begun(flown, method="ekf_heading", autopilot_rad=math.radians(40.0))
    off_rad = wrapped(heading_of(first.q_nb) - heading_at(flown, first))
    assert abs(off_rad) < SIGMA
    assert navigation.status().counts["set_heading", "used"] == 1


def test_a_set_heading_without_a_variance_has_the_parameters_and_may_come_late():
    flown = flight(1, HOVER_S, "hover")
    result = [begun(flown, variance=0.0, late_s=late_s)[1] for late_s in (0.0, 0.3)]
    first, later = result
    assert math.degrees(math.sqrt(first.covariance[5, 5])) == pytest.approx(5.0, rel=0.1)
    assert later.stamp_ns - first.stamp_ns < SECOND_NS
    off_rad = wrapped(heading_of(first.q_nb) - heading_at(flown, first))
    again_rad = wrapped(heading_of(later.q_nb) - heading_at(flown, later))
    assert abs(again_rad - off_rad) < 0.2 * SIGMA


@pytest.mark.parametrize(
    ("values", "outcome", "reason"),
    [
        ({"at_s": 0.2}, Outcome.STANDBY, "does not need a heading now: needs imu/data"),
        ({"autopilot_rad": 0.0, "at_s": 5.0}, Outcome.STANDBY, "own heading is better.*~/reset"),
        (
            {"variance": math.radians(15.0) ** 2},
            Outcome.INVALID,
            "15.0 deg is too large: .*10 deg",
        ),
        ({"off_rad": math.nan}, Outcome.INVALID, "not finite"),
        ({"variance": math.inf}, Outcome.INVALID, "not finite"),
        ({"method": "rtk"}, Outcome.UNUSED, ""),
    ],
)
def test_a_refused_set_heading_has_a_reason(values, outcome, reason):
    verdicts, _, navigation = begun(flight(1, HOVER_S, "hover"), **values)
    verdict = verdicts[-1]
    assert verdict.outcome is outcome
    assert re.search(reason, verdict.reason), verdict.reason
    assert navigation.status().counts["set_heading", outcome.value] == 1


@pytest.mark.parametrize(
    ("own_deg", "off_deg", "outcome"),
    [(8.0, 6.0, Outcome.USED), (2.0, 6.0, Outcome.STANDBY), (8.0, 60.0, Outcome.GATED)],
)
def test_a_running_filter_takes_a_set_heading_if_its_own_is_worse(own_deg, off_deg, outcome):
    estimate = estimate_of(state_of(0.0, 0.0, 0.0))
    estimate.covariance[2, 2] = math.radians(own_deg) ** 2
    reports = SetHeading(SECOND_NS, math.radians(off_deg), SIGMA**2)
    verdict, after = Fusion(EkfConfig()).fuse(reports, estimate, (0.0, 0.0, 0.0))
    assert verdict.outcome is outcome
    turned = math.degrees(heading_of(np.array(after.state.q_nb)))
    # The heading is then as certain as the one set, 3 deg; setting it again changes nothing.
    share = 1 - (3.0 / own_deg) ** 2 if outcome is Outcome.USED else 0.0
    assert turned == pytest.approx(share * off_deg, abs=1e-2)
    left_deg = math.degrees(math.sqrt(after.covariance[2, 2]))
    assert left_deg == pytest.approx(own_deg * math.sqrt(1 - share), rel=1e-3)
    again, same = Fusion(EkfConfig()).fuse(reports, after, (0.0, 0.0, 0.0))
    assert again.outcome is (Outcome.GATED if outcome is Outcome.GATED else Outcome.STANDBY)
    assert same.covariance[2, 2] == after.covariance[2, 2]
    if outcome is Outcome.GATED:
        assert verdict.reason == "60 deg off"


def test_a_set_heading_is_no_stream_that_checks_report_missing():
    checks, topic = NavigationChecks(EkfConfig(), None), Source.SET_HEADING.topic
    for stamp_ns in (SECOND_NS, 60 * SECOND_NS, 61 * SECOND_NS):
        checks.take(topic, SetHeading(stamp_ns, 1.0, SIGMA**2), stamp_ns)
    assert not any(topic in item.line for item in checks.findings())
