"""Parts of RTK epochs, three of them without a header, put together by when they came."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.dji.sources.readings import GeodeticPlace, RtkReading
from tirgeo_ros.dji.sources.rtk_epochs import RtkEpochs

MS = 1_000_000
PERIOD = 200 * MS
PARTS = ("place", "velocity_n", "yaw_deg", "position_flag", "yaw_flag")


def part(name: str, number: int, stamp_ns: int) -> RtkReading:
    """A part that tells of which epoch it is."""
    values = {
        "place": GeodeticPlace(0.9, 0.1, float(number)),
        "velocity_n": (float(number), 0.0, 0.0),
    }
    return RtkReading(stamp_ns, **{name: values.get(name, number)})


def told(events):
    """Readings of (arrival, part)."""
    epochs = RtkEpochs()
    found = []
    for arrival_ns, given_part in events:
        found += epochs.take(given_part, arrival_ns)
    return found + epochs.flush()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.permutations(PARTS), min_size=1, max_size=6),
    st.lists(st.integers(0, 45), min_size=30, max_size=30),
)
def test_any_order_within_an_epoch_and_any_delay_below_half_of_one(orders, delays_ms):
    """The stamp is the position's; every part is with those of its own epoch.

    Yaw and flags have the time of their record for a stamp, and the velocity one of its own.
    """
    events = []
    for number, order in enumerate(orders):
        for place, name in enumerate(order):
            late = sum(delays_ms[5 * number : 5 * number + place]) % 90
            at_ns = number * PERIOD + late * MS
            stamps = {"place": number * PERIOD, "velocity_n": number * PERIOD + 1}
            events.append((at_ns, part(name, number, stamps.get(name, at_ns + 2))))
    events.sort(key=lambda event: event[0])
    found = told(events)
    assert [reading.stamp_ns for _, reading in found] == [k * PERIOD for k in range(len(orders))]
    for number, (_, reading) in enumerate(found):
        assert reading == RtkReading(
            number * PERIOD,
            GeodeticPlace(0.9, 0.1, float(number)),
            number,
            (float(number), 0.0, 0.0),
            number,
            number,
        )


@pytest.mark.parametrize("lost", PARTS)
def test_a_lost_part_costs_itself_alone(lost):
    events = [
        (number * PERIOD + k * MS, part(name, number, number * PERIOD))
        for number in range(3)
        for k, name in enumerate(PARTS)
        if (number, name) != (1, lost)
    ]
    found = [reading for _, reading in told(events)]
    assert len(found) == 3
    for number, reading in enumerate(found):
        absent = {name for name in PARTS if getattr(reading, name) is None}
        assert absent == ({lost} if number == 1 else set())


def test_a_whole_epoch_does_not_wait():
    epochs = RtkEpochs()
    found = [epochs.take(part(name, 1, k), k) for k, name in enumerate(PARTS)]
    assert [len(each) for each in found] == [0, 0, 0, 0, 1]
