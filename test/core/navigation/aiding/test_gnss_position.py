"""The ordinary GPS: on standby, learned once a second, and in RTK's place when that is gone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import LEVEL, ZERO, ekf_config, fix, ns, used_at, velocity
from flights import GPS, RTK, config_for, filtered, flight, navigation_samples, without

from tirgeo_ros.core.navigation.aiding.aid_status import Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import GpsPositionAid
from tirgeo_ros.core.navigation.aiding.gnss_velocity import GpsVelocityAid
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.ins_error_model import GPS_ERROR, POSITION
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome

CONFIG = ekf_config(trust__aid_timeout_s=1.0)


def gps_fix(t_s, shift_n=ZERO, variances=ZERO, status=FixStatus.SINGLE):
    return fix(t_s, shift_n, Source.GPS_POSITION, status, variances)


def control_of(rtk_s=None, gps_s=None, status=FixStatus.FIXED):
    """RTK's position and velocity and the GPS were used at these times."""
    times = dict.fromkeys((Source.RTK_POSITION, Source.RTK_VELOCITY), rtk_s)
    times[Source.GPS_POSITION] = gps_s
    control = used_at({source: ns(t_s) for source, t_s in times.items() if t_s is not None})
    if rtk_s is not None:
        control = control.heard(status, ns(rtk_s), ns(1) - ns(0))
    return control._replace(receivers=Receivers(ns(0)))


@pytest.mark.parametrize(
    ("control", "spare"),
    [
        (control_of(rtk_s=9.9, gps_s=9.05), True),  # a second less the jitter of stamps
        (control_of(rtk_s=9.9, gps_s=9.04), False),
        (control_of(rtk_s=9.9), False),  # never learned
        (control_of(rtk_s=9.0, gps_s=9.9), True),
        (control_of(rtk_s=8.9, gps_s=9.9), False),  # RTK is silent
        (control_of(rtk_s=9.9, gps_s=9.9, status=FixStatus.FLOAT), False),
        (control_of(gps_s=9.9), False),
    ],
)
def test_positions_are_spare_while_rtk_is_fixed_but_for_one_a_second(control, spare):
    assert GpsPositionAid(CONFIG).spare(gps_fix(10.0), control) is spare


@pytest.mark.parametrize(("rtk_s", "spare"), [(9.0, True), (8.999, False), (None, False)])
def test_velocities_are_spare_while_rtk_s_are_used(rtk_s, spare):
    sample = velocity(10.0, source=Source.GPS_VELOCITY)
    assert GpsVelocityAid(CONFIG).spare(sample, control_of(rtk_s)) is spare


def test_a_fix_that_is_none_is_not_used():
    belief = StateEstimate(LEVEL, np.eye(18), control_of())
    found = Fusion(CONFIG).fuse(gps_fix(10.0, status=FixStatus.NONE), belief, ZERO)
    assert (found.verdict.outcome, found.verdict.reason) == (Outcome.NOT_FIXED, "status none")


@pytest.mark.parametrize(
    ("rtk_s", "gps_s", "share", "more", "beyond"),
    [
        (None, None, 1.0, 0.0, 0.0),
        (None, None, 0.1, 0.0, 0.0),
        (None, None, 1.0, 9.0, 9.0),  # the first says all that it can
        (None, 9.9, 1.0, 9.0, 9.0 * 900),  # 2 x 45 s over 0.1 s: what lasts does not average
        (None, 5.0, 1.0, 9.0, 9.0 * 90),
        (9.0, 9.9, 1.0, 9.0, 9.0),  # its error is learned against RTK
    ],
)
def test_what_the_receiver_admits_beyond_its_slow_error_is_noise(
    rtk_s, gps_s, share, more, beyond
):
    """Its variances less those that the state has, not below zero."""
    gps = CONFIG.gps
    known = np.square(gps.position_sigma_m) + gps.position_noise_m**2
    belief = StateEstimate(LEVEL, np.eye(18), control_of(rtk_s, gps_s))
    sample = gps_fix(10.0, variances=share * known + more)
    found = GpsPositionAid(CONFIG).measured(sample, belief, ZERO)[0].measurement.noise
    expected = np.eye(3) * (gps.position_noise_m**2 + beyond)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def with_error(covariance):
    """A belief whose GPS error was learned at 0 s."""
    control = control_of()._replace(receivers=Receivers(ns(0), (3.0, 0.0, -6.0)))
    return StateEstimate(LEVEL, covariance, control)


def fade(t_s):
    return math.exp(-t_s / CONFIG.gps.position_time_s)


@pytest.mark.parametrize("looked_at_s", [(), (10.0, 20.0)])
def test_learned_error_fades_with_time_alone(looked_at_s):
    """By a third of its correlation time in 30 s; fixes that are refused do not fade it twice."""
    fusion, belief = Fusion(CONFIG), with_error(1e-6 * np.eye(18))
    for t_s in looked_at_s:
        verdict, belief = fusion.fuse(gps_fix(t_s, (50.0, 0.0, 0.0)), belief, ZERO)
        assert verdict.outcome is Outcome.GATED
    found = fusion.fuse(gps_fix(30.0), belief, ZERO).verdict.innovation
    # Metres through radians at 6.4e6 m: 1e-9.
    assert found == pytest.approx([-3.0 * fade(30), 0.0, 6.0 * fade(30)], abs=1e-6)


def test_fading_does_not_depend_on_how_often_something_is_used():
    """Twenty updates in between or none: the same estimate, if they say nothing of it."""
    covariance = np.diag(np.r_[np.full(15, 1e-6), np.full(3, 1.0)])
    fusion, belief = Fusion(CONFIG), with_error(covariance)
    for k in range(1, 21):
        sample = velocity(0.5 * k, source=Source.GPS_VELOCITY, variance=0.01)
        found = fusion.fuse(sample, belief, ZERO)
        assert found.verdict.used
        belief = found.belief._replace(covariance=covariance, state=LEVEL)
    expected = (3.0 * fade(10), 0.0, -6.0 * fade(10))
    assert belief.control.receivers.gps_error_n == pytest.approx(expected, abs=1e-12)


def test_learned_while_rtk_is_there_to_its_noise():
    """A known position: the error is learned to position_noise_m, and tied to nothing."""
    covariance = np.diag(np.r_[np.full(15, 1e-8), np.square(CONFIG.gps.position_sigma_m)])
    belief = StateEstimate(LEVEL, covariance, control_of(rtk_s=9.9))
    shift = (0.8, -1.0, 2.5)
    found = Fusion(CONFIG).fuse(gps_fix(10.0, shift), belief, ZERO).belief
    sigma = np.sqrt(np.diag(found.covariance)[GPS_ERROR])
    assert sigma == pytest.approx([CONFIG.gps.position_noise_m] * 3, rel=0.01)
    assert found.control.receivers.gps_error_n == pytest.approx(shift, abs=0.02)
    assert np.abs(found.state.correction_n).max() < 1e-6


# Outages of RTK in flight


@pytest.mark.slow
@pytest.mark.long
def test_error_over_sigma_of_the_position_in_an_outage():
    """Monte Carlo over flights, each with its own GPS errors: as large as the filter says."""
    ratios, worst, outage = [], [], without(*RTK, begin_s=28.0, end_s=40.0)
    for seed in range(14):
        flown = flight(300 + seed, 42.0, ["lawnmower", "hover", "figure_eight"][seed % 3])
        found = filtered(flown, outage, publish_rate_hz=5.0).errors
        during = (found.t_s > 32.0) & (found.t_s < 40.0)
        ratio = np.abs(found.state / found.sigma)[during, :3]
        ratios.append(np.mean(np.square(ratio), axis=0))
        worst.append(ratio.max())
    overall = math.sqrt(np.mean(ratios))
    # 14 flights x 3 axes, each nearly one draw of a slow error: 1 / sqrt(2 x 42) = 11 % one sigma.
    assert overall == pytest.approx(1.0, abs=0.33)
    # Of 42 draws the largest is beyond 3.5 sigma once in fifty times, for a good 8 s each.
    assert max(worst) < 4.0


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


def test_position_and_error_start_tied():
    """A start from the GPS: what its position is off, its error is, negated."""
    flown = flight(44, 12.0)
    navigation = Navigation(config_for(flown, method="ekf"))
    for sample in navigation_samples(flown):
        if sample.source not in RTK:
            navigation.process(sample)
        if navigation._ekf is not None:
            break
    covariance = navigation._ekf.belief().covariance
    both = np.diag(covariance)[POSITION], np.diag(covariance)[GPS_ERROR]
    tie = np.diag(covariance[POSITION, GPS_ERROR]) / np.sqrt(both[0] * both[1])
    assert (tie < -0.9).all()
    scales = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scales, scales))[0] > -1e-12
