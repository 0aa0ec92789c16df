"""Values of RTK and the flags that come on their own."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.sources.readings import GeodeticPlace, RtkReading
from tirgeo_ros.dji.sources.rtk_flag_pairing import HOLD_NS, EpochFlags

MS = 1_000_000
EPOCH_NS = 200 * MS
FIXED, FLOAT, NONE = 50, 34, 0


def position(number: int) -> RtkReading:
    return RtkReading(number, place=GeodeticPlace(0.9, 0.1, float(number)))


@pytest.mark.parametrize("order", ["pfpf", "fpfp", "ppff", "ffpp", "pffp", "fppf"])
def test_two_epochs_in_a_burst(order):
    """After a hiccup of the machine all of them come at once."""
    flags = EpochFlags("position_flag")
    numbers, sent = iter([0, 1]), iter([FIXED, FLOAT])
    came = []
    for at, letter in enumerate(order):
        if letter == "p":
            came += flags.value("p", position(next(numbers)), at)
        else:
            came += flags.flag(next(sent), at)
    assert [(r.place.height_msl_m, r.position_flag) for r in came] == [(0, FIXED), (1, FLOAT)]


def test_a_lost_flag_holds_up_for_a_short_time_and_is_counted():
    flags = EpochFlags("position_flag")
    flags.value("p", position(0), 0)
    assert flags.due(HOLD_NS - 1) == []
    assert flags.due(HOLD_NS) == [position(0)]
    assert flags.alone == {"p": 1}
    assert flags.flag(FLOAT, EPOCH_NS) == []


def test_a_late_flag_is_not_the_next_positions():
    """It comes to whoever judges, on its own."""
    flags = EpochFlags("position_flag")
    flags.flag(FLOAT, 0)
    assert flags.value("p", position(1), HOLD_NS) == [RtkReading(0, position_flag=FLOAT)]
    assert flags.flag(FIXED, HOLD_NS + 1) == [position(1)._replace(position_flag=FIXED)]


def test_a_clock_that_goes_back_lets_go_of_all():
    flags = EpochFlags("yaw_flag")
    flags.value("p", RtkReading(5, yaw_deg=-90), 10 * EPOCH_NS)
    assert flags.due(9 * EPOCH_NS) == [RtkReading(5, yaw_deg=-90)]


@given(
    st.lists(
        st.tuples(
            st.sampled_from([FIXED, FLOAT, NONE]),
            st.integers(0, HOLD_NS - 1),  # of the position after the epoch
            st.integers(0, HOLD_NS - 1),  # of the flag
            st.booleans(),  # the flag is lost
            st.booleans(),  # the position is lost
        ),
        max_size=20,
    )
)
def test_no_position_has_the_flag_of_another_epoch(epochs):
    """Whatever comes first, and whatever is lost."""
    events = []
    for number, (flag, p_ns, f_ns, flag_lost, position_lost) in enumerate(epochs):
        if not position_lost:
            events.append((number * EPOCH_NS + p_ns, 0, number))
        if not flag_lost:
            events.append((number * EPOCH_NS + f_ns, 1, flag))
    flags, came = EpochFlags("position_flag"), []
    for at, is_flag, what in sorted(events):
        came += flags.flag(what, at) if is_flag else flags.value("p", position(what), at)
    came += flags.due(len(epochs) * EPOCH_NS)
    positions = {r.place.height_msl_m: r.position_flag for r in came if r.place is not None}
    expected = {
        number: None if flag_lost else flag
        for number, (flag, _, _, flag_lost, position_lost) in enumerate(epochs)
        if not position_lost
    }
    assert positions == expected
    # What is lost of a pair leaves the other alone; nothing else is lost.
    alone = [r.position_flag for r in came if r.place is None]
    assert alone == [e[0] for e in epochs if e[4] and not e[3]]
