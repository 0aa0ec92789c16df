"""The ordinary GPS: on standby, learned once a second, and in RTK's place when that is gone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, flight, navigation_samples, rms

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import GpsPositionAid
from tirgeo_ros.core.navigation.aiding.gnss_velocity import GpsVelocityAid
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.ins_error_model import GPS_ERROR, POSITION
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample
from tirgeo_ros.core.types.verdicts import FilterState, Outcome

SECOND_NS = 1_000_000_000
HOME = (0.695, 2.04, 31.5)
LEVEL = NavState((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, *HOME, *[(0.0,) * 3] * 3)
CONFIG = config_from(
    EkfConfig, {"trust.aid_timeout_s": 1.0, "aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)}
)


def ns(seconds: float) -> int:
    return 1000 * SECOND_NS + round(seconds * SECOND_NS)


def fix(t_s, shift_n=(0.0, 0.0, 0.0), variances=(0.0, 0.0, 0.0), status=FixStatus.SINGLE):
    lat, lon, height = (float(x) for x in TangentPlane(*HOME).geodetic_from_ned(np.array(shift_n)))
    noise = np.diag(variances).astype(float)
    return PositionSample(ns(t_s), Source.GPS_POSITION, status, lat, lon, height, noise)


def gps_velocity(t_s):
    return VelocitySample(ns(t_s), Source.GPS_VELOCITY, np.zeros(3), 0.01 * np.eye(3))


def control_of(rtk_s=None, gps_s=None, status=FixStatus.FIXED):
    """RTK (and its velocity) and GPS were used at these times."""
    control = AidStatus(Receivers(ns(0)))
    if rtk_s is not None:
        control = control.heard(status, ns(rtk_s), SECOND_NS)
        control = control.with_track(Source.RTK_POSITION, AidTrack(ns(rtk_s)))
        control = control.with_track(Source.RTK_VELOCITY, AidTrack(ns(rtk_s)))
    if gps_s is not None:
        control = control.with_track(Source.GPS_POSITION, AidTrack(ns(gps_s)))
    return control


# When it is spare


@pytest.mark.parametrize(
    ("control", "spare"),
    [
        (control_of(rtk_s=9.9, gps_s=9.9), True),
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
    assert GpsPositionAid(CONFIG).spare(fix(10.0), control) is spare


@pytest.mark.parametrize(("rtk_s", "spare"), [(9.0, True), (8.999, False), (None, False)])
def test_velocities_are_spare_while_rtk_s_are_used(rtk_s, spare):
    assert GpsVelocityAid(CONFIG).spare(gps_velocity(10.0), control_of(rtk_s)) is spare


def test_a_fix_that_is_none_is_not_used():
    belief = StateEstimate(LEVEL, np.eye(18), control_of())
    found = Fusion(CONFIG).fuse(fix(10.0, status=FixStatus.NONE), belief, (0.0,) * 3)
    assert (found.verdict.outcome, found.verdict.reason) == (Outcome.NOT_FIXED, "status none")


# The measurement


def test_what_the_receiver_admits_beyond_its_slow_error_is_noise():
    """Its variances less those that the state has, not below zero."""
    gps = CONFIG.gps
    known = np.square(gps.position_sigma_m) + gps.position_noise_m**2
    belief = StateEstimate(LEVEL, np.eye(18), control_of())
    for variances, beyond in ((known, 0.0), (0.1 * known, 0.0), (known + 9.0, 9.0)):
        found = GpsPositionAid(CONFIG).measured(
            fix(10.0, variances=variances), belief, (0.0,) * 3
        )[0]
        expected = np.eye(3) * (gps.position_noise_m**2 + beyond)
        np.testing.assert_allclose(found.measurement.noise, expected, rtol=1e-12)


def with_error(t_s, error_n, control=None):
    receivers = Receivers(ns(t_s), tuple(error_n))
    return (control or control_of())._replace(receivers=receivers)


def test_learned_error_fades_through_a_silence():
    """As the state that the covariance is of does: by a third of its correlation time in 30 s."""
    belief = StateEstimate(LEVEL, np.eye(18), with_error(0.0, (3.0, 0.0, -6.0)))
    found = Fusion(CONFIG).fuse(fix(30.0), belief, (0.0,) * 3).verdict.innovation
    left = math.exp(-30.0 / CONFIG.gps.position_time_s)
    # Metres through radians at 6.4e6 m: 1e-9.
    assert found == pytest.approx([-3.0 * left, 0.0, 6.0 * left], abs=1e-6)


def test_learned_error_is_not_faded_by_looking_at_it():
    """Two fixes that are refused do not fade it twice."""
    covariance = 1e-6 * np.eye(18)
    belief = StateEstimate(LEVEL, covariance, with_error(0.0, (3.0, 0.0, -6.0)))
    fusion = Fusion(CONFIG)
    for t_s in (10.0, 20.0):
        found = fusion.fuse(fix(t_s, (50.0, 0.0, 0.0)), belief, (0.0,) * 3)
        assert found.verdict.outcome is Outcome.GATED
        belief = found.belief
    later = fusion.fuse(fix(30.0), belief, (0.0,) * 3).verdict.innovation
    left = math.exp(-30.0 / CONFIG.gps.position_time_s)
    assert later[0] == pytest.approx(-3.0 * left, abs=1e-6)


def test_fading_does_not_depend_on_how_often_something_is_used():
    """Twenty updates in between or none: the same estimate, if they say nothing of it."""
    covariance = np.diag(np.r_[np.full(15, 1e-6), np.full(3, 1.0)])
    fusion = Fusion(CONFIG)
    belief = StateEstimate(LEVEL, covariance, with_error(0.0, (3.0, 0.0, -6.0)))
    for k in range(1, 21):
        found = fusion.fuse(gps_velocity(0.5 * k), belief, (0.0,) * 3)
        assert found.verdict.used
        belief = found.belief._replace(covariance=covariance, state=LEVEL)
    faded = math.exp(-10.0 / CONFIG.gps.position_time_s)
    expected = (3.0 * faded, 0.0, -6.0 * faded)
    assert belief.control.receivers.gps_error_n == pytest.approx(expected, abs=1e-12)


def test_learned_while_rtk_is_there_to_its_noise():
    """A known position: the error is learned to position_noise_m, and tied to nothing."""
    covariance = np.diag(np.r_[np.full(15, 1e-8), np.square(CONFIG.gps.position_sigma_m)])
    belief = StateEstimate(LEVEL, covariance, control_of(rtk_s=9.9))
    shift = (0.8, -1.0, 2.5)
    found = Fusion(CONFIG).fuse(fix(10.0, shift), belief, (0.0,) * 3).belief
    sigma = np.sqrt(np.diag(found.covariance)[GPS_ERROR])
    assert sigma == pytest.approx([CONFIG.gps.position_noise_m] * 3, rel=0.01)
    assert found.control.receivers.gps_error_n == pytest.approx(shift, abs=0.02)
    assert np.abs(found.state.correction_n).max() < 1e-6


# Outages of RTK in flight


def outage(flown, begin_s, end_s, **config):
    """Errors of the filter where RTK is silent in between, its states, and its steps."""
    start_ns = flown.truth.stamp_ns[0]
    navigation, found, states = Navigation(config_for(flown, **config)), [], []
    for sample in navigation_samples(flown):
        t_s = (sample.stamp_ns - start_ns) * 1e-9
        rtk = getattr(sample, "source", None) in {Source.RTK_POSITION, Source.RTK_VELOCITY}
        if begin_s < t_s < end_s and (rtk or hasattr(sample, "heading_rad")):
            continue
        solution = navigation.process(sample).solution
        if solution is not None:
            found.append(solution)
            states.append((t_s, navigation.status().state))
    return errors(flown, found), states, navigation


@pytest.mark.slow
@pytest.mark.long
def test_error_over_sigma_of_the_position_in_an_outage():
    """Monte Carlo over flights, each with its own GPS errors: as large as the filter says."""
    ratios, worst = [], []
    for seed in range(14):
        flown = flight(300 + seed, 42.0, ["lawnmower", "hover", "figure_eight"][seed % 3])
        found, _, _ = outage(flown, 28.0, 40.0, publish_rate_hz=5.0)
        during = (found.t_s > 32.0) & (found.t_s < 40.0)
        ratios.append(np.mean(np.square(found.state / found.sigma)[during, :3], axis=0))
        worst.append(np.abs(found.state / found.sigma)[during, :3].max())
    overall = math.sqrt(np.mean(ratios))
    # 14 flights x 3 axes, each nearly one draw of a slow error: 1 / sqrt(2 x 42) = 11 % one sigma.
    assert overall == pytest.approx(1.0, abs=0.33)
    # Of 42 draws the largest is beyond 3.5 sigma once in fifty times, for a good 8 s each.
    assert max(worst) < 4.0


@pytest.mark.slow
def test_no_step_when_rtk_goes_or_comes():
    """From one solution to the next the position's error moves by centimetres."""
    flown = flight(41, 50.0)
    found, states, navigation = outage(flown, 25.0, 37.0)
    steps = np.abs(np.diff(found.state[:, :3], axis=0))
    late = found.t_s[1:] > 20.0
    away = late & (found.t_s[1:] > 25.5) & (found.t_s[1:] < 37.0)
    # Ten GPS fixes a second, each new by 0.05 m of noise.
    assert steps[away].max() < 0.06
    # Coming back: a fifth of what the outage has left, five times.
    gone = np.abs(found.state[(found.t_s > 36.5) & (found.t_s < 37.0), :3]).max()
    assert steps[late].max() < max(0.06, gone / 4)
    after = found.after(39.0)
    assert rms(after.state[:, :3]).max() < 0.03
    # And it is said: each state from when on.
    seen = [state for k, (_, state) in enumerate(states) if k == 0 or states[k - 1][1] != state]
    assert seen[:2] == [FilterState.RUNNING, FilterState.DEGRADED]
    assert seen[-1] is FilterState.RUNNING
    assert FilterState.DEAD_RECKONING not in seen
    assert navigation.status().resets == {}


def test_gps_that_is_gone_too_is_dead_reckoning():
    flown = flight(41, 36.0)
    start_ns = flown.truth.stamp_ns[0]
    navigation, states = Navigation(config_for(flown)), []
    for sample in navigation_samples(flown):
        t_s = (sample.stamp_ns - start_ns) * 1e-9
        if 25.0 < t_s < 31.0 and not hasattr(sample, "specific_force_b"):
            continue
        solution = navigation.process(sample).solution
        if solution is not None:
            states.append((t_s, navigation.status().state))
    reckoning = [t_s for t_s, state in states if state is FilterState.DEAD_RECKONING]
    timeout_s = EkfConfig().trust.aid_timeout_s
    assert reckoning[0] == pytest.approx(25.0 + timeout_s, abs=0.25)
    assert reckoning[-1] == pytest.approx(31.0, abs=0.25)
    assert states[-1][1] is FilterState.RUNNING


@pytest.mark.slow
def test_a_constant_height_above_the_geoid_is_learned():
    """A receiver that gives another height by 30 m: learned, and held through an outage."""
    flown = flight(43, 55.0)
    start_ns = flown.truth.stamp_ns[0]
    navigation, found = Navigation(config_for(flown)), []
    for given in navigation_samples(flown):
        t_s, sample = (given.stamp_ns - start_ns) * 1e-9, given
        source = getattr(given, "source", None)
        if source is Source.GPS_POSITION:
            sample = replace(given, height_m=given.height_m + 30.0)
        if 40.0 < t_s < 52.0 and (
            source in {Source.RTK_POSITION, Source.RTK_VELOCITY} or hasattr(given, "heading_rad")
        ):
            continue
        solution = navigation.process(sample).solution
        if solution is not None:
            found.append(solution)
    during = errors(flown, found).after(41.0)
    keep = during.t_s < 52.0
    assert (np.abs(during.state / during.sigma)[keep, :3] < 4.0).all()


def test_without_rtk_at_all_it_flies_on_gps():
    """Started and flown on the ordinary GPS: honest about its metres, and degraded."""
    flown = flight(44, 30.0)
    navigation, found = Navigation(config_for(flown, method="ekf")), []
    for sample in navigation_samples(flown):
        if getattr(sample, "source", None) in {Source.RTK_POSITION, Source.RTK_VELOCITY}:
            continue
        solution = navigation.process(sample).solution
        if solution is not None:
            found.append(solution)
    assert navigation.status().state is FilterState.DEGRADED
    late = errors(flown, found).after(15.0)
    sigma = late.sigma[:, :3]
    assert (sigma > 0.5 * np.array(EkfConfig().gps.position_sigma_m)).all()
    assert (np.abs(late.state[:, :3] / sigma) < 3.0).all()


def test_position_and_error_start_tied():
    """A start from the GPS: what its position is off, its error is, negated."""
    flown = flight(44, 12.0)
    navigation = Navigation(config_for(flown, method="ekf"))
    for sample in navigation_samples(flown):
        if getattr(sample, "source", None) in {Source.RTK_POSITION, Source.RTK_VELOCITY}:
            continue
        navigation.process(sample)
        if navigation._ekf is not None:
            break
    covariance = navigation._ekf.belief().covariance
    both = np.diag(covariance)[POSITION], np.diag(covariance)[GPS_ERROR]
    tie = np.diag(covariance[POSITION, GPS_ERROR]) / np.sqrt(both[0] * both[1])
    assert (tie < -0.9).all()
    scales = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scales, scales))[0] > -1e-12
