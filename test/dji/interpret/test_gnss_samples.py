# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Samples of RTK and ordinary GPS, each measurement once; random readings; a whole flight."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from aircraft_readings import KIT, epoch, gimbal, gps, imu, of, place, rtk, t_ms, taken, wxyz
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.config import AircraftConfig, DjiConfig
from tirgeo_ros.core.config.dji_parameters import DjiDelayConfig
from tirgeo_ros.core.frames.rotations import wrap_pi
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.interpret.interpreter import Interpreter
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
from tirgeo_ros.io.messages import Messages, sensed

UNDULATION_M = 43.25


def interpreter(**config):
    return Interpreter(DjiConfig(**{"geoid_undulation_m": UNDULATION_M, "aircraft": KIT} | config))


def positions(samples):
    return of(PositionSample, samples)


def polled(seconds, poll_hz, receiver_hz=5.0):
    """The same epoch again and again under new stamps."""
    for k in range(round(seconds * poll_hz)):
        t = k / poll_hz
        yield rtk(1e3 * t, **epoch(math.floor(t * receiver_hz + 1e-6)))


@pytest.mark.parametrize("poll_hz", [5.0, 10.0, 50.0, 100.0])
def test_each_polled_epoch_gives_one_sample(poll_hz):
    interp = interpreter()
    samples = taken(interp, polled(10.0, poll_hz))
    for kind in (PositionSample, VelocitySample, HeadingSample):
        result = of(kind, samples)
        assert [t_ms(s) for s in result] == pytest.approx([200.0 * k for k in range(50)])
    assert interp.counts.get("rtk_repeated", 0) == 10 * poll_hz - 50


def test_broadcast_and_subscription_of_one_epoch_are_one():
    """They differ in the last digits, and the slower one still sends the previous epoch."""
    interp = interpreter()
    readings = []
    for k in range(50):
        parts = epoch(k)
        north, east, down = parts["velocity_n"]
        other = parts | {"velocity_n": (math.nextafter(north, 9), east, down)}
        readings.append((200 * k + 1, parts))
        readings += [
            (200 * k + 20 * j, other if j > 1 else epoch(max(k - 1, 0))) for j in range(10)
        ]
    readings.sort(key=lambda entry: entry[0])
    samples = taken(interp, [rtk(t, **parts) for t, parts in readings])
    for kind in (PositionSample, VelocitySample, HeadingSample):
        assert [t_ms(s) for s in of(kind, samples)][1:] == [200 * k + 1 for k in range(1, 50)]
    # The previous epoch comes at 20 ms; at 0 ms it is a repetition.
    assert interp.counts["rtk_late"] == 49


@pytest.mark.parametrize("flag", [34, 16, 0])
def test_a_worse_fix_of_the_same_place_is_published(flag):
    interp = interpreter()
    taken(interp, [rtk(20 * k, **epoch(0)) for k in range(5)])
    samples = taken(interp, [rtk(100 + 20 * k, **epoch(0, position_flag=flag)) for k in range(5)])
    (position,) = samples
    assert t_ms(position) == 100
    assert position.status < FixStatus.FIXED
    assert (position.latitude_rad, position.longitude_rad) == place(0)[:2]
    assert interp.counts["rtk_status_fell"] == 1
    # The covariance contains the distance flown in these 100 ms.
    (alone,) = positions(interpreter().take(rtk(0, **epoch(0, position_flag=flag))))
    moved_m2 = 0.01 * (3.0**2 + 1.0**2 + 0.2**2)
    np.testing.assert_allclose(
        position.covariance_n, alone.covariance_n + moved_m2 * np.eye(3), atol=1e-9
    )


def test_a_fix_that_is_lost_with_its_place_is_published():
    """Without a solution a receiver sends 0, 0."""
    interp = interpreter()
    interp.take(rtk(0, **epoch(0)))
    lost = {"place": GeodeticPlace(0.0, 0.0, 0.0), "position_flag": 0, "yaw_flag": 0}
    (position,) = positions(interp.take(rtk(200, **epoch(1) | lost)))
    assert position.status is FixStatus.NONE
    assert position.covariance_n[0, 0] >= 1e10
    assert positions(interp.take(rtk(400, **epoch(2) | lost))) == []
    assert interp.counts["rtk_position_refused"] == 2


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 4)), max_size=40), st.randoms())
def test_stamps_of_each_stream_ascend(steps, random):
    """Readings of two sources, out of order by less than 20 ms."""
    interp = interpreter()
    samples, t = [], 0
    for step, number in steps:
        t += step
        parts = epoch(number, position_flag=random.choice([0, 34, 50]))
        samples += interp.take(rtk(t - random.randrange(20), **parts))
    for kind in (PositionSample, VelocitySample, HeadingSample):
        stamps = [s.stamp_ns for s in of(kind, samples)]
        assert all(a < b for a, b in itertools.pairwise(stamps))


NAN, INF = math.nan, math.inf


def test_an_epoch_becomes_three_samples():
    interp = interpreter()
    position, velocity, heading = interp.take(rtk(100, **epoch(0)))
    assert (position.source, velocity.source) == (Source.RTK_POSITION, Source.RTK_VELOCITY)
    assert position.status is FixStatus.FIXED
    assert (position.latitude_rad, position.longitude_rad) == place(0)[:2]
    assert position.height_m == 30.0 + UNDULATION_M
    np.testing.assert_allclose(position.covariance_n, np.diag([1e-4, 1e-4, 4e-4]), rtol=1e-12)
    np.testing.assert_array_equal(velocity.velocity_n, [3.0, -1.0, 0.2])
    np.testing.assert_allclose(velocity.covariance_n, 0.03**2 * np.eye(3), rtol=1e-12)
    assert math.degrees(heading.heading_rad) == pytest.approx(10.0)  # 100 less the kit's 90
    assert heading.variance_rad2 == pytest.approx(math.radians(0.6) ** 2)
    assert [t_ms(s) for s in (position, velocity, heading)] == [100, 100, 100]
    assert interp.counts == {}
    assert interp.diagnostics["rtk_flag"] == "50"


STATUS = {
    FixStatus.FIXED: [50],
    FixStatus.FLOAT: [48, 49, 32, 33, 34, 17, 18, 20],
    FixStatus.SINGLE: [16, 19],
    FixStatus.NONE: [0, 1, 2, 8, 3, 7, 15, 21, 31, 35, 47, 51, 128, 255],
}
CASES = [(flag, status) for status, flags in STATUS.items() for flag in flags]


@pytest.mark.parametrize(("flag", "status"), CASES)
def test_status_by_flag(flag, status):
    samples = interpreter().take(rtk(0, **epoch(0, position_flag=flag)))
    (position,) = positions(samples)
    assert position.status is status
    assert fault_of(position) == ""
    assert (np.diagonal(position.covariance_n) > 0).all()
    assert len(of(VelocitySample, samples)) == (status is not FixStatus.NONE)


@pytest.mark.parametrize(
    "flags", [(50, 48), (48, 34), (49, 34), (34, 17), (17, 16), (16, 0)], ids=str
)
def test_covariance_worsens_by_class(flags):
    samples = [interpreter().take(rtk(0, **epoch(0, position_flag=flag))) for flag in flags]
    better, worse = (np.diagonal(positions(each)[0].covariance_n)[[0, 2]] for each in samples)
    assert (better < worse).all()


@pytest.mark.parametrize(
    "bad",
    [
        GeodeticPlace(0.0, 0.0, 0.0),
        GeodeticPlace(1e-9, -1e-9, 30.0),
        GeodeticPlace(NAN, 0.07, 30.0),
        GeodeticPlace(0.9, 0.07, NAN),
        GeodeticPlace(0.9, 0.07, INF),
        GeodeticPlace(1.6, 0.07, 30.0),
        GeodeticPlace(0.9, 3.2, 30.0),
        GeodeticPlace(0.9, 0.07, 1e6),
        GeodeticPlace(52.0, 4.0, 30.0),  # degrees
    ],
)
def test_an_invalid_place_is_refused(bad):
    interp = interpreter()
    samples = interp.take(rtk(0, **epoch(0) | {"place": bad}))
    assert positions(samples) == []
    assert len(samples) == 2  # velocity and heading are judged by themselves
    assert interp.counts == {"rtk_position_refused": 1}


@given(st.integers(-32768, 32767), st.floats(-360, 360))
def test_heading_of_any_turn(yaw_deg, offset_deg):
    second_m = math.cos(math.radians(offset_deg)), -math.sin(math.radians(offset_deg)), 0.3
    interp = interpreter(aircraft=AircraftConfig(second_antenna_m=second_m))
    (heading,) = interp.take(rtk(0, yaw_deg=yaw_deg, yaw_flag=50))
    assert 0 <= heading.heading_rad < math.tau
    # A yaw of 32768 deg has its last digit at 4e-12 deg.
    expected = math.radians((yaw_deg % 360) - offset_deg)
    assert wrap_pi(heading.heading_rad - expected) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("yaw_flag", [0, 16, 34, 48, 49, 51, 255, None])
def test_only_a_fixed_yaw_is_a_heading(yaw_flag):
    interp = interpreter()
    samples = interp.take(rtk(0, **epoch(0, yaw_flag=yaw_flag)))
    assert of(HeadingSample, samples) == []
    assert len(samples) == 2
    assert interp.counts == {"rtk_yaw_not_fixed": 1}


def test_a_flag_of_another_message_holds_for_a_while():
    interp = interpreter()
    assert interp.take(rtk(0, position_flag=50)) == []
    result = [positions(interp.take(rtk(t, place=place(t))))[0].status for t in (10, 1500, 1501)]
    assert result == [FixStatus.FIXED, FixStatus.FIXED, FixStatus.NONE]


SIGMAS = {"horizontal_sigma_m": 0.8, "vertical_sigma_m": 1.6, "velocity_sigma_m_s": 0.09}


def whole(number=0, fix=3, **other):
    return {
        "place": place(number),
        "velocity_n": (1.0, 2.0, 1e-3 * number),
        "fix": fix,
        **SIGMAS,
        **other,
    }


def test_a_reading_becomes_two_samples():
    interp = interpreter(delay=DjiDelayConfig(gps_s=0.1))
    position, velocity = interp.take(gps(400, **whole()))
    assert (position.source, velocity.source) == (Source.GPS_POSITION, Source.GPS_VELOCITY)
    assert position.status is FixStatus.SINGLE
    assert position.height_m == 73.25
    np.testing.assert_allclose(position.covariance_n, np.diag([0.64, 0.64, 2.56]))
    np.testing.assert_allclose(velocity.covariance_n, 0.0081 * np.eye(3))
    assert [t_ms(position), t_ms(velocity)] == [300, 300]


@pytest.mark.parametrize(
    ("fix", "status"),
    [(0, -1), (1, -1), (2, 0), (3, 0), (4, 0), (5, -1), (6, -1), (-1, -1), (255, -1)],
)
def test_status_by_fix(fix, status):
    samples = interpreter().take(gps(0, **whole(fix=fix)))
    (position,) = of(PositionSample, samples)
    assert position.status == status
    assert fault_of(position) == ""
    assert len(of(VelocitySample, samples)) == (status == 0)


@pytest.mark.parametrize("unknown", [None, 0.0, math.nan, -1.0, math.inf])
def test_an_accuracy_that_is_not_stated_gives_a_zero_covariance(unknown):
    """Zero in a message: the filter uses its default."""
    position, velocity = interpreter().take(gps(0, **whole() | dict.fromkeys(SIGMAS, unknown)))
    assert not position.covariance_n.any()
    assert not velocity.covariance_n.any()
    assert position.status is FixStatus.SINGLE


MESSAGES = Messages()

numbers = st.floats()  # NaN and infinities, subnormal and huge
vectors = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(numbers, numbers, numbers, numbers) | st.just((1.0, 0.0, 0.0, 0.0))
stamps = st.integers(0, 2**31 * 10**9 - 1) | st.integers(10**18, 10**18 + 10**9)
small = st.none() | st.integers(-(2**31), 2**31)
places = st.none() | st.builds(GeodeticPlace, numbers, numbers, numbers)
maybe_number, maybe_vector = st.none() | numbers, st.none() | vectors
origins, units = st.sampled_from(ImuOrigin), st.sampled_from(AccelerationUnit)
readings = st.one_of(
    st.builds(ImuReading, stamps, origins, vectors, units, vectors, st.none() | quaternions),
    st.builds(AttitudeReading, stamps, quaternions),
    st.builds(GpsReading, stamps, places, maybe_vector, small, *[maybe_number] * 3),
    st.builds(RtkReading, stamps, places, small, maybe_vector, small, small),
    st.builds(GimbalReading, stamps, numbers, numbers, numbers),
)


def values(sample):
    """Yield every number of a sample."""
    fields = [getattr(sample, name) for name in sample.__dataclass_fields__]
    for value in fields:
        if isinstance(value, float):
            yield value
        elif isinstance(value, np.ndarray):
            yield from value.ravel().tolist()


@settings(max_examples=200, deadline=None)
@given(st.lists(readings, max_size=30), st.sampled_from(["north", "body"]))
def test_any_readings_give_finite_samples_that_can_be_sent(random_readings, reference):
    interp = Interpreter(DjiConfig(gimbal_reference=reference, acceleration_unit="g"))
    samples = [*taken(interp, random_readings), *interp.flush()]
    for sample in samples:
        assert all(map(math.isfinite, values(sample)))
        topic, message = sensed(MESSAGES, sample)
        assert message is not None, topic
    assert all(isinstance(text, str) for text in interp.diagnostics.values())
    assert all(number > 0 for number in interp.counts.values())
    assert all(interp.warnings)


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
    interp = Interpreter(DjiConfig(geoid_undulation_m=40.0, aircraft=KIT))
    samples = [*taken(interp, flight(20.0)), *interp.flush()]
    result: dict[str, int] = {}
    for sample in samples:
        topic, _ = sensed(MESSAGES, sample)
        result[topic] = result.get(topic, 0) + 1
    assert result == {
        "imu/data": 1000,
        "gps/fix": 100,
        "rtk/fix": 100,
        "rtk/vel": 100,
        "rtk/heading": 100,
        "gimbal/attitude": 1000,
        "gimbal/joint_states": 999,  # none is after the last attitude
    }
    assert interp.warnings == []
    assert interp.counts == {"gimbal_without_joints": 1, "gps_repeated": 900, "rtk_repeated": 900}
    message_text = interp.diagnostics
    assert message_text["imu_source"] == "broadcast"
    assert message_text["acceleration_unit"] == "g (by its size, 1.000)"
    assert message_text["rtk_flag"] == message_text["rtk_yaw_flag"] == "50"
    assert message_text["geoid_undulation_m"] == "40"
