"""Each fault does what it says, in its interval and nowhere else."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scenario import time_faults, value_faults
from scenario.deliveries import GPS, RTK, Deliveries, Interval, deliveries
from scenario.runs import calm, faulty
from scenario.table import TABLE

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.measurements import FixStatus, Source

POSITION, _, HEADING = RTK
START_S, END_S = 20.0, 25.0


def inside(found: Deliveries, source: Source) -> Deliveries:
    first_ns = calm().truth.stamp_ns[0]
    interval = Interval(first_ns + round(START_S * 1e9), first_ns + round(END_S * 1e9))
    return [d for d in found if d.source is source and interval.holds(d)]


def pairs(fault, source):
    """(good, faulty) samples of the interval, one to one."""
    bad = inside(faulty(calm(), fault, START_S, END_S), source)
    good = inside(deliveries(calm()), source)
    return [(a.sample, b.sample) for a, b in zip(good, bad, strict=True)]


def test_a_good_flight_is_five_samples_of_rtk_and_a_hundred_of_the_imu_a_second():
    found = deliveries(calm())
    assert len(inside(found, POSITION)) == len(inside(found, HEADING)) == 25
    assert len(inside(found, Source.IMU)) == 500
    assert len(inside(found, GPS[0])) == 50


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_a_fault_keeps_to_its_interval_and_is_the_same_each_time(row):
    flown = calm()
    start_ns = flown.truth.stamp_ns[0] + round(row.start_s * 1e9)
    end_ns = flown.truth.stamp_ns[0] + round(row.end_s * 1e9)
    once, again = (faulty(flown, row.fault, row.start_s, row.end_s) for _ in range(2))
    good, bad = (
        {id(d.sample) for d in found if not start_ns <= d.true_ns < end_ns}
        for found in (deliveries(flown), once)
    )
    assert good == bad
    assert all(a.arrival_ns <= b.arrival_ns for a, b in pairwise(once))
    assert [(d.arrival_ns, d.true_ns) for d in once] == [(d.arrival_ns, d.true_ns) for d in again]


def test_duplicated_swapped_polled():
    twice = inside(faulty(calm(), time_faults.duplicated(POSITION), START_S, END_S), POSITION)
    assert len(twice) == 50
    swapped = inside(faulty(calm(), time_faults.swapped(Source.IMU), START_S, END_S), Source.IMU)
    steps = np.diff([d.sample.stamp_ns for d in swapped])
    assert set(steps) == {-10_000_000, 30_000_000}
    often = inside(faulty(calm(), time_faults.polled(50.0, POSITION), START_S, END_S), POSITION)
    assert len(often) == 24 * 10 + 1
    assert len({d.sample.latitude_rad for d in often}) == 25
    assert set(np.diff([d.sample.stamp_ns for d in often])) == {20_000_000}


def test_frozen_is_the_last_value_with_new_stamps():
    found = pairs(value_faults.frozen(Source.IMU), Source.IMU)
    assert len({id(bad.specific_force_b) for _, bad in found}) == 1
    assert all(bad.stamp_ns == good.stamp_ns for good, bad in found)


def test_moved_is_so_many_metres():
    for good, bad in pairs(value_faults.moved(3.0, -4.0, 12.0, POSITION), POSITION):
        plane = TangentPlane(good.latitude_rad, good.longitude_rad, good.height_m)
        off = plane.ned_from_geodetic(bad.latitude_rad, bad.longitude_rad, bad.height_m)
        assert np.allclose(off, [3.0, -4.0, 12.0], atol=1e-3)  # the earth's curvature over 5 m


def test_wandering_begins_at_the_truth_and_is_as_large_as_it_says():
    fault = value_faults.wandering(FixStatus.FLOAT, 0.3, 0.5, 0.01)
    found = pairs(fault, POSITION)
    apart_m = np.array([bad.height_m - good.height_m for good, bad in found])
    assert apart_m[0] == pytest.approx(0.0, abs=1e-9)
    # 25 samples of a correlation time of 2.5 samples are some five that do not depend.
    assert 0.1 < np.std(apart_m) < 0.6
    assert all(bad.status is FixStatus.FLOAT for _, bad in found)
    assert all(bad.covariance_n[0, 0] == pytest.approx(1e-4) for _, bad in found)
