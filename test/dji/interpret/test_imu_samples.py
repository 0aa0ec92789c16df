"""IMU readings to samples: attitude, streams, order, what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from aircraft_readings import KIT, MS, START, attitude, imu, t_ms, taken, wxyz
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_from_rotvec, quat_multiply
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.readings import ImuOrigin

NAN, INF = math.nan, math.inf
HARD, SENT, CAST = ImuOrigin.HARD_SYNC, ImuOrigin.SUBSCRIPTION, ImuOrigin.BROADCAST


def interpreter(**config):
    return Interpreter(DjiConfig(geoid_undulation_m=40.0, aircraft=KIT, **config))


def test_a_reading_becomes_a_sample_in_si():
    meant = interpreter()
    (sample,) = meant.take(
        imu(5, (0.1, -0.2, -0.9), q_nb=wxyz(0.1, -0.2, 2.0), rate=(0.01, -0.02, 0.03))
    )
    assert sample.stamp_ns == START + 5 * MS
    np.testing.assert_allclose(
        sample.specific_force_b, [0.1 * 9.80665, -0.2 * 9.80665, -0.9 * 9.80665], rtol=1e-15
    )
    np.testing.assert_array_equal(sample.angular_rate_b, [0.01, -0.02, 0.03])
    np.testing.assert_allclose(sample.autopilot_q_nb, quat_from_euler(0.1, -0.2, 2.0), atol=1e-15)
    assert meant.counts == {}
    assert meant.warnings == []
    assert meant.diagnostics["imu_source"] == "broadcast"
    assert meant.diagnostics["acceleration_unit"] == "g (told)"


# Attitude


@pytest.mark.parametrize(
    "q_nb",
    [
        (0.0, 0.0, 0.0, 0.0),
        (NAN, NAN, NAN, NAN),
        (1.0, 0.0, NAN, 0.0),
        (INF, 0.0, 0.0, 0.0),
        (1.02, 0.0, 0.0, 0.0),
        (0.7, 0.0, 0.0, 0.7),
        (1e200, 1e200, 0.0, 0.0),
    ],
)
def test_what_is_no_attitude_is_left_out(q_nb):
    meant = interpreter()
    (sample,) = meant.take(imu(0, q_nb=q_nb))
    assert sample.autopilot_q_nb is None
    assert meant.counts == {"attitude_not_unit": 1, "imu_without_attitude": 1}


def test_attitude_of_another_message_is_carried_on_by_the_rate():
    """So that one that is 20 ms old is not 20 ms of turning off."""
    meant = interpreter()
    rate = (0.3, -0.2, 2.0)
    q0 = quat_from_euler(0.05, -0.1, 1.0)
    meant.take(attitude(100, tuple(q0.tolist())))
    for after_ms in (0, 20, 50):
        (sample,) = meant.take(imu(100 + after_ms, q_nb=None, rate=rate))
        expected = quat_multiply(q0, quat_from_rotvec(np.array(rate) * after_ms * 1e-3))
        # Both are exact for a constant rate.
        np.testing.assert_allclose(sample.autopilot_q_nb, expected, atol=1e-15)
    assert meant.counts == {"imu_attitude_carried": 3}


# What is refused


@pytest.mark.parametrize("bad", [NAN, INF, -INF, 1e300])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("of_rate", [False, True])
def test_what_is_no_number_is_refused(bad, axis, of_rate):
    meant = interpreter()
    vector = [0.0, 0.0, -1.0]
    vector[axis] = bad
    parts = {"rate": tuple(vector)} if of_rate else {"acceleration": tuple(vector)}
    assert meant.take(imu(0, **parts)) == []
    assert meant.counts == {"imu_refused": 1}
    assert len(meant.take(imu(10))) == 1


# Order


# Two streams


def both(until_ms, hard_until_ms=1e9, hard_from_ms=0.0):
    """HARD_SYNC at 400 Hz and the broadcast at 100 Hz, whose stamps are 1 ms off."""
    readings = [
        imu(t, origin=HARD)
        for t in np.arange(0, until_ms, 2.5)
        if hard_from_ms <= t < hard_until_ms
    ]
    readings += [imu(t + 1, origin=CAST) for t in range(0, until_ms, 10)]
    return sorted(readings, key=lambda reading: reading.stamp_ns)


def test_the_worse_takes_over_when_the_better_is_silent():
    meant = interpreter()
    samples = taken(meant, both(1000, hard_until_ms=500))
    stamps = [t_ms(s) for s in samples]
    # The last of HARD_SYNC is at 497.5; the broadcast's 601 is the first over 100 ms later.
    assert stamps == [2.5 * k for k in range(200)] + [601 + 10 * k for k in range(40)]
    assert meant.diagnostics["imu_source"] == "broadcast"
    assert meant.counts["imu_handovers"] == 1
    assert meant.counts["imu_unused_broadcast"] == 60


@given(
    st.lists(
        st.tuples(st.sampled_from([HARD, SENT, CAST]), st.integers(0, 400), st.integers(0, 600)),
        max_size=4,
    ),
    st.integers(0, 9),
)
def test_stamps_of_any_mixture_ascend(bursts, phase):
    """However streams begin and end, nothing goes back and nothing is lost uncounted."""
    readings = [
        imu(t + phase * (origin is CAST), origin=origin)
        for origin, start, length in bursts
        for t in range(start, start + length, 10)
    ]
    readings.sort(key=lambda reading: reading.stamp_ns)
    meant = interpreter()
    samples = taken(meant, readings)
    assert all(a.stamp_ns < b.stamp_ns for a, b in itertools.pairwise(samples))
    lost = sum(
        number
        for name, number in meant.counts.items()
        if name.startswith("imu_unused") or name == "imu_out_of_order"
    )
    assert len(samples) + lost == len(readings)


# Speed


def test_the_better_takes_over_once_it_is_steady():
    meant = interpreter()
    samples = taken(meant, both(1000, hard_from_ms=500))
    stamps = [t_ms(s) for s in samples]
    assert stamps == sorted(set(stamps))
    # 100 ms of HARD_SYNC are looked at, then it drives; the broadcast fills the time before.
    assert stamps == [1 + 10 * k for k in range(60)] + [600 + 2.5 * k for k in range(160)]
    assert meant.counts["imu_handovers"] == 1
