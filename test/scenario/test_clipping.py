"""No fault of the table looks like an IMU at the end of its range."""

from __future__ import annotations

import pytest
from scenario.runs import calm, faulty, hovering, sheared
from scenario.table import TABLE

from tirgeo_ros.core.navigation.imu_clipping import Clipping
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import ImuSample


@pytest.mark.slow
def test_no_fault_is_taken_for_clipping():
    flights = {"lawnmower": calm(), "hover": hovering(), "shear": sheared()}
    for row in TABLE:
        flown = flights[row.flight]
        clipping = Clipping()
        for delivery in faulty(flown, row.fault, row.start_s, row.end_s):
            if isinstance(delivery.sample, ImuSample) and not fault_of(delivery.sample):
                clipping.add(delivery.sample)
        assert clipping.counts == {}, row.name
