"""The records of the aids: silence, runs of refusals, status, resets."""

from __future__ import annotations

import math

import pytest
from aid_records import SECOND_NS, TIMEOUT_NS, ns

from tirgeo_ros.core.navigation.aiding.aid_status import (
    AID_SOURCES,
    EASE_STEPS,
    AidStatus,
    AidTrack,
    Receivers,
    Reset,
)
from tirgeo_ros.core.types.measurements import FixStatus, Source

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
    assert control.resets[2] == sum(control.resets) == 1
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
    control = control.with_reset(Source.BAROMETER, ns(last_s), 40.0)  # not the one to name
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
