"""Samples without a stamp get that of their arrival; all others are left alone."""

from __future__ import annotations

import dataclasses

import message_samples as given
import pytest

from tirgeo_ros.core.streams.arrivals import Arrivals

SAMPLES = [
    given.IMU,
    given.POSITION,
    given.VELOCITY,
    given.HEADING,
    given.JOINTS,
    given.CAMERA_ATTITUDE,
]


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: type(sample).__name__)
def test_what_has_no_stamp_gets_that_of_its_arrival(sample):
    arrivals = Arrivals()
    assert arrivals.stamped("some/topic", sample, 5_000) is sample
    assert arrivals.counts == {}
    without = dataclasses.replace(sample, stamp_ns=0)
    stamped = arrivals.stamped("some/topic", without, 5_000)
    assert stamped.stamp_ns == 5_000
    for item in dataclasses.fields(sample):
        if item.name != "stamp_ns":
            assert getattr(stamped, item.name) is getattr(sample, item.name)
    assert arrivals.diagnostics == {"stamped_at_arrival.some/topic": "1"}
