"""The estimator's state from what the aids have done, when it is lost, and the mean NIS."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import RTK, SECOND_NS, TIMEOUT_NS, ekf_config, used_at
from flights import filtered, flight

from tirgeo_ros.core.navigation.filter_status import FilterHealth, VerdictLog
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome, Verdict

NOW_NS = 1000 * SECOND_NS


def health(**values):
    return FilterHealth(ekf_config(trust__aid_timeout_s=1.0, **values))


def control_of(*sources, status=FixStatus.FIXED, age_ns=0):
    """These were used just now, or ``age_ns`` ago."""
    control = used_at(dict.fromkeys(sources, NOW_NS - age_ns))
    return control.heard(status, NOW_NS - age_ns, TIMEOUT_NS)


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


def covariance_of():
    return np.diag([1e-3] * 6 + [1e-2] * 3 + [1e-3] * 9) ** 2


@pytest.mark.parametrize(
    ("place", "sigma", "why"),
    [
        (7, 9.99, ""),
        *((place, 10.1, "position sigma 10.1 m") for place in (6, 7, 8)),
        (2, math.radians(9.99), ""),
        (2, math.radians(10.01), "heading sigma 10.0 deg"),
        *((place, bad, "not finite") for place in range(18) for bad in (math.nan, math.inf)),
    ],
)
def test_lost_beyond_the_sigmas(place, sigma, why):
    covariance = covariance_of()
    covariance[place, place] = sigma**2
    assert health().lost(control_of(*RTK), covariance) == why
    assert health().spoiled(control_of(*RTK), covariance) is (why == "not finite")


def test_lost_after_resets_that_do_not_help():
    control = control_of(*RTK)
    for second in range(3):
        assert health().lost(control, covariance_of()) == ""
        control = control.with_reset(Source.RTK_POSITION, NOW_NS + second * SECOND_NS, 2.5)
    expected = "reset repeatedly: position moved by 2.50 m"
    assert health().lost(control, covariance_of()) == expected
    assert health().spoiled(control, covariance_of())


# What a receiver admits


def fix(variances, source=Source.GPS_POSITION, status=FixStatus.SINGLE):
    return PositionSample(NOW_NS, source, status, 0.7, 2.0, 20.0, np.diag(variances))


def test_bounds_and_words_of_what_is_admitted():
    admitted = health()
    assert admitted.bounds_m2() == [100.0] * 3
    admitted.hear(fix((0.0, 0.0, 0.0)))
    admitted.hear(fix((1e4,) * 3, status=FixStatus.NONE))
    assert (admitted.bounds_m2(), admitted.poor_gps()) == ([100.0] * 3, "")
    admitted.hear(fix((400.0, 25.0, 1e4)))
    admitted.hear(fix((1e-4,) * 3, Source.RTK_POSITION, FixStatus.FIXED))
    assert admitted.bounds_m2() == pytest.approx([900.0, 100.0, 22500.0])
    assert admitted.poor_gps() == "gps/fix has a sigma of 20 m, 100 m in height"


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


@pytest.mark.parametrize("number", [19, 20])
def test_few_say_nothing(number):
    log, now_ns = filled([9.0] * number)
    assert bool(log.nis(now_ns)) is bool(list(log.warnings(now_ns))) is (number == 20)


def test_what_is_high_is_named_with_what_to_look_at():
    log, now_ns = filled([4.1] * 100)
    (told,) = log.warnings(now_ns)
    assert told.startswith("rtk/vel: innovations are 2.0 times their sigma over 30 s: look at ")
    assert "rtk.velocity_delay_s" in told
    assert ";" not in told  # which parts warnings in diagnostics
    assert not list(filled([3.9] * 100)[0].warnings(now_ns))
    assert not list(log.warnings(now_ns + 31 * SECOND_NS))  # silent since


@pytest.mark.slow
def test_a_flight_whose_velocities_are_late_is_warned_of():
    """A good one has a NIS of 1 and no warning; 0.15 s at 1.5 m/s2 are 0.22 m/s, 11 sigma."""
    flown = flight(duration_s=45.0)
    found = filtered(flown).status
    late = filtered(flown, rtk__velocity_delay_s=-0.15, rtk__gate_sigma=1e3).status
    # 150 velocities of three axes: the mean of squares has a spread of sqrt(2 / 450).
    assert found.nis["rtk_velocity"] == pytest.approx(1.0, abs=4 * math.sqrt(2 / 450))
    assert set(found.nis) >= {"rtk_position", "rtk_velocity", "rtk_heading"}
    assert found.warnings == ()
    assert np.all(np.array(found.vibration) > 0)
    assert found.process_noise == "parameters"
    (told,) = [text for text in late.warnings if text.startswith("rtk/vel")]
    assert "rtk.velocity_delay_s" in told


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
