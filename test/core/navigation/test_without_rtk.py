"""Flights without RTK: they start on ordinary GPS and stay, whatever its receiver admits."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, flight, navigation_samples

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.autopilot_heading import AutopilotHeadingAid
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import GpsPositionAid
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.filter_status import ReportedAccuracy
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import (
    AutopilotHeading,
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY)
SECOND_NS = 1_000_000_000
ZERO = (0.0, 0.0, 0.0)


def without_rtk(flown, sigma_m=None):
    """Its samples; with ``sigma_m`` (3,) in every gps/fix, zeros as where none is told."""
    for sample in navigation_samples(flown):
        if isinstance(sample, HeadingSample) or getattr(sample, "source", None) in RTK:
            continue
        if sigma_m is not None and isinstance(sample, PositionSample):
            yield replace(sample, covariance_n=np.diag(np.square(sigma_m)))
        else:
            yield sample


def flown_through(flown, samples, **values):
    """The state at each IMU sample, the solutions, and the filter's last word."""
    navigation, states, found = Navigation(config_for(flown, **values)), [], []
    for sample in samples:
        solution = navigation.process(sample).solution
        if solution is not None:
            found.append(solution)
        if isinstance(sample, ImuSample):
            states.append(navigation.status().state)
    return states, found, navigation.status()


@pytest.mark.parametrize("method", ["ekf", "ekf_heading"])
@pytest.mark.parametrize(
    ("sigma_m", "said"),
    [
        (None, ""),
        (ZERO, ""),
        ((0.9, 1.3, 100.0), "; gps/fix has a sigma of 100 m in height"),  # as import has it
        ((15.0, 15.0, 30.0), "; gps/fix has a sigma of 15 m, 30 m in height"),
        ((10.0, 10.0, 1000.0), "; gps/fix has a sigma of 1000 m in height"),  # of a 2D fix
    ],
)
def test_it_starts_after_its_wait_and_stays_degraded(method, sigma_m, said):
    flown = flight(44, 40.0)
    states, found, status = flown_through(flown, without_rtk(flown, sigma_m), method=method)
    assert set(states[570:]) == {FilterState.DEGRADED}  # alignment.wait_s and max_delay_s: 5.5 s
    heading = ", rtk/heading" if method == "ekf_heading" else ""
    assert status.reason == f"no rtk/fix, rtk/vel{heading}{said}"
    late = errors(flown, found).after(15.0)
    assert (np.abs(late.state / late.sigma)[:, :3] < 4.0).all()
    assert (np.abs(late.state[:, :2]) < 5.0).all()  # four of the receiver's true 1.28 m
    if sigma_m and sigma_m[2] >= 30:
        assert late.sigma[-1, 2] > 0.5 * sigma_m[2]  # what lasts is not averaged away


def test_it_outlasts_a_silence_of_a_poor_receiver():
    """Five seconds on velocities alone: dead reckoning, not lost; what was poor is so still."""
    flown = flight(44, 40.0)
    first_ns = flown.truth.stamp_ns[0]
    fed = [
        s
        for s in without_rtk(flown, (0.9, 1.3, 100.0))
        if isinstance(s, ImuSample) or not 20 <= (s.stamp_ns - first_ns) * 1e-9 < 25
    ]
    states, _, _ = flown_through(flown, fed, method="ekf")
    seen = Counter(states)
    assert seen[FilterState.DEAD_RECKONING] > 300
    assert FilterState.LOST not in seen
    assert states[-1] is FilterState.DEGRADED


CALM = {"wind.gust_m_s": 0.0, "wind.mean_m_s": [0.0, 0.0], "route.hold_error_m": 0.0}


@pytest.mark.slow
def test_the_autopilots_heading_serves_where_nothing_holds_it():
    """Hovering in still air for three minutes: poses all the time, within their sigma."""
    values = CALM | {"duration_s": 180.0, "route.hover_s": 180.0}
    flown = fly(scenario_from(values), 1)
    states, found, status = flown_through(flown, without_rtk(flown), method="ekf")
    assert set(states[570:]) == {FilterState.DEGRADED}
    assert status.counts["autopilot_heading", "used"] >= 1
    late = errors(flown, found).after(10.0)
    sigma_deg = np.degrees(late.sigma[:, 5])
    limit_deg = 3 * EkfConfig().autopilot.attitude_sigma_deg[2]
    assert (sigma_deg < 1.1 * limit_deg).all()  # it is looked at ten times a second
    # Three sigmas of the autopilot in the state, one in its own word: three of both.
    assert (np.abs(np.degrees(late.rpy[:, 2])) < 3 * limit_deg).all()


def test_no_flight_with_antennas_takes_it():
    flown = flight(duration_s=40.0)
    navigation = Navigation(config_for(flown))
    for sample in navigation_samples(flown):
        navigation.process(sample)
    assert not [key for key in navigation.status().counts if key[0] == "autopilot_heading"]


# One measurement


def belief_of(heading_sigma_deg):
    q = tuple(quat_from_euler(0.0, 0.0, math.radians(30.0)).tolist())
    state = NavState(q, ZERO, 0.7, 2.0, 20.0, ZERO, ZERO, ZERO)
    sigmas = np.full(18, 1e-3)
    sigmas[2] = math.radians(heading_sigma_deg)
    return StateEstimate(state, np.diag(sigmas**2), AidStatus(Receivers(0)))


@pytest.mark.parametrize(
    ("sigma_deg", "off_deg", "outcome"),
    [
        (5.3, 1.0, Outcome.STANDBY),  # three of its 1.7972 deg are 5.39
        (5.5, 1.0, Outcome.USED),
        (5.5, -90.0, Outcome.GATED),  # five of 5.8 deg are 29
        (9.0, 180.0, Outcome.GATED),
    ],
)
def test_it_is_taken_where_it_tells_more_and_refused_where_it_contradicts(
    sigma_deg, off_deg, outcome
):
    variance = math.radians(1.8) ** 2
    sample = AutopilotHeading(SECOND_NS, math.radians(30.0 + off_deg), variance)
    config = EkfConfig()
    verdict, after = Fusion(config).fuse(sample, belief_of(sigma_deg), ZERO)
    assert (verdict.source, verdict.outcome) == (Source.AUTOPILOT_HEADING, outcome)
    if outcome is Outcome.USED:
        expected = 1 / (1 / math.radians(sigma_deg) ** 2 + 1 / variance)
        assert after.covariance[2, 2] == pytest.approx(expected, rel=1e-6)


def test_it_is_offered_once_a_second():
    headings = AutopilotHeadingAid(EkfConfig())
    covariance = belief_of(6.0).covariance
    q_nb = quat_from_euler(0.1, -0.2, math.radians(-50.0))

    def imu(t_s, q=q_nb):
        return ImuSample(round(t_s * 1e9), np.zeros(3), np.zeros(3), q)

    assert headings.sample(imu(0.5, None), covariance) is None
    assert math.degrees(headings.sample(imu(1.0), covariance).heading_rad) == pytest.approx(-50)
    assert headings.sample(imu(1.9), covariance) is None
    assert headings.sample(imu(2.0), belief_of(1.0).covariance) is None
    assert headings.sample(imu(2.1), covariance) is not None


# What a receiver admits


def fix(variances, source=Source.GPS_POSITION, status=FixStatus.SINGLE, t_s=10.0):
    stamp_ns = round(t_s * 1e9)
    return PositionSample(stamp_ns, source, status, 0.7, 2.0, 20.0, np.diag(variances))


def test_bounds_and_words_of_what_is_admitted():
    admitted = ReportedAccuracy(EkfConfig())
    assert admitted.bounds_m2() == (100.0,) * 3
    admitted.hear(fix((0.0, 0.0, 0.0)))
    admitted.hear(fix((1e4,) * 3, status=FixStatus.NONE))
    assert (admitted.bounds_m2(), admitted.text()) == ((100.0,) * 3, "")
    admitted.hear(fix((400.0, 25.0, 1e4)))
    admitted.hear(fix((1e-4,) * 3, Source.RTK_POSITION, FixStatus.FIXED))
    assert admitted.bounds_m2() == pytest.approx((900.0, 100.0, 22500.0))
    assert admitted.text() == "gps/fix has a sigma of 20 m, 100 m in height"


@pytest.mark.parametrize(
    ("rtk_s", "gps_s", "times"),
    [
        (None, None, 1.0),  # the first says all that it can
        (None, 9.9, 900.0),  # 2 x 45 s over 0.1 s
        (None, 5.0, 90.0),
        (9.0, 9.9, 1.0),  # its error is learned against RTK
    ],
)
def test_what_lasts_is_not_averaged_away_without_rtk(rtk_s, gps_s, times):
    control = AidStatus(Receivers(0))
    for source, t_s in ((Source.RTK_POSITION, rtk_s), (Source.GPS_POSITION, gps_s)):
        if t_s is not None:
            control = control.with_track(source, AidTrack(round(t_s * 1e9)))
    gps = EkfConfig().gps
    known = np.square(gps.position_sigma_m) + gps.position_noise_m**2
    belief = belief_of(1.0)._replace(control=control)
    found = (
        GpsPositionAid(EkfConfig())
        .measured(fix(known + 9.0), belief, (0.0,) * 3)[0]
        .measurement.noise
    )
    expected = np.eye(3) * (gps.position_noise_m**2 + 9.0 * times)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
