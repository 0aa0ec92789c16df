"""Every row of the table, on a flight through the estimator's one door."""

from __future__ import annotations

import pytest
from scenario.complaints import complaints
from scenario.runs import FLIGHTS, faulty, run
from scenario.table import TABLE, Row

from tirgeo_ros.core.navigation.timeline.imu_clipping import Clipping
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import ImuSample

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_row(row: Row):
    flown = FLIGHTS[row.flight]()
    done = run(flown, faulty(flown, row.fault, row.start_s, row.end_s))
    assert complaints(row, done) == []


def test_no_fault_is_taken_for_clipping():
    for row in TABLE:
        flown = FLIGHTS[row.flight]()
        clipping = Clipping()
        for delivery in faulty(flown, row.fault, row.start_s, row.end_s):
            if isinstance(delivery.sample, ImuSample) and not fault_of(delivery.sample):
                clipping.add(delivery.sample)
        assert clipping.counts == {}, row.name
