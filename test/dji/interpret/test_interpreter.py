"""The interpreter as a whole: any readings, and a flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aircraft_readings import KIT, epoch, gimbal, gps, imu, rtk, taken, wxyz
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    GeodeticPlace,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    RtkReading,
)
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import Messages, sensed

MESSAGES = Messages(Cdr().types)

numbers = st.floats()  # NaN and infinities, subnormal and huge
vectors = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(numbers, numbers, numbers, numbers) | st.just((1.0, 0.0, 0.0, 0.0))
stamps = st.integers(0, 2**31 * 10**9 - 1) | st.integers(10**18, 10**18 + 10**9)
small = st.none() | st.integers(-(2**31), 2**31)
places = st.none() | st.builds(GeodeticPlace, numbers, numbers, numbers)
readings = st.one_of(
    st.builds(
        ImuReading,
        stamps,
        st.sampled_from(ImuOrigin),
        vectors,
        st.sampled_from(AccelerationUnit),
        vectors,
        st.none() | quaternions,
    ),
    st.builds(AttitudeReading, stamps, quaternions),
    st.builds(
        GpsReading,
        stamps,
        places,
        st.none() | vectors,
        small,
        *[st.none() | numbers] * 3,
    ),
    st.builds(RtkReading, stamps, places, small, st.none() | vectors, small, small),
    st.builds(GimbalReading, stamps, numbers, numbers, numbers),
)


def values(sample):
    """Every number of a sample."""
    fields = [getattr(sample, name) for name in sample.__dataclass_fields__]
    for value in fields:
        if isinstance(value, float):
            yield value
        elif isinstance(value, np.ndarray):
            yield from value.ravel().tolist()


@settings(max_examples=200, deadline=None)
@given(st.lists(readings, max_size=30), st.sampled_from(["north", "body"]))
def test_any_readings_give_finite_samples_that_can_be_sent(given_readings, reference):
    meant = Interpreter(DjiConfig(gimbal_reference=reference, acceleration_unit="g"))
    samples = [*taken(meant, given_readings), *meant.flush()]
    for sample in samples:
        assert all(map(math.isfinite, values(sample)))
        topic, message = sensed(MESSAGES, sample)
        assert message is not None, topic
    assert all(isinstance(text, str) for text in meant.diagnostics.values())
    assert all(number > 0 for number in meant.counts.values())
    assert all(meant.warnings)


def flight(seconds):
    """The broadcast of a turning aircraft, all parts in every frame, at 50 Hz."""
    for k in range(round(50 * seconds)):
        t = 20 * k
        heading = 0.01 * k
        yaw_deg = round(math.degrees(0.1 * (k // 10))) + 90
        yield imu(t, unit=AccelerationUnit.UNKNOWN, q_nb=wxyz(0.05, -0.1, heading))
        yield gps(t, place=GeodeticPlace(0.9, 0.07 + 1e-7 * (k // 10), 20.0), fix=3)
        yield rtk(t, **epoch(k // 10, yaw_deg=yaw_deg))
        yield gimbal(t + 7, yaw=heading + 0.0035 + 0.5)


def test_a_flight():
    meant = Interpreter(DjiConfig(geoid_undulation_m=40.0, aircraft=KIT))
    samples = [*taken(meant, flight(20.0)), *meant.flush()]
    found: dict[str, int] = {}
    for sample in samples:
        topic, _ = sensed(MESSAGES, sample)
        found[topic] = found.get(topic, 0) + 1
    assert found == {
        "imu/data": 1000,
        "gps/fix": 100,
        "rtk/fix": 100,
        "rtk/vel": 100,
        "rtk/heading": 100,
        "gimbal/attitude": 1000,
        "gimbal/joint_states": 999,  # none is after the last attitude
    }
    assert meant.warnings == []
    assert meant.counts == {"gimbal_without_joints": 1, "gps_repeated": 900, "rtk_repeated": 900}
    said = meant.diagnostics
    assert said["imu_source"] == "broadcast"
    assert said["acceleration_unit"] == "g (by its size, 1.000)"
    assert said["rtk_flag"] == said["rtk_yaw_flag"] == "50 narrow-lane integer"
    assert said["geoid_undulation_m"] == "40"
    # 0.5 rad, and what the attitude's arc differs from yaw's between two readings.
    assert float(said["psi_coder_deg"]) == pytest.approx(math.degrees(0.5), abs=0.01)
