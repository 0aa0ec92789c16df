"""Counts, test ratios and the mean NIS of the last half minute."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, flight

from dev.flight_errors import navigation_samples
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.filter_status import VerdictLog
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

SECOND_NS = 1_000_000_000


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
    good = Navigation(config_for(flown))
    late = Navigation(config_for(flown, rtk__velocity_delay_s=-0.15, rtk__gate_sigma=1e3))
    for navigation in (good, late):
        for sample in navigation_samples(flown):
            navigation.process(sample)
    found = good.status()
    # 150 velocities of three axes: the mean of squares has a spread of sqrt(2 / 450).
    assert found.nis["rtk_velocity"] == pytest.approx(1.0, abs=4 * math.sqrt(2 / 450))
    assert set(found.nis) >= {"rtk_position", "rtk_velocity", "rtk_heading"}
    assert found.warnings == ()
    assert len(found.vibration) == 6
    assert np.all(np.array(found.vibration) > 0)
    assert found.process_noise == "parameters"
    (told,) = [text for text in late.status().warnings if text.startswith("rtk/vel")]
    assert "rtk.velocity_delay_s" in told


def test_vibration_takes_over_from_the_parameters():
    flown = flight(duration_s=12.0)
    rng = np.random.default_rng(3)
    navigation = Navigation(config_for(flown))
    for sample in navigation_samples(flown):
        given = sample
        if isinstance(sample, ImuSample):
            shaken_b = sample.specific_force_b + rng.normal(size=3) * 2.0
            given = replace(sample, specific_force_b=shaken_b)
        navigation.process(given)
    status = navigation.status()
    assert status.process_noise == "vibration"
    # 2 m/s2 at 100 Hz are 0.2 m/s/sqrt(s); the mean of 3 s is good to 8 %, five of these.
    assert status.vibration[3:] == pytest.approx([0.2] * 3, rel=0.4)
