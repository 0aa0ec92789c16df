"""The records of the aids: silence, runs of refusals, status, easing, resets."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import MEASURED

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid_status import (
    AID_SOURCES,
    EASE_STEPS,
    AidStatus,
    AidTrack,
    Receivers,
    Reset,
)
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome

SECOND_NS = 1_000_000_000
TIMEOUT_NS = SECOND_NS
HOME = (0.695, 2.04, 31.5)
LEVEL = NavState((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, *HOME, *[(0.0,) * 3] * 3)


def ns(seconds: float) -> int:
    return 1000 * SECOND_NS + round(seconds * SECOND_NS)


def heard(control: AidStatus, t_s: float, status=FixStatus.FIXED) -> AidStatus:
    return control.heard(status, ns(t_s), TIMEOUT_NS)


# One aid's record


@pytest.mark.parametrize(("age_ns", "recent"), [(TIMEOUT_NS, True), (TIMEOUT_NS + 1, False)])
def test_recent_up_to_the_time_out(age_ns, recent):
    assert AidTrack(used_ns=ns(0)).recent(ns(0) + age_ns, TIMEOUT_NS) is recent
    assert not AidTrack().recent(ns(0), TIMEOUT_NS)


def test_for_how_long_it_has_agreed():
    """Without the silences, and without the times of refusals."""
    track = AidTrack().used(ns(0), TIMEOUT_NS)
    assert track.agreed_ns == 0
    track = track.used(ns(1.0), TIMEOUT_NS)
    assert (track.used_ns, track.agreed_ns) == (ns(1.0), SECOND_NS)
    track = track.used(ns(2.001), TIMEOUT_NS)
    assert track.agreed_ns == SECOND_NS
    track = track.used(ns(2.501), TIMEOUT_NS)
    assert track.agreed_ns == 1.5 * SECOND_NS
    track = track.refused(ns(2.7), (9.0,), 0.1).used(ns(2.9), TIMEOUT_NS)
    assert track.agreed_ns == 1.5 * SECOND_NS


def test_run_of_refusals_that_agree():
    track = AidTrack()
    for k in range(5):
        track = track.refused(ns(0.2 * k), (3.0 + 0.04 * k, -1.0), 0.2)
    assert (track.run.number, track.run.first_ns, track.run.last_ns) == (5, ns(0), ns(0.8))
    assert track.run.lasts(0.8)
    assert not track.run.lasts(0.800000001)
    assert track.used(ns(1.0), TIMEOUT_NS).run is None


def steps(track, t_s, *innovation):
    """The record after a refusal, as the fusion notes it, of a thing that should be zero."""
    zero = (0.0,) * len(innovation)
    track = track.followed(innovation, zero)
    step = track.stepped(innovation, zero)
    return track.refused(ns(t_s), innovation, 0.2, step=step)


def test_a_step_is_told_from_a_drift():
    fitted = AidTrack().used(ns(0), TIMEOUT_NS, (0.1, 0.0))
    assert steps(fitted, 0.2, 0.6, 0.0).step == (0.5, 0.0)
    assert steps(fitted, 0.2, 0.3, 0.0).step == ()  # two thirds of it are new: 0.7 are asked
    assert steps(AidTrack(), 0.2, 0.6, 0.0).step == ()  # nothing has fitted yet


def test_a_step_back_ends_it_and_another_step_begins_anew():
    track = steps(AidTrack().used(ns(0), TIMEOUT_NS, (0.0,)), 0.2, 0.5)
    track = steps(track, 0.4, 0.55)
    assert (track.step, track.denied_ns) == ((0.5,), ns(0.2))
    assert track.followed((0.1,), (0.0,)).step == ()
    assert track.followed((0.3,), (0.0,)).step == (0.5,)  # drift, or noise
    other = steps(track, 0.6, -0.55)
    assert other.step == pytest.approx((-0.6,))
    assert other.denied_ns == ns(0.6)


def test_run_needs_five():
    track = AidTrack()
    for k in range(4):
        track = track.refused(ns(10.0 * k), (3.0,), 0.2)
    assert not track.run.lasts(2.0)
    assert track.refused(ns(40.0), (3.0,), 0.2).run.lasts(2.0)


@pytest.mark.parametrize(("innovation", "number"), [((3.2, -1.0), 3), ((3.2, -1.21), 1)])
def test_what_does_not_agree_with_the_first_begins_another_run(innovation, number):
    """Within the slack on each axis, against the first: a drift does not add up."""
    track = AidTrack().refused(ns(0), (3.0, -1.0), 0.2000001)
    track = track.refused(ns(0.2), (3.1, -1.1), 0.2000001)
    found = track.refused(ns(0.4), innovation, 0.2000001)
    assert found.run.number == number
    assert found.run.first_ns == (ns(0) if number > 1 else ns(0.4))


def test_status_holds_for_the_time_out():
    control = AidStatus(Receivers(0)).heard(FixStatus.FLOAT, ns(0), TIMEOUT_NS)
    assert control.status_at(ns(1.0), TIMEOUT_NS) is FixStatus.FLOAT
    assert control.status_at(ns(1.0) + 1, TIMEOUT_NS) is None
    assert AidStatus(Receivers(0)).status_at(ns(0), TIMEOUT_NS) is None


def test_fixed_since():
    control = (
        AidStatus(Receivers(0))
        .heard(FixStatus.FIXED, ns(0), TIMEOUT_NS)
        .heard(FixStatus.FIXED, ns(0.2), TIMEOUT_NS)
    )
    assert control.fixed_since_ns == ns(0)
    control = control.heard(FixStatus.FLOAT, ns(0.4), TIMEOUT_NS).heard(
        FixStatus.FIXED, ns(0.6), TIMEOUT_NS
    )
    assert control.fixed_since_ns == ns(0.6)


def test_fixed_again_is_eased_and_only_the_position():
    control = AidStatus(Receivers(0)).heard(FixStatus.FIXED, ns(0), TIMEOUT_NS)
    assert [t.ease for t in control.tracks] == [0] * len(AID_SOURCES)
    control = control.heard(FixStatus.FLOAT, ns(1), TIMEOUT_NS)
    assert [t.ease for t in control.tracks] == [0] * len(AID_SOURCES)
    control = control.heard(FixStatus.FIXED, ns(2), TIMEOUT_NS)
    assert [t.ease for t in control.tracks] == [EASE_STEPS] + [0] * (len(AID_SOURCES) - 1)


def test_resets_are_counted_and_told():
    control = AidStatus(Receivers(0)).with_reset(Source.RTK_HEADING, ns(0), math.radians(-20.0))
    assert control.resets == (0, 0, 1, 0, 0, 0)
    assert str(control.last_reset) == "heading turned by -20.0 deg"
    assert control.track(Source.RTK_HEADING) == AidTrack(ns(0))
    texts = {
        Source.RTK_POSITION: "position moved by 1.50 m",
        Source.RTK_VELOCITY: "velocity changed by 1.50 m/s",
        Source.GPS_POSITION: "GPS error changed by 1.50 m",
    }
    for source, text in texts.items():
        assert str(Reset(source, 0, 1.5)) == text


def test_a_reset_velocity_of_the_gps_is_told_as_a_velocity():
    assert str(Reset(Source.GPS_VELOCITY, 0, 1.5)) == "velocity changed by 1.50 m/s"


@pytest.mark.parametrize(("last_s", "hopeless"), [(10.0, True), (10.001, False)])
def test_three_resets_within_ten_seconds_are_hopeless(last_s, hopeless):
    control = AidStatus(Receivers(0))
    for t_s, source in ((0, Source.RTK_POSITION), (4.0, Source.RTK_VELOCITY)):
        control = control.with_reset(source, ns(t_s), 1.0)
        assert control.hopeless(2.0) == ""
    control = control.with_reset(Source.RTK_HEADING, ns(5.0), 1.0)
    control = control.with_reset(Source.GPS_POSITION, ns(5.0), 1.0)
    assert control.hopeless(2.0) == ""  # neither moves position or velocity
    control = control.with_reset(Source.RTK_POSITION, ns(last_s), 1.0)
    why = "reset again and again: position moved by 1.00 m"
    assert control.hopeless(2.0) == (why if hopeless else "")


def denied(control, source, times_s):
    """Refusals that do not even agree with each other."""
    track = control.track(source)
    for k, t_s in enumerate(times_s):
        track = track.refused(ns(t_s), (3.0 * k,), 0.1)
    return control.with_track(source, track)


FIVE_A_SECOND = tuple(0.2 * k for k in range(11))
BOTH = (Source.RTK_POSITION, Source.RTK_VELOCITY)


@pytest.mark.parametrize(
    ("sources", "times_s", "hopeless"),
    [
        (BOTH, FIVE_A_SECOND, True),
        (BOTH, FIVE_A_SECOND[:-1], False),  # not for long enough
        (BOTH, (0.0, 0.6, 1.2, 2.0), False),  # too few
        (BOTH[:1], FIVE_A_SECOND, False),  # the other one may be right
        (BOTH[1:], FIVE_A_SECOND, False),
    ],
)
def test_position_and_velocity_that_both_contradict_are_hopeless(sources, times_s, hopeless):
    control = AidStatus(Receivers(0))
    for source in sources:
        control = denied(control, source, times_s)
    why = "rtk/fix and rtk/vel both contradict it"
    assert control.hopeless(2.0) == (why if hopeless else "")


def test_a_use_ends_the_denial():
    control = AidStatus(Receivers(0))
    for source in BOTH:
        control = denied(control, source, FIVE_A_SECOND)
    track = control.track(Source.RTK_VELOCITY).used(ns(2.1), TIMEOUT_NS)
    assert (track.denied, track.run) == (0, None)
    assert control.with_track(Source.RTK_VELOCITY, track).hopeless(2.0) == ""


def test_denials_end_with_the_receiver():
    """Refused for less than a second, then silent: the silence proves nothing."""
    control = AidStatus(Receivers(0))
    for source in BOTH:
        control = denied(control, source, FIVE_A_SECOND[:5])
    assert control.hopeless(2.0) == ""


# Headings: conditions to start and to continue


def heading_config(**values):
    given = {f"heading.{key}": value for key, value in values.items()}
    return config_from(
        EkfConfig,
        {"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)}
        | given
        | {"trust.aid_timeout_s": TIMEOUT_NS * 1e-9},
    )


def fixed_belief(fixed_s: float, now_s: float) -> StateEstimate:
    """Level, nose north, fixed for so long, headings not used yet."""
    control = AidStatus(Receivers(ns(now_s))).heard(
        FixStatus.FIXED, ns(now_s - fixed_s), TIMEOUT_NS
    )
    t_s = now_s - fixed_s
    while t_s < now_s:  # the receiver says so five times a second
        t_s = min(t_s + 0.2, now_s)
        control = control.heard(FixStatus.FIXED, ns(t_s), TIMEOUT_NS)
    covariance = 1e-4 * np.eye(18)
    covariance[2, 2] = math.radians(0.1) ** 2
    return StateEstimate(LEVEL, covariance, control)


def heading(t_s: float, degrees: float = 0.0) -> HeadingSample:
    return HeadingSample(ns(t_s), math.radians(degrees), math.radians(0.6) ** 2)


def fused(config, belief, sample):
    return Fusion(config).fuse(sample, belief, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(("fixed_s", "used"), [(0.999, False), (1.0, True)])
def test_headings_start_after_a_while_of_fixed_positions(fixed_s, used):
    found = fused(heading_config(start_after_s=1.0), fixed_belief(fixed_s, 5.0), heading(5.0))
    assert found.verdict.used is used
    if not used:
        assert found.verdict.outcome is Outcome.NOT_FIXED
        assert found.verdict.reason == "rtk/fix is fixed for 1.0 s only"


def test_headings_go_on_where_they_were_used_lately():
    """One float fix in between stops them for its own time only."""
    config, belief = heading_config(start_after_s=1.0), fixed_belief(3.0, 5.0)
    belief = fused(config, belief, heading(5.0)).belief
    belief = belief._replace(control=belief.control.heard(FixStatus.FLOAT, ns(5.1), TIMEOUT_NS))
    stopped = fused(config, belief, heading(5.2))
    assert stopped.verdict.reason == "rtk/fix is not fixed"
    belief = stopped.belief._replace(control=heard(stopped.belief.control, 5.3))
    assert fused(config, belief, heading(5.4)).verdict.used


@pytest.mark.parametrize(("age_s", "used"), [(1.0, True), (1.001, False)])
def test_headings_stop_where_the_status_is_silent(age_s, used):
    config = heading_config()
    belief = fused(config, fixed_belief(3.0, 5.0), heading(5.0)).belief
    found = fused(config, belief, heading(5.0 + age_s))
    assert found.verdict.used is used
    if not used:
        assert found.verdict.reason == "rtk/fix is silent"


def test_fixed_for_so_long_is_counted_from_the_end_of_a_silence():
    """What the receiver was a minute ago does not make a fix of now one that has lasted."""
    config = heading_config(start_after_s=1.0)
    belief = fixed_belief(3.0, 5.0)
    belief = belief._replace(control=belief.control.heard(FixStatus.FIXED, ns(65.0), TIMEOUT_NS))
    found = fused(config, belief, heading(65.0))
    assert found.verdict.outcome is Outcome.NOT_FIXED


# Headings: for how long they must contradict


def agreed(config, seconds: float) -> StateEstimate:
    """A belief that headings of zero have confirmed for so long, five times a second."""
    belief = fixed_belief(3.0, 0.0)
    for k in range(round(seconds * 5) + 1):
        belief = belief._replace(control=heard(belief.control, 0.2 * k))
        found = fused(config, belief, heading(0.2 * k))
        assert found.verdict.used
        belief = with_sigma(found.belief)
    return belief


def with_sigma(belief: StateEstimate) -> StateEstimate:
    """Its covariance as at first: nothing is learned, nothing drifts."""
    return belief._replace(covariance=fixed_belief(3.0, 0.0).covariance)


def given_up_after(config, belief: StateEstimate, start_s: float, offs_deg, autopilot_deg=None):
    """Seconds from the first refusal until the state is set to headings that are off, or None."""
    q_nb = None
    if autopilot_deg is not None:
        q_nb = quat_from_euler(0.0, 0.0, math.radians(autopilot_deg))
    first_s = None
    for k, degrees in enumerate(offs_deg):
        t_s = start_s + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        found = Fusion(config).fuse(
            heading(t_s, degrees), belief, (0.0, 0.0, 0.0), autopilot_q_nb=q_nb
        )
        belief = with_sigma(found.belief)
        if found.verdict.outcome is Outcome.RESET:
            return t_s - first_s
        if found.verdict.outcome is Outcome.GATED and first_s is None:
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
        (10.0, 10.0, None),  # so little the autopilot may err by
    ],
)
def test_headings_that_step_away_are_the_antennas_unless_the_autopilot_has_seen_it_too(
    off_deg, autopilot_deg, patience_s
):
    config = heading_config(reset_after_s=5.0)
    found = given_up_after(config, agreed(config, 100.0), 100.2, [off_deg] * 400, autopilot_deg)
    assert found == (None if patience_s is None else pytest.approx(patience_s, abs=0.2001))


@pytest.mark.parametrize(
    ("agreed_s", "patience_s"),
    [
        (1.0, 5.0),  # reset_after_s at least
        (20.0, 20.0),  # as long as it had agreed
        (100.0, 60.0),  # a minute at most
    ],
)
def test_what_has_drifted_away_must_last_as_long_as_the_agreement(agreed_s, patience_s):
    """Gyroscopes that fail turn the state by degrees: the headings are right then."""
    config = heading_config(reset_after_s=5.0)
    ramp = list(np.arange(0.0, 12.0, 1.0))
    found = given_up_after(config, agreed(config, agreed_s), agreed_s + 0.2, ramp + [12.0] * 400)
    # On the ramp, which lasts 2.4 s, they do not agree with each other.
    assert patience_s <= found + 1e-9 <= patience_s + 2.4


def test_headings_that_come_late_and_far_off_do_not_win():
    """A start by the autopilot's heading; the antennas come later, 90 deg off."""
    config = heading_config(reset_after_s=5.0)
    assert given_up_after(config, fixed_belief(3.0, 0.0), 0.2, [90.0] * 400, 2.0) is None
    assert given_up_after(config, fixed_belief(3.0, 0.0), 0.2, [12.0] * 400, 2.0) >= 5.0


def test_contradictions_that_do_not_agree_prove_nothing():
    """A heading that runs round: refused for a minute and more, the state stays."""
    config = heading_config(reset_after_s=5.0)
    belief = agreed(config, 10.0)
    for k in range(500):
        t_s = 10.2 + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        found = fused(config, belief, heading(t_s, 60.0 + (37.0 * k) % 240.0))
        assert found.verdict.outcome is Outcome.GATED
        belief = found.belief
    assert belief.state.q_nb == pytest.approx(LEVEL.q_nb, abs=1e-6)


def test_one_chance_agreement_does_not_spend_the_trust():
    """Headings agreed for a minute; then wrong, once right by chance, and wrong again."""
    config = heading_config(reset_after_s=5.0)
    belief = agreed(config, 60.0)
    for k in range(25):  # the mean of the innovations is far away for a while
        t_s = 60.2 + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        belief = fused(config, belief, heading(t_s, 90.0 if k < 10 else 0.0)).belief
        if belief.control.track(Source.RTK_HEADING).run is None and k > 10:
            break
    assert belief.control.track(Source.RTK_HEADING).run is None  # it has agreed
    assert given_up_after(config, with_sigma(belief), t_s + 0.2, [90.0] * 400) is None


# Easing: an aid that comes back after a silence


def position(t_s: float, shift_m: float, status=FixStatus.FIXED) -> PositionSample:
    plane = TangentPlane(*HOME)
    lat, lon, height = (float(x) for x in plane.geodetic_from_ned(np.array([shift_m, 0, 0])))
    noise = np.diag([1e-4, 1e-4, 4e-4])
    return PositionSample(ns(t_s), Source.RTK_POSITION, status, lat, lon, height, noise)


def drifted(sigma_m: float = 1.0) -> StateEstimate:
    """After an outage: the position is known to a metre, RTK was used 12 s ago."""
    belief = fixed_belief(3.0, 0.0)
    control = belief.control.with_track(Source.RTK_POSITION, AidTrack(ns(0)))
    covariance = belief.covariance.copy()
    covariance[6:9, 6:9] = sigma_m**2 * np.eye(3)
    return StateEstimate(LEVEL, covariance, control)


def test_position_comes_back_in_equal_steps():
    fusion, belief = Fusion(MEASURED), drifted()
    places, sigmas = [], []
    for k in range(6):
        found = fusion.fuse(position(12.0 + 0.2 * k, 0.8), belief, (0.0,) * 3)
        assert found.verdict.used
        belief = found.belief
        places.append(belief.state.correction_n[0])
        sigmas.append(math.sqrt(belief.covariance[6, 6]))
    # Equal but for the noise's share, 1e-4 of the state's variance, five times.
    assert places[:5] == pytest.approx([0.16, 0.32, 0.48, 0.64, 0.8], abs=5 * 1e-3 * 0.8)
    assert places[5] == pytest.approx(0.8, abs=0.01)
    # What is left to go is never more than the covariance says: 0.8 m was 0.8 sigma.
    left = 0.8 - np.array(places)
    assert (left[:5] <= 1.01 * np.array(sigmas[:5])).all()
    assert sigmas == sorted(sigmas, reverse=True)
    # The fifth is taken in full, and the sixth: of two fixes of a centimetre each.
    assert sigmas[5] == pytest.approx(0.01 / math.sqrt(2), rel=1e-3)


def test_position_that_was_used_lately_is_not_eased():
    belief = drifted()
    fresh = belief.control.with_track(Source.RTK_POSITION, AidTrack(ns(11.5)))
    fresh = fresh.heard(FixStatus.FIXED, ns(0.5), 12 * TIMEOUT_NS)
    fresh = fresh.heard(FixStatus.FIXED, ns(11.5), 12 * TIMEOUT_NS)
    found = Fusion(MEASURED).fuse(position(12.0, 0.8), belief._replace(control=fresh), (0.0,) * 3)
    assert found.belief.state.correction_n[0] == pytest.approx(0.8, abs=1e-3)


def test_covariance_of_an_eased_position_is_honest():
    """Monte Carlo: error over sigma, at most one on the way and one at its end."""
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(300):
        belief, fusion = drifted(1.0), Fusion(MEASURED)
        truth = rng.normal()
        for k in range(6):
            sample = position(12.0 + 0.2 * k, truth + 0.01 * rng.normal())
            belief = fusion.fuse(sample, belief, (0.0,) * 3).belief
            left = truth - belief.state.correction_n[0]
            ratios.append(left / math.sqrt(belief.covariance[6, 6]))
    found = np.sqrt(np.mean(np.square(np.reshape(ratios, (-1, 6))), axis=0))
    # 300 draws: 4 % one sigma. On the way it is on the safe side: each fix says more than it may.
    assert (found < 1.16).all()
    assert found[5] == pytest.approx(1.0, abs=0.16)


def test_float_positions_weigh_what_their_slow_error_leaves():
    """Monte Carlo over minutes: a Gauss-Markov error of the float, and the sigma after it.

    The state stands still with a random walk of its own, as an inertial position does.
    """
    config = MEASURED
    sigma_m, time_s = config.rtk.float_sigma_m, config.rtk.float_time_s
    rng, step_s, walk = np.random.default_rng(6), 0.2, 0.05
    ratios = []
    for _ in range(20):
        belief, fusion = drifted(0.01), Fusion(config)
        truth = 0.01 * rng.normal()
        error = sigma_m * rng.normal()
        keep = math.exp(-step_s / time_s)
        for k in range(200):
            covariance = belief.covariance.copy()
            covariance[6, 6] += walk**2 * step_s
            belief = belief._replace(covariance=covariance)
            truth += walk * math.sqrt(step_s) * rng.normal()
            error = keep * error + sigma_m * math.sqrt(1 - keep**2) * rng.normal()
            sample = position(0.2 * (k + 1), truth + error, FixStatus.FLOAT)
            belief = fusion.fuse(sample, belief, (0.0,) * 3).belief
            if k >= 50:
                left = truth - belief.state.correction_n[0]
                ratios.append(left / math.sqrt(belief.covariance[6, 6]))
    # White noise of the same power over long times is what a slow state sees: the estimate of
    # a state that walks as fast as the error is not far from honest on either side.
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
