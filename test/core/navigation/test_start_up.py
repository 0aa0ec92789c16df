"""The start of the filter: what it decides depends on stamps, never on arrival."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, flight, navigation_samples

from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.navigation.start_up import StampOrder
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

S = 10**9


def position(stamp_ns):
    return PositionSample(
        stamp_ns, Source.RTK_POSITION, FixStatus.FIXED, 0.5, 0.1, 20.0, 1e-4 * np.eye(3)
    )


def imu(stamp_ns):
    return ImuSample(stamp_ns, np.array([0.0, 0.0, -9.8]), np.zeros(3))


def held_up(rng, samples, longest_s):
    """In the order of arrival over links that halt now and then; none overtakes its own kind."""
    free_ns, arrival = {}, []
    for sample in samples:
        link = getattr(sample, "source", type(sample))
        if rng.random() < 0.02:
            until_ns = sample.stamp_ns + int(rng.uniform(0, longest_s) * S)
            free_ns[link] = max(free_ns.get(link, 0), until_ns)
        arrival.append(max(sample.stamp_ns, free_ns.get(link, 0)))
    return [samples[i] for i in np.argsort(arrival, kind="stable")]


def started(flown, samples, method):
    """The first solution, and the belief once all samples are there."""
    navigation = Navigation(config_for(flown, method=method))
    solutions = [navigation.process(sample).solution for sample in samples]
    first = next(solution for solution in solutions if solution is not None)
    return first, navigation._ekf.belief()


@pytest.mark.parametrize("method", ["ekf", "ekf_heading"])
def test_the_start_does_not_depend_on_arrival(method):
    flown = flight(duration_s=6.0)
    samples = navigation_samples(flown)
    last_ns = samples[-1].stamp_ns - S  # of measurements: later ones may not have come
    samples = [s for s in samples if isinstance(s, ImuSample) or s.stamp_ns < last_ns]
    first, belief = started(flown, samples, method)
    for seed in range(5):
        disturbed = held_up(np.random.default_rng(seed), samples, 0.45)  # max_delay_s is 0.5
        assert disturbed != samples
        other, other_belief = started(flown, disturbed, method)
        assert abs(other.stamp_ns - first.stamp_ns) <= 0.5 * S  # when the IMU is heard again
        np.testing.assert_allclose(other_belief.state.q_nb, belief.state.q_nb, atol=1e-12)
        np.testing.assert_allclose(
            other_belief.covariance, belief.covariance, rtol=1e-6, atol=1e-15
        )


def test_samples_come_out_by_stamp_once_the_imu_is_far_enough():
    order = StampOrder(0.5, 0.7, 7.5)
    assert order.add(position(3 * S)) == []
    assert order.add(position(2 * S)) == []
    assert order.add(imu(int(2.4 * S))) == []
    found = order.add(imu(int(2.6 * S)))
    assert [sample.stamp_ns for sample in found] == [2 * S]
    assert [s.stamp_ns for s in order.add(position(1 * S))] == [1 * S]  # late, and not lost
    assert [s.stamp_ns for s in order.pop_until()] == [int(2.4 * S), int(2.6 * S), 3 * S]
    assert order.pop_until() == []


def test_a_flood_of_aids_without_an_imu_stays_bounded_and_is_named():
    """Whatever their stamps: of one instant, going back, or far ahead."""
    order, source = StampOrder(0.5, 0.7, 7.5), Source.RTK_POSITION
    for k in range(10_000):
        order.add(position(10**12 - (k % 3) * k * 10**6))
    many = Verdict(source, Outcome.TOO_MANY, "120 newer ones wait for imu/data")  # 100 a second
    assert list(map(str, order.given_up())) == [str(many)] * (10_000 - 120)
    order.add(imu(10**11))
    assert {(v.source, v.outcome) for v in order.given_up()} == {
        (Source.RTK_POSITION, Outcome.TOO_NEW)
    }
    assert len(order.pop_until()) == 1  # all of them were ahead of its clock
    assert order.given_up() == []


def test_a_flood_beside_an_imu_stays_bounded_and_takes_nothing_from_the_others():
    """A receiver at 10 kHz ahead of an IMU that stands still, and an IMU at 1 MHz."""
    order = StampOrder(0.5, 0.7, 7.5)
    velocity = VelocitySample(S, Source.RTK_VELOCITY, np.zeros(3), np.eye(3))
    order.add(imu(S))
    order.add(velocity)
    for k in range(10_000):
        order.add(replace(position(S), stamp_ns=S + k * 10_000))
        order.add(imu(S + k * 1_000))
    told = Counter(verdict.source for verdict in order.given_up())
    held = order.pop_until()
    assert velocity in held
    assert told[Source.RTK_POSITION] == 10_000 - 120
    assert told[Source.IMU] == 10_001 - 1200
    assert len(held) == 120 + 1200 + 1


@pytest.mark.parametrize("flown_s", [0.0, 5.0])
def test_receivers_that_run_on_while_the_imu_stands_still_are_counted(flown_s):
    """Before the alignment and after it: as where the IMU's driver has halted."""
    flown = flight(duration_s=6.0)
    navigation = Navigation(config_for(flown, method="ekf"))
    samples = navigation_samples(flown)
    until_ns = samples[0].stamp_ns + max(round(flown_s * S), S // 10)
    for sample in samples:
        if sample.stamp_ns < until_ns:
            navigation.process(sample)
    for k in range(2000):  # at 10 kHz, each another
        fix = replace(position(until_ns + k * 100_000), height_m=20 + 1e-3 * k)
        navigation.process(fix)
    assert (navigation._ekf is not None) is (flown_s > 0)
    assert navigation.status().counts["rtk_position", "too_many"] > 1500
