"""A heading that a person sets: where it begins a filter, helps one, or is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from filter_states import SECOND_NS, belief_of, state_of
from flights import config_for, flight, navigation_samples

from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.heading import heading_of, wrapped
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.types.measurements import ImuSample, SetHeading, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome

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
    heard, first, said = [], None, False
    navigation = Navigation(config_for(flown, method=method), heard.append)
    begin_ns, told = flown.truth.stamp_ns[0], None
    for given in navigation_samples(flown):
        sample = given
        if sample.source is Source.RTK_HEADING:
            continue
        if isinstance(sample, ImuSample):
            q_nb = sample.autopilot_q_nb
            turn = quat_from_euler(0.0, 0.0, autopilot_rad or 0.0)
            turned = None if autopilot_rad is None else quat_multiply(turn, q_nb)
            sample = replace(sample, autopilot_q_nb=turned)
        t_s = (sample.stamp_ns - begin_ns) * 1e-9
        if told is None and t_s >= at_s and sample.stamp_ns in flown.truth.stamp_ns:
            told = SetHeading(sample.stamp_ns, heading_at(flown, sample) + off_rad, variance)
        if told is not None and not said and t_s >= at_s + late_s:
            navigation.process(told)
            said = True
        solution = navigation.process(sample).solution
        first = first or solution
    return [one for one in heard if one.source is Source.SET_HEADING], first, navigation


def heading_at(flown, sample) -> float:
    return heading_of(flown.truth.q_nb[flown.truth.stamp_ns.index(sample.stamp_ns)])


def test_error_over_sigma_of_a_filter_that_begins_with_it():
    ratios = []
    for seed in range(10):
        flown = flight(seed, HOVER_S, "hover")
        off_rad = SIGMA * np.random.default_rng(seed).standard_normal()
        verdicts, first, navigation = begun(flown, off_rad=off_rad)
        assert [one.outcome for one in verdicts] == [Outcome.WAITING, Outcome.USED]
        status = navigation.status()
        assert status.state is FilterState.RUNNING
        assert status.counts["set_heading", "used"] == 1
        sigma = math.sqrt(first.covariance[5, 5])
        assert sigma == pytest.approx(SIGMA, rel=0.1)
        ratios.append(wrapped(heading_of(first.q_nb) - heading_at(flown, first)) / sigma)
    # Ten draws: rms 1 +- 0.22.
    assert 0.3 < math.sqrt(np.mean(np.square(ratios))) < 1.7


def test_where_two_antennas_are_awaited_it_counts_before_the_autopilot():
    """Before wait_s, with a compass that is 40 deg off."""
    flown = flight(1, HOVER_S, "hover")
    _, first, navigation = begun(flown, method="ekf_heading", autopilot_rad=math.radians(40.0))
    off_rad = wrapped(heading_of(first.q_nb) - heading_at(flown, first))
    assert abs(off_rad) < SIGMA
    assert navigation.status().counts["set_heading", "used"] == 1


def test_without_a_variance_it_has_that_of_the_parameter_and_may_come_late():
    flown = flight(1, HOVER_S, "hover")
    found = [begun(flown, variance=0.0, late_s=late_s)[1] for late_s in (0.0, 0.3)]
    first, later = found
    assert math.degrees(math.sqrt(first.covariance[5, 5])) == pytest.approx(5.0, rel=0.1)
    assert later.stamp_ns - first.stamp_ns < SECOND_NS
    off_rad = wrapped(heading_of(first.q_nb) - heading_at(flown, first))
    again_rad = wrapped(heading_of(later.q_nb) - heading_at(flown, later))
    assert abs(again_rad - off_rad) < 0.2 * SIGMA


@pytest.mark.parametrize(
    ("values", "outcome", "reason"),
    [
        ({"at_s": 0.2}, Outcome.STANDBY, "does not wait for a heading: needs imu/data"),
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
def test_what_is_refused_says_why(values, outcome, reason):
    verdicts, _, navigation = begun(flight(1, HOVER_S, "hover"), **values)
    verdict = verdicts[-1]
    assert verdict.outcome is outcome
    assert re.search(reason, verdict.reason), verdict.reason
    assert navigation.status().counts["set_heading", outcome.value] == 1


@pytest.mark.parametrize(
    ("own_deg", "off_deg", "outcome"),
    [(8.0, 6.0, Outcome.USED), (2.0, 6.0, Outcome.STANDBY), (8.0, 60.0, Outcome.GATED)],
)
def test_a_filter_that_runs_takes_it_where_its_own_is_worse(own_deg, off_deg, outcome):
    belief = belief_of(state_of(0.0, 0.0, 0.0))
    belief.covariance[2, 2] = math.radians(own_deg) ** 2
    told = SetHeading(SECOND_NS, math.radians(off_deg), SIGMA**2)
    verdict, after = Fusion(EkfConfig()).fuse(told, belief, (0.0, 0.0, 0.0))
    assert verdict.outcome is outcome
    turned = math.degrees(heading_of(np.array(after.state.q_nb)))
    # Afterwards it is as certain as was said, 3 deg, and saying it again changes nothing.
    share = 1 - (3.0 / own_deg) ** 2 if outcome is Outcome.USED else 0.0
    assert turned == pytest.approx(share * off_deg, abs=1e-2)
    left_deg = math.degrees(math.sqrt(after.covariance[2, 2]))
    assert left_deg == pytest.approx(own_deg * math.sqrt(1 - share), rel=1e-3)
    again, same = Fusion(EkfConfig()).fuse(told, after, (0.0, 0.0, 0.0))
    assert again.outcome is (Outcome.GATED if outcome is Outcome.GATED else Outcome.STANDBY)
    assert same.covariance[2, 2] == after.covariance[2, 2]
    if outcome is Outcome.GATED:
        assert verdict.reason == "60 deg off"


def test_it_is_no_stream_that_the_checks_could_miss():
    checks, topic = NavigationChecks(EkfConfig(), None), Source.SET_HEADING.topic
    for stamp_ns in (SECOND_NS, 60 * SECOND_NS, 61 * SECOND_NS):
        checks.take(topic, SetHeading(stamp_ns, 1.0, SIGMA**2), stamp_ns)
    assert not any(topic in one.line for one in checks.findings())
