"""Readings pinned at the end of the IMU's range, and what only looks like them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flights import filtered, flight

from tirgeo_ros.core.navigation.imu_clipping import Clipping
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages.imu_block import imu_block

START_NS = 1_700_000_000_000_000_000
RATE_HZ = 200
SECOND_NS = 1_000_000_000


def shaken(seed=1, duration_s=10.0, sigma_m_s2=20.0, sigma_rad_s=0.5):
    """(n, 6) force and rate, FRD, of white vibration in z and about x."""
    rng = np.random.default_rng(seed)
    values = 0.05 * rng.standard_normal((round(duration_s * RATE_HZ), 6))
    values[:, 2] += sigma_m_s2 * rng.standard_normal(len(values)) - 9.8
    values[:, 3] += sigma_rad_s * rng.standard_normal(len(values))
    return values


def samples(values, rate_hz=RATE_HZ):
    return [
        ImuSample(START_NS + round(k * SECOND_NS / rate_hz), row[:3], row[3:])
        for k, row in enumerate(values)
    ]


def followed(values, rate_hz=RATE_HZ):
    clipping = Clipping()
    for sample in samples(values, rate_hz):
        clipping.add(sample)
    return clipping


def stepped(values, step_m_s2):
    """Quantised; a gyroscope of 2000 deg/s has a quarter of the step of 16 g, in SI units."""
    steps = np.repeat([step_m_s2, step_m_s2 / 4.5], 3)
    return np.round(values / steps) * steps


@pytest.mark.parametrize("range_m_s2", [39.2266, 78.4532, 37.0])
def test_an_accelerometer_at_its_end_is_counted(range_m_s2):
    values = shaken(sigma_m_s2=0.6 * range_m_s2)
    clipped = values.copy()
    clipped[:, 2] = np.clip(values[:, 2], -range_m_s2, range_m_s2)
    clipping = followed(clipped)
    # Those of the first second may be missed: the end is not known yet.
    true = int((np.abs(values[:, 2]) > range_m_s2).sum())
    assert list(clipping.counts) == ["accelerometer z"]
    assert 0.8 * true < clipping.counts["accelerometer z"] <= true
    now_ns = START_NS + 10 * SECOND_NS
    assert clipping.active(now_ns)
    assert START_NS <= clipping.since_ns < START_NS + 2 * SECOND_NS
    (warning,) = clipping.warnings(now_ns)
    assert warning.startswith(f"imu/data: accelerometer z clipped at {range_m_s2:.3g} m/s2 (")
    assert warning.endswith(" samples in 1 s): vibration beyond its range")


def test_it_ends():
    values = np.clip(shaken(sigma_m_s2=30.0), -39.2, 39.2)
    clipping = followed(values)
    end_ns = clipping.newest_ns
    assert clipping.active(end_ns + SECOND_NS)
    assert not clipping.active(end_ns + SECOND_NS + 1)
    assert clipping.warnings(end_ns + 2 * SECOND_NS)
    assert clipping.warnings(end_ns + 6 * SECOND_NS) == ()
    assert clipping.counts["accelerometer z"] > 0
    first_ns = clipping.since_ns
    for sample in samples(values):  # again, 60 s later
        clipping.add(replace(sample, stamp_ns=sample.stamp_ns + 60 * SECOND_NS))
    assert clipping.since_ns >= first_ns + 59 * SECOND_NS


@pytest.mark.slow
@pytest.mark.parametrize("step_m_s2", [0.0, 0.0048, 0.02, 0.08])
@pytest.mark.parametrize("seed", range(4))
def test_strong_vibration_within_the_range_is_none(seed, step_m_s2):
    """White, and a line that wanders; readings of 10 to 16 bits."""
    values = shaken(seed, 60.0)
    rng = np.random.default_rng(seed)
    phase = np.cumsum(rng.uniform(20, 90) + rng.standard_normal(len(values))) / RATE_HZ
    values[:, 1] += 25.0 * np.sin(2 * np.pi * phase)
    values[:, 4] += 4.0 * np.sin(2 * np.pi * phase)
    if step_m_s2:
        values = stepped(values, step_m_s2)
    assert followed(values).counts == {}


def test_long_turns_rest_and_repeated_readings_are_none():
    values = shaken(2, 60.0, 0.1, 0.01)
    values[:, 2] -= 12.0 * np.hanning(len(values))  # 2.2 g
    values[:, 5] += 3.0 * np.hanning(len(values))
    frozen = shaken(3)
    frozen[1000:] = frozen[1000]
    frozen[1000:, 2] = -60.0
    slow = np.repeat(shaken(4), 6, axis=0)
    half_slow = slow.copy()
    half_slow[:, 3:] = np.random.default_rng(1).standard_normal((len(slow), 3))
    rest = np.tile([0.0, 0.0, -9.8, 0, 0, 0], (2000, 1))
    for still in (values, stepped(values, 0.3), rest, frozen):
        assert followed(still).counts == {}
    for repeated in (slow, half_slow):
        assert followed(repeated, 6 * RATE_HZ).counts == {}


def test_navigation_counts_and_warns():
    rng = np.random.default_rng(1)

    def shaken_too(sample, _):
        if not isinstance(sample, ImuSample):
            return sample
        force_b = sample.specific_force_b + np.array([0, 0, 25.0 * rng.standard_normal()])
        return replace(sample, specific_force_b=np.clip(force_b, -39.2, 39.2))

    status = filtered(flight(duration_s=8.0), shaken_too).status
    assert status.clipped["accelerometer z"] > 50
    assert "accelerometer z clipped at 39.2 m/s2" in status.warnings[0]
    assert status.counts["imu", "used"] > 0  # the samples are used all the same


def test_no_recorded_flight_clips(sample, shared):
    bags = [sample / "flight.mcap", *sorted((shared / "real_flights").glob("*.mcap"))]
    assert len(bags) > 1
    for bag in bags:
        block = imu_block([m.data for m in BagReader(bag).messages(["/imu/data"])])
        frd = block.values[:, [3, 4, 5, 0, 1, 2]] * [1, -1, -1, 1, -1, -1]
        assert followed(frd, 120).counts == {}, bag
