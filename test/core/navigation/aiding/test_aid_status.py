"""The records of the aids: silence, runs of refusals, steps, status, resets."""

from __future__ import annotations

import math

import pytest
from filter_states import NOW_NS, SECOND_NS, TIMEOUT_NS, heard, ns

from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, AidStatus, AidTrack, Receivers
from tirgeo_ros.core.types.measurements import FixStatus, Source

NEW = AidStatus(Receivers(NOW_NS))


def test_for_how_long_it_has_agreed():
    """Without silences beyond the time-out, and without the times of refusals."""
    track = AidTrack()
    assert not track.recent(ns(0), TIMEOUT_NS)
    for t_s, agreed_s in ((0.0, 0.0), (1.0, 1.0), (2.001, 1.0), (2.501, 1.5)):
        assert track.recent(ns(t_s), TIMEOUT_NS) is (t_s in {1.0, 2.501})
        track = track.used(ns(t_s), TIMEOUT_NS)
        assert (track.used_ns, track.agreed_ns) == (ns(t_s), agreed_s * SECOND_NS)
    track = track.refused(ns(2.7), (9.0,), 0.1).used(ns(2.9), TIMEOUT_NS)
    assert track.agreed_ns == 1.5 * SECOND_NS


def test_a_run_of_refusals_that_agree_lasts_with_five():
    track = AidTrack()
    for k in range(5):
        assert k == 0 or not track.run.lasts(0.0)
        track = track.refused(ns(0.2 * k), (3.0 + 0.04 * k, -1.0), 0.2)
    assert (track.run.number, track.run.first_ns, track.run.last_ns) == (5, ns(0), ns(0.8))
    assert track.run.lasts(0.8)
    assert not track.run.lasts(0.800000001)
    assert track.used(ns(1.0), TIMEOUT_NS).run is None


@pytest.mark.parametrize(("innovation", "number"), [((3.2, -1.0), 3), ((3.2, -1.21), 1)])
def test_what_does_not_agree_with_the_first_begins_another_run(innovation, number):
    """Within the slack on each axis, against the first: a drift does not add up."""
    track = AidTrack().refused(ns(0), (3.0, -1.0), 0.2000001)
    track = track.refused(ns(0.2), (3.1, -1.1), 0.2000001)
    found = track.refused(ns(0.4), innovation, 0.2000001)
    assert found.run.number == number
    assert found.run.first_ns == (ns(0) if number > 1 else ns(0.4))


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


def test_status_holds_for_the_time_out_and_fixed_counts_from_its_begin():
    assert NEW.status_at(ns(0), TIMEOUT_NS) is None
    control = heard(NEW, 0.0, FixStatus.FLOAT)
    assert control.status_at(ns(1.0), TIMEOUT_NS) is FixStatus.FLOAT
    assert control.status_at(ns(1.0) + 1, TIMEOUT_NS) is None
    control = heard(heard(control, 0.2), 0.4)
    assert control.fixed_since_ns == ns(0.2)
    assert heard(heard(control, 0.6, FixStatus.FLOAT), 0.8).fixed_since_ns == ns(0.8)


def test_fixed_again_is_eased_and_only_the_position():
    control = heard(heard(NEW, 0.0), 1.0, FixStatus.FLOAT)
    assert not any(t.ease for t in control.tracks)
    first, *others = (t.ease for t in heard(control, 2.0).tracks)
    assert (first, any(others)) == (EASE_STEPS, False)


@pytest.mark.parametrize(
    ("source", "size", "text"),
    [
        (Source.RTK_POSITION, 1.5, "position moved by 1.50 m"),
        (Source.RTK_VELOCITY, 1.5, "velocity changed by 1.50 m/s"),
        (Source.RTK_HEADING, math.radians(-20.0), "heading turned by -20.0 deg"),
        (Source.GPS_POSITION, 1.5, "GPS error changed by 1.50 m"),
        (Source.GPS_VELOCITY, 1.5, "velocity changed by 1.50 m/s"),
        (Source.BAROMETER, 1.5, "offset of baro/pressure changed by 1.50 m"),
    ],
)
def test_resets_are_counted_and_told(source, size, text):
    control = NEW.with_reset(source, ns(0), size)
    assert sum(control.resets) == 1
    assert str(control.last_reset) == text
    assert control.track(source) == AidTrack(ns(0))


@pytest.mark.parametrize(("last_s", "hopeless"), [(10.0, True), (10.001, False)])
def test_three_resets_within_ten_seconds_are_hopeless(last_s, hopeless):
    control = NEW
    for t_s, source in (
        (0.0, Source.RTK_POSITION),
        (4.0, Source.RTK_VELOCITY),
        (5.0, Source.RTK_HEADING),  # neither moves position or velocity
        (5.0, Source.GPS_POSITION),
    ):
        control = control.with_reset(source, ns(t_s), 1.0)
        assert control.hopeless(2.0) == ""
    control = control.with_reset(Source.RTK_POSITION, ns(last_s), 1.0)
    control = control.with_reset(Source.BAROMETER, ns(last_s), 40.0)  # not the one to name
    why = "reset repeatedly: position moved by 1.00 m"
    assert control.hopeless(2.0) == (why if hopeless else "")


def denied(sources, times_s):
    """Refusals that do not even agree with each other."""
    control = NEW
    for source in sources:
        track = AidTrack()
        for k, t_s in enumerate(times_s):
            track = track.refused(ns(t_s), (3.0 * k,), 0.1)
        control = control.with_track(source, track)
    return control


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
    control = denied(sources, times_s)
    why = "rtk/fix and rtk/vel both contradict it"
    assert control.hopeless(2.0) == (why if hopeless else "")
    track = control.track(sources[-1]).used(ns(2.1), TIMEOUT_NS)  # a use ends it
    assert (track.denied, track.run) == (0, None)
    assert control.with_track(sources[-1], track).hopeless(2.0) == ""
