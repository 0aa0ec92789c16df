"""The estimator's state from what the aids have done, and when it is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.filter_status import FilterHealth, VerdictLog
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome, Verdict

SECOND_NS = 1_000_000_000
NOW_NS = 1000 * SECOND_NS
TIMEOUT_NS = SECOND_NS


def health(**values):
    given = {key.replace("__", "."): value for key, value in values.items()}
    return FilterHealth(config_from(EkfConfig, {"trust.aid_timeout_s": 1.0} | given))


def control_of(*sources, status=FixStatus.FIXED, age_ns=0):
    """These were used just now, or ``age_ns`` ago."""
    control = AidStatus(Receivers(NOW_NS))
    if status is not None:
        control = control.heard(status, NOW_NS - age_ns, TIMEOUT_NS)
    for source in sources:
        control = control.with_track(source, AidTrack(NOW_NS - age_ns))
    return control


RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


@pytest.mark.parametrize(
    ("sources", "state", "reason"),
    [
        (RTK, FilterState.RUNNING, ""),
        ((*RTK, Source.GPS_POSITION, Source.GPS_VELOCITY), FilterState.RUNNING, ""),
        (RTK[:2], FilterState.DEGRADED, "no rtk/heading"),
        ((RTK[0], RTK[2]), FilterState.DEGRADED, "no rtk/vel"),
        (RTK[1:], FilterState.DEAD_RECKONING, "no rtk/fix, gps/fix"),
        ((*RTK[1:], Source.GPS_POSITION), FilterState.DEGRADED, "no rtk/fix"),
        (
            (Source.GPS_POSITION, Source.GPS_VELOCITY),
            FilterState.DEGRADED,
            "no rtk/fix, rtk/vel, rtk/heading",
        ),
        ((), FilterState.DEAD_RECKONING, "no rtk/fix, rtk/vel, rtk/heading, gps/fix"),
        (
            (Source.GPS_VELOCITY,),
            FilterState.DEAD_RECKONING,
            "no rtk/fix, rtk/vel, rtk/heading, gps/fix",
        ),
    ],
)
def test_state_names_what_is_missing(sources, state, reason):
    assert health().state(control_of(*sources), NOW_NS) == (state, reason)


@pytest.mark.parametrize(
    ("age_ns", "state"),
    [(TIMEOUT_NS, FilterState.RUNNING), (TIMEOUT_NS + 1, FilterState.DEAD_RECKONING)],
)
def test_aids_are_missing_after_their_time_out(age_ns, state):
    assert health().state(control_of(*RTK, age_ns=age_ns), NOW_NS)[0] is state


def test_a_float_fix_is_named():
    found = health().state(control_of(*RTK[:2], status=FixStatus.FLOAT), NOW_NS)
    assert found == (FilterState.DEGRADED, "rtk/fix is float, no rtk/heading")


def test_what_comes_and_is_refused_is_said_to_be_refused():
    gated = Verdict(Source.RTK_HEADING, Outcome.GATED, "90 deg off; antennas swapped?")
    poor = Verdict(Source.RTK_VELOCITY, Outcome.NOT_FIXED, "status single")
    log = VerdictLog()
    for verdict in (gated, poor):
        log.add(verdict, NOW_NS - TIMEOUT_NS)
    told = log.unused
    found = health().state(control_of(Source.GPS_POSITION), NOW_NS, told)
    reason = (
        "rtk/vel not used: status single, "
        "rtk/heading refused: 90 deg off; antennas swapped?, no rtk/fix"
    )
    assert found == (FilterState.DEGRADED, reason)
    silent = health().state(control_of(Source.GPS_POSITION), NOW_NS + 1, told)
    assert silent == (FilterState.DEGRADED, "no rtk/fix, rtk/vel, rtk/heading")


# Lost


def covariance_of(position_m=0.01, heading_deg=0.1):
    sigmas = np.full(18, 1e-3)
    sigmas[2] = math.radians(heading_deg)
    sigmas[6:9] = 0.01
    sigmas[7] = position_m
    return np.diag(sigmas**2)


@pytest.mark.parametrize(
    ("sigmas", "why"),
    [
        ({}, ""),
        ({"position_m": 9.99}, ""),
        ({"position_m": 10.01}, "position sigma 10.0 m"),
        ({"heading_deg": 9.99}, ""),
        ({"heading_deg": 10.01}, "heading sigma 10.0 deg"),
        ({"position_m": math.nan}, "not finite"),
        ({"heading_deg": math.nan}, "not finite"),
    ],
)
def test_lost_beyond_the_sigmas(sigmas, why):
    control = control_of(*RTK)
    assert health().lost(control, covariance_of(**sigmas)) == why


@pytest.mark.parametrize(
    ("place", "variance", "why"),
    [
        *((place, bad, "not finite") for place in range(18) for bad in (math.nan, math.inf)),
        *((place, 10.1**2, "position sigma 10.1 m") for place in (6, 7, 8)),
    ],
)
def test_lost_for_one_variance(place, variance, why):
    covariance = covariance_of()
    covariance[place, place] = variance
    assert health().lost(control_of(*RTK), covariance) == why


def test_lost_after_resets_that_do_not_help():
    control = control_of(*RTK)
    for second in range(3):
        assert health().lost(control, covariance_of()) == ""
        control = control.with_reset(Source.RTK_POSITION, NOW_NS + second * SECOND_NS, 2.5)
    expected = "reset again and again: position moved by 2.50 m"
    assert health().lost(control, covariance_of()) == expected


def test_lost_where_position_and_velocity_contradict():
    control = control_of()
    for k in range(11):
        for source in RTK[:2]:
            track = control.track(source).refused(NOW_NS + k * SECOND_NS // 5, (3.0 * k,), 0.1)
            control = control.with_track(source, track)
    judge = health(rtk__reset_after_s=2.0)
    assert judge.lost(control, covariance_of()) == "rtk/fix and rtk/vel both contradict it"
    assert judge.spoiled(control, covariance_of())


def test_what_is_known_of_the_imu_outlives_large_sigmas_but_not_wrong_ones():
    control, covariance = control_of(*RTK), covariance_of(position_m=100.0)
    assert health().lost(control, covariance)
    assert not health().spoiled(control, covariance)
    covariance[0, 0] = math.nan
    assert health().spoiled(control, covariance)
