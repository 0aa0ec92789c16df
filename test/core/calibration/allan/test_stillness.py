"""Movement, drift and vibration in a record that ought to be one of rest."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise import record, walk, white

from tirgeo_ros.core.calibration.allan import stillness
from tirgeo_ros.core.calibration.allan.stillness import Interval, Seconds, drifts, movements

RATE_HZ = 100
STEP_S = 1 / RATE_HZ
SIZE = 120_000  # 20 min
NOISE = np.repeat([1.7e-4, 1.3e-2], 3)


def rest(seed, size=SIZE):
    rng = np.random.default_rng(seed)
    values = white(rng, (size, 6), NOISE, 1 / RATE_HZ)
    values[:, 5] += 9.8
    return values


def seconds_of(values):
    return stillness.seconds_of(record(values, STEP_S))


@pytest.mark.parametrize("seed", range(3))
def test_rest_is_rest(seed):
    seconds = seconds_of(rest(seed))
    assert len(seconds.starts_s) == 1200
    assert movements(seconds) == []
    assert not np.any(drifts(seconds)[1:])


def test_a_turn_a_tilt_and_a_knock_are_named():
    values = rest(2)
    values[30_000:30_250, 2] += 0.05  # turned by 7 deg within 2.5 s
    values[60_000:, 3] += 9.8 * np.sin(np.radians(2))  # laid down askew
    values[90_050, 4] += 20.0  # a knock of one sample
    found = movements(seconds_of(values))
    assert found == [Interval(299, 304), Interval(599, 601), Interval(899, 902)]


def test_a_flight_has_moved_all_along():
    values = rest(4, 12_000)
    values[:, 0] += 0.05 * np.sin(np.arange(12_000) / RATE_HZ)
    assert movements(seconds_of(values)) == [Interval(0, 120)]
    values = rest(4, 12_000)
    values[:, :3] *= 30  # 0.3 deg/sqrt(s): the noisiest gyroscope on sale lies still
    assert movements(seconds_of(values)) == []


def test_a_slow_drift_is_told_with_its_slope():
    values = rest(3)
    slope = 2e-5 / 60  # rad/s a second
    values[:, 1] += slope * np.arange(SIZE) / RATE_HZ
    changes, steady, settles = drifts(seconds_of(values))
    assert steady.tolist() == [False, True, False, False, False, False]
    assert not settles.any()
    # White noise of N lets a slope scatter by N sqrt(12 / T^3): 1.4e-8.
    tolerance = 4 * 1.7e-4 * np.sqrt(12 / 1200**3)
    assert changes[1] / 1199 == pytest.approx(slope, abs=tolerance)


def test_few_random_walks_pass_for_a_drift():
    """A drift explains nine tenths of one random walk in twenty or so."""
    rng = np.random.default_rng(4)
    found = np.zeros(2)
    for _ in range(60):
        means = np.stack([walk(rng, 1200, 1.0, 1.0) for _ in range(6)], axis=1)
        found += np.sum(drifts(Seconds(np.arange(1200.0), means, means))[1:], axis=1)
    assert (found < 0.15 * 360).all()


@pytest.mark.parametrize("time_s", [60.0, 200.0, 600.0])
def test_a_sensor_that_warms_up_is_named_with_its_change(time_s):
    values = rest(8)
    t = np.arange(SIZE) / RATE_HZ
    values[:, 2] -= 2e-3 * (1 - np.exp(-t / time_s))
    changes, steady, settles = drifts(seconds_of(values))
    assert not steady.any()
    assert settles.tolist() == [False, False, True, False, False, False]
    # The time constants that are tried are up to 2^0.125 off: 10 % of the change at most.
    assert changes[2] == pytest.approx(-2e-3 * (1 - np.exp(-1200 / time_s)), rel=0.1)
