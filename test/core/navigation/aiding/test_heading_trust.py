"""When headings of the antennas are used, and how long they must contradict the state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import LEVEL, ZERO, ekf_config, heading, heard, ns

from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, Receivers
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.core.types.verdicts import Outcome

CONFIG = ekf_config(
    heading__start_after_s=1.0, heading__reset_after_s=5.0, trust__aid_timeout_s=1.0
)


def fixed_belief(fixed_s: float, now_s: float) -> StateEstimate:
    """Level, nose north, fixed for so long, headings not used yet."""
    control, t_s = heard(AidStatus(Receivers(ns(now_s))), now_s - fixed_s), now_s - fixed_s
    while t_s < now_s:  # the receiver says so five times a second
        t_s = min(t_s + 0.2, now_s)
        control = heard(control, t_s)
    covariance = 1e-4 * np.eye(18)
    covariance[2, 2] = math.radians(0.1) ** 2
    return StateEstimate(LEVEL, covariance, control)


def fused(belief, sample, q_nb=None):
    return Fusion(CONFIG).fuse(sample, belief, ZERO, autopilot_q_nb=q_nb)


@pytest.mark.parametrize(
    ("fixed_s", "reason"), [(0.999, "rtk/fix has been fixed for only 1.0 s"), (1.0, "")]
)
def test_headings_start_after_a_while_of_fixed_positions(fixed_s, reason):
    found = fused(fixed_belief(fixed_s, 5.0), heading(5.0)).verdict
    assert (found.outcome is Outcome.NOT_FIXED, found.reason) == (bool(reason), reason)


def test_headings_go_on_where_they_were_used_lately():
    """One float fix in between stops them for its own time only."""
    belief = fused(fixed_belief(3.0, 5.0), heading(5.0)).belief
    belief = belief._replace(control=heard(belief.control, 5.1, FixStatus.FLOAT))
    stopped = fused(belief, heading(5.2))
    assert stopped.verdict.reason == "rtk/fix is not fixed"
    belief = stopped.belief._replace(control=heard(stopped.belief.control, 5.3))
    assert fused(belief, heading(5.4)).verdict.used


@pytest.mark.parametrize(("age_s", "reason"), [(1.0, ""), (1.001, "rtk/fix is silent")])
def test_headings_stop_where_the_status_is_silent(age_s, reason):
    belief = fused(fixed_belief(3.0, 5.0), heading(5.0)).belief
    assert fused(belief, heading(5.0 + age_s)).verdict.reason == reason
    # A fix of now does not count from before the silence.
    late = belief._replace(control=heard(belief.control, 65.0))
    assert fused(late, heading(65.0)).verdict.outcome is Outcome.NOT_FIXED


# Headings: for how long they must contradict


def agreed(seconds: float) -> StateEstimate:
    """A belief that headings of zero have confirmed for so long, five times a second."""
    belief = fixed_belief(3.0, 0.0)
    for k in range(round(seconds * 5) + 1):
        belief = belief._replace(control=heard(belief.control, 0.2 * k))
        found = fused(belief, heading(0.2 * k))
        assert found.verdict.used
        belief = with_sigma(found.belief)
    return belief


def with_sigma(belief: StateEstimate) -> StateEstimate:
    """Its covariance as at first: nothing is learned, nothing drifts."""
    return belief._replace(covariance=fixed_belief(3.0, 0.0).covariance)


def given_up_after(belief: StateEstimate, start_s: float, offs_deg, autopilot_deg=None):
    """Seconds from the first refusal until the state is set to headings that are off, or None."""
    q_nb = None
    if autopilot_deg is not None:
        q_nb = quat_from_euler(0.0, 0.0, math.radians(autopilot_deg))
    first_s = None
    for k, degrees in enumerate(offs_deg):
        t_s = start_s + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        found = fused(belief, heading(t_s, degrees), q_nb)
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
    found = given_up_after(agreed(100.0), 100.2, [off_deg] * 400, autopilot_deg)
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
    ramp = list(np.arange(0.0, 12.0, 1.0))
    found = given_up_after(agreed(agreed_s), agreed_s + 0.2, ramp + [12.0] * 400)
    # On the ramp, which lasts 2.4 s, they do not agree with each other.
    assert patience_s <= found + 1e-9 <= patience_s + 2.4


def test_headings_that_come_late_and_far_off_do_not_win():
    """A start by the autopilot's heading; the antennas come later, 90 deg off."""
    assert given_up_after(fixed_belief(3.0, 0.0), 0.2, [90.0] * 400, 2.0) is None
    assert given_up_after(fixed_belief(3.0, 0.0), 0.2, [12.0] * 400, 2.0) >= 5.0


def test_contradictions_that_do_not_agree_prove_nothing():
    """A heading that runs round: refused for a minute and more, the state stays."""
    belief = agreed(10.0)
    for k in range(500):
        t_s = 10.2 + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        found = fused(belief, heading(t_s, 60.0 + (37.0 * k) % 240.0))
        assert found.verdict.outcome is Outcome.GATED
        belief = found.belief
    assert belief.state.q_nb == pytest.approx(LEVEL.q_nb, abs=1e-6)


def test_one_chance_agreement_does_not_spend_the_trust():
    """Headings agreed for a minute; then wrong, once right by chance, and wrong again."""
    belief = agreed(60.0)
    for k in range(25):  # the mean of the innovations is far away for a while
        t_s = 60.2 + 0.2 * k
        belief = belief._replace(control=heard(belief.control, t_s))
        belief = fused(belief, heading(t_s, 90.0 if k < 10 else 0.0)).belief
        if belief.control.track(Source.RTK_HEADING).run is None and k > 10:
            break
    assert belief.control.track(Source.RTK_HEADING).run is None  # it has agreed
    assert given_up_after(with_sigma(belief), t_s + 0.2, [90.0] * 400) is None
