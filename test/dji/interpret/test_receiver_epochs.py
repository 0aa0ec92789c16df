"""RTK that is polled faster than it measures: each measurement once, each lost fix at once."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from aircraft_readings import epoch, of, place, rtk, t_ms, taken
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.readings import GeodeticPlace


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=43.25, **config))


def positions(samples):
    return of(PositionSample, samples)


def polled(seconds, poll_hz, receiver_hz=5.0):
    """The same epoch again and again under new stamps."""
    for k in range(round(seconds * poll_hz)):
        t = k / poll_hz
        yield rtk(1e3 * t, **epoch(math.floor(t * receiver_hz + 1e-6)))


@pytest.mark.parametrize("poll_hz", [5.0, 10.0, 50.0, 100.0])
def test_what_is_polled_goes_out_once_an_epoch(poll_hz):
    meant = interpreter()
    samples = taken(meant, polled(10.0, poll_hz))
    for kind in (PositionSample, VelocitySample, HeadingSample):
        found = of(kind, samples)
        assert [t_ms(s) for s in found] == pytest.approx([200.0 * k for k in range(50)])
    assert meant.counts.get("rtk_repeated", 0) == 10 * poll_hz - 50


def test_broadcast_and_subscription_of_one_epoch_are_one():
    """They differ in the last digits, and the slower one still says the epoch before."""
    meant = interpreter()
    readings = []
    for k in range(50):
        parts = epoch(k)
        north, east, down = parts["velocity_n"]
        other = parts | {"velocity_n": (math.nextafter(north, 9), east, down)}
        readings.append((200 * k + 1, parts))
        readings += [
            (200 * k + 20 * j, other if j > 1 else epoch(max(k - 1, 0))) for j in range(10)
        ]
    readings.sort(key=lambda entry: entry[0])
    samples = taken(meant, [rtk(t, **parts) for t, parts in readings])
    for kind in (PositionSample, VelocitySample, HeadingSample):
        assert [t_ms(s) for s in of(kind, samples)][1:] == [200 * k + 1 for k in range(1, 50)]
    # The epoch before, at 20 ms; at 0 ms it is a repetition.
    assert meant.counts["rtk_late"] == 49


# A fix that is lost


@pytest.mark.parametrize("flag", [34, 16, 0])
def test_a_worse_fix_of_the_same_place_goes_out(flag):
    meant = interpreter()
    taken(meant, [rtk(20 * k, **epoch(0)) for k in range(5)])
    samples = taken(meant, [rtk(100 + 20 * k, **epoch(0, position_flag=flag)) for k in range(5)])
    (position,) = samples
    assert t_ms(position) == 100
    assert position.status < FixStatus.FIXED
    assert (position.latitude_rad, position.longitude_rad) == place(0)[:2]
    assert meant.counts["rtk_status_fell"] == 1
    # What the aircraft has flown in 100 ms since is in the covariance.
    (alone,) = positions(interpreter().take(rtk(0, **epoch(0, position_flag=flag))))
    moved_m2 = 0.01 * (3.0**2 + 1.0**2 + 0.2**2)
    np.testing.assert_allclose(
        position.covariance_n, alone.covariance_n + moved_m2 * np.eye(3), atol=1e-9
    )


def test_a_fix_that_is_lost_with_its_place_is_told():
    """Without a solution a receiver says 0, 0."""
    meant = interpreter()
    meant.take(rtk(0, **epoch(0)))
    lost = {"place": GeodeticPlace(0.0, 0.0, 0.0), "position_flag": 0, "yaw_flag": 0}
    (position,) = positions(meant.take(rtk(200, **epoch(1) | lost)))
    assert position.status is FixStatus.NONE
    assert position.covariance_n[0, 0] >= 1e10
    assert positions(meant.take(rtk(400, **epoch(2) | lost))) == []
    assert meant.counts["rtk_position_refused"] == 2


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 4)), max_size=40), st.randoms())
def test_stamps_of_each_stream_ascend(steps, random):
    """Readings of two roads, out of order by less than 20 ms."""
    meant = interpreter()
    samples, t = [], 0
    for step, number in steps:
        t += step
        parts = epoch(number, position_flag=random.choice([0, 34, 50]))
        samples += meant.take(rtk(t - random.randrange(20), **parts))
    for kind in (PositionSample, VelocitySample, HeadingSample):
        stamps = [s.stamp_ns for s in of(kind, samples)]
        assert all(a < b for a, b in itertools.pairwise(stamps))
