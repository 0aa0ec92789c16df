"""Each fault does what it says, in its interval and nowhere else."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scenario import time_faults, value_faults
from scenario.deliveries import GPS, RTK, Deliveries, Interval, deliveries
from scenario.runs import SHEAR_DEG, SHEAR_S, calm, faulty, sheared
from scenario.table import TABLE

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.measurements import FixStatus, Source

POSITION, VELOCITY, HEADING = RTK
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


def test_drop_and_lossy():
    assert not inside(faulty(calm(), time_faults.drop(POSITION), START_S, END_S), POSITION)
    some = inside(faulty(calm(), time_faults.lossy(0.8, POSITION), START_S, END_S), POSITION)
    assert 1 <= len(some) <= 10  # 25 of which a fifth: 5 with a sigma of 2


def test_late_and_shuffled():
    late = inside(faulty(calm(), time_faults.late(0.3, POSITION), START_S, END_S), POSITION)
    assert {d.arrival_ns - d.true_ns for d in late} == {380_000_000}  # 80 ms of the simulator's
    assert all(d.sample.stamp_ns == d.true_ns for d in late)
    mixed = inside(faulty(calm(), time_faults.shuffled(0.4, POSITION), START_S, END_S), POSITION)
    stamps = [d.sample.stamp_ns for d in mixed]
    assert stamps != sorted(stamps)


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


def test_clock_moves_the_stamps_alone():
    for good, bad in pairs(time_faults.clock(-0.5, VELOCITY), VELOCITY):
        assert bad.stamp_ns - good.stamp_ns == -500_000_000
        assert bad.velocity_n is good.velocity_n
    moved_on = inside(faulty(calm(), time_faults.clock(-0.5, VELOCITY), START_S, END_S), VELOCITY)
    assert {d.clock_ns for d in moved_on} == {-500_000_000}
    misstamped = inside(
        faulty(calm(), time_faults.misstamped(2, VELOCITY), START_S, END_S), VELOCITY
    )
    assert {(d.clock_ns, d.sample.stamp_ns - d.true_ns) for d in misstamped} == {(0, 2 * 10**9)}


def test_frozen_is_the_last_value_with_new_stamps():
    found = pairs(value_faults.frozen(Source.IMU), Source.IMU)
    assert len({id(bad.specific_force_b) for _, bad in found}) == 1
    assert all(bad.stamp_ns == good.stamp_ns for good, bad in found)


def test_moved_is_so_many_metres():
    for good, bad in pairs(value_faults.moved(3.0, -4.0, 12.0, POSITION), POSITION):
        plane = TangentPlane(good.latitude_rad, good.longitude_rad, good.height_m)
        off = plane.ned_from_geodetic(bad.latitude_rad, bad.longitude_rad, bad.height_m)
        assert np.allclose(off, [3.0, -4.0, 12.0], atol=1e-3)  # the earth's curvature over 5 m


def test_offsets():
    for good, bad in pairs(value_faults.faster(1, 2, 3, VELOCITY), VELOCITY):
        assert np.allclose(bad.velocity_n - good.velocity_n, [1, 2, 3])
    for good, bad in pairs(value_faults.turned(180), HEADING):
        assert math.isclose(abs(bad.heading_rad - good.heading_rad), math.pi)
    for good, bad in pairs(value_faults.force_off(0.1, 0, -0.2), Source.IMU):
        assert np.allclose(bad.specific_force_b - good.specific_force_b, [0.1, 0, -0.2])
    for good, bad in pairs(value_faults.rate_off(0, 1, 0), Source.IMU):
        assert np.allclose(np.degrees(bad.angular_rate_b - good.angular_rate_b), [0, 1, 0])


@pytest.mark.parametrize("source", [Source.IMU, *RTK, *GPS])
def test_not_a_number(source):
    for fault in (value_faults.not_a_number, value_faults.covariance_not_a_number)[
        : 1 if source is Source.IMU else 2
    ]:
        for _, bad in pairs(fault(source), source):
            assert "nan" in repr(bad)


def test_wandering_begins_at_the_truth_and_is_as_large_as_it_says():
    fault = value_faults.wandering(FixStatus.FLOAT, 0.3, 0.5, 0.01)
    found = pairs(fault, POSITION)
    apart_m = np.array([bad.height_m - good.height_m for good, bad in found])
    assert apart_m[0] == pytest.approx(0.0, abs=1e-9)
    # 25 samples of a correlation time of 2.5 samples are some five that do not depend.
    assert 0.1 < np.std(apart_m) < 0.6
    assert all(bad.status is FixStatus.FLOAT for _, bad in found)
    assert all(bad.covariance_n[0, 0] == pytest.approx(1e-4) for _, bad in found)


def test_the_wind_leans_the_aircraft_by_so_much_in_so_short_a_time():
    at = [calm().truth.t_s.searchsorted(t) for t in SHEAR_S]
    roll_deg = [
        np.degrees(euler_from_quat(flown.truth.q_nb[at])[:, 0]) for flown in (calm(), sheared())
    ]
    change = (roll_deg[1] - roll_deg[0])[1] - (roll_deg[1] - roll_deg[0])[0]
    # To a degree: the calm flight leans some degrees already, and leaning is not linear.
    assert abs(change) == pytest.approx(SHEAR_DEG, abs=1.0)
    assert np.allclose(calm().truth.position_p, sheared().truth.position_p)
