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
"""Messages of the ROS 1 wrapper to readings: axes, units, stamps, refusals, whole epochs."""

from __future__ import annotations

import math
import random
from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from tirgeo_ros.core.frames.rotations import ENU_NED, FLU_FRD, matrix_from_quat, quat_from_euler
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    GeodeticPlace,
    GimbalReading,
    ImuReading,
    RtkEpochs,
    RtkReading,
)
from tirgeo_ros.dji.sources.ros1 import Ros1Decoder, Ros1Setup, survey

MS = 1_000_000
SECOND = 1_000 * MS
START = 1_718_091_879 * SECOND
LAG = 2 * MS
ROUNDING = 1e-12


def header(stamp_ns: int, frame_id: str = "") -> Message:
    return Message(
        stamp=Message(sec=stamp_ns // SECOND, nanosec=stamp_ns % SECOND), frame_id=frame_id
    )


def xyz(x: float, y: float, z: float) -> Message:
    return Message(x=x, y=y, z=z)


def imu(stamp_ns: int, force=(0.5, -0.25, 9.8), q=(1.0, 0.0, 0.0, 0.0)) -> Message:
    return Message(
        header=header(stamp_ns, "body_FLU"),
        orientation=Message(w=q[0], x=q[1], y=q[2], z=q[3]),
        orientation_covariance=[0.0] * 9,
        angular_velocity=xyz(0.1, 0.2, -0.3),
        linear_acceleration=xyz(*force),
    )


def vector(stamp_ns: int, x: float, y: float, z: float, frame_id: str = "") -> Message:
    return Message(header=header(stamp_ns, frame_id), vector=xyz(x, y, z))


def fix(stamp_ns: int, latitude=52.0, longitude=4.0, altitude=30.0) -> Message:
    return Message(
        header=header(stamp_ns), latitude=latitude, longitude=longitude, altitude=altitude
    )


def attitude(stamp_ns: int, w: float) -> Message:
    return Message(header=header(stamp_ns), quaternion=Message(w=w, x=0.0, y=0.0, z=0.0))


def readings(name, message, record_ns=START + LAG, setup=None):
    """Return the readings of one message, unfinished epochs included."""
    decoder = Ros1Decoder(setup or Ros1Setup())
    result = decoder.take(name, message, record_ns)
    return [arrived.reading for arrived in result + decoder.flush()]


def test_imu_is_turned_to_ned_and_frd():
    q_nb = quat_from_euler(0.1, -0.2, 2.5)
    rotation = ENU_NED @ matrix_from_quat(q_nb) @ FLU_FRD
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    (reading,) = readings("imu", imu(START, q=(w, x, y, z)))
    assert isinstance(reading, ImuReading)
    assert reading.stamp_ns == START
    assert reading.unit is AccelerationUnit.M_S2
    assert reading.acceleration_b == (0.5, 0.25, -9.8)
    assert reading.angular_rate_b == (0.1, -0.2, 0.3)
    assert abs(np.dot(reading.q_nb, q_nb)) == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize(
    ("angles", "frame"),
    [
        ((-70.0, 2.0, 45.0), ""),
        ((2.0, -70.0, 45.0), "ground_ENU"),
        ((2.0, -70.0, 45.0), "/ground_ENU"),
        ((2.0, -70.0, 45.0), "uav1/ground_ENU"),
    ],
)
def test_the_order_of_the_gimbals_angles_depends_on_the_frame(angles, frame):
    (reading,) = readings("gimbal_angle", vector(START, *angles, frame))
    expected = GimbalReading(START, math.radians(2.0), math.radians(-70.0), math.radians(45.0))
    assert reading == expected


@pytest.mark.parametrize(
    ("name", "message", "because"),
    [
        ("imu", imu(START, force=(math.nan, 0.0, 9.8)), "not finite: nan, 0, 9.8"),
        ("attitude", attitude(START, 0.0), "a quaternion of length 0"),
        ("velocity", vector(START, math.inf, 0.0, 0.0), "not finite: inf"),
        ("gps_position", fix(START, latitude=0.0, longitude=0.0), "no position yet"),
        ("rtk_position", fix(START, latitude=91.0), "not a place on the Earth: 91, 4"),
        ("rtk_position", fix(START, altitude=math.nan), "not finite"),
        ("gimbal_angle", vector(START, 4500.0, 0.0, 0.0), "not angles of a gimbal"),
        ("rtk_yaw", Message(angle=1), "its definition has no field data"),
        ("imu", imu(START - 3600 * SECOND), r"its stamp is -3600 s from its time of recording"),
    ],
)
def test_invalid_values_are_refused(name, message, because):
    with pytest.raises(MessageError, match=because):
        readings(name, message)


def test_yaw_and_flags_have_the_stamp_of_their_position():
    decoder = Ros1Decoder()
    messages = [
        ("rtk_info_position", Message(data=50)),
        ("rtk_position", fix(START)),
        ("rtk_yaw", Message(data=-90)),
        ("rtk_info_yaw", Message(data=49)),
    ]
    for k, (name, message) in enumerate(messages):
        assert decoder.take(name, message, START + (k + 2) * MS) == []
    ((arrival_ns, reading),) = decoder.take("imu", imu(START + SECOND), START + SECOND)[:1]
    place = (math.radians(52.0), math.radians(4.0), 30.0)
    assert reading == RtkReading(START, place, 50, None, -90, 49)
    assert arrival_ns == START + 5 * MS


def test_a_bag_that_was_recorded_again_has_the_clock_of_its_stamps():
    later = 86_400 * SECOND
    stamps = [START + k * 10 * MS for k in range(50)]
    setup = survey(("imu", imu(stamp), stamp + LAG + later) for stamp in stamps)
    decoder = Ros1Decoder(setup)
    assert setup.shift_ns == later + LAG
    message = Message(data=10)
    assert decoder.take("rtk_yaw", message, START + later + LAG) == []
    ((arrival_ns, reading),) = decoder.flush()
    assert arrival_ns == reading.stamp_ns == START
    assert "86400.002 s before the times of recording" in decoder.warnings[0]


def test_a_gravity_that_is_multiplied_in_twice():
    """Broadcast with m/s2 set in Assistant: the wrapper multiplies by g again."""
    message = imu(START, force=(0.0, 0.0, 9.8 * 9.801))
    setup = survey([("imu", message, START)] * 30)
    (reading,) = readings("imu", message, setup=setup)
    assert reading.acceleration_b[2] == pytest.approx(-9.8, abs=ROUNDING)
    assert "gravity multiplied in twice" in Ros1Decoder(setup).warnings[0]


@pytest.mark.parametrize("burst", [4, 8, 16])
def test_an_imu_in_bursts_gets_the_stamps_of_its_rate(burst):
    """400 Hz stamped when the serial port hands over a burst, with 0.3 ms of scheduling.

    After two seconds of learning the stamps stand on a line: within 0.1 ms of it (a third of the
    scheduling), where the bursts are off by milliseconds.
    """
    rng = random.Random(burst)
    true = [START + k * 2_500_000 for k in range(2400)]
    stamped = []
    for k in range(len(true)):
        last = min(k // burst * burst + burst - 1, len(true) - 1)
        after = stamped[-1] + 20_000 if stamped else 0
        stamped.append(max(true[last] + rng.randrange(300_000), after))
    decoder = Ros1Decoder(survey(("imu", imu(stamp), stamp + MS) for stamp in stamped[:200]))
    stamps_ns = [decoder.take("imu", imu(s), s + MS)[0].reading.stamp_ns for s in stamped]
    errors_ms = (np.array(stamps_ns) - np.array(true))[800:] * 1e-6
    assert np.std(errors_ms) < 0.1
    assert np.std((np.array(stamped) - np.array(true))[800:] * 1e-6) > 2.0
    assert "imu is stamped in bursts" in decoder.warnings[0]


def test_even_stamps_are_left_alone():
    """Also whole milliseconds at 400 Hz, as the aircraft's aligned clock gives them."""
    stamps = [START + (5 * k // 2) * MS for k in range(400)]
    setup = survey(("imu", imu(stamp), stamp + LAG) for stamp in stamps)
    assert setup == Ros1Setup()
    decoder = Ros1Decoder(setup)
    assert [decoder.take("imu", imu(s), s + LAG)[0].reading.stamp_ns for s in stamps] == stamps


def test_fused_velocity_is_east_north_up():
    (reading,) = readings("velocity", vector(START, 1.0, 2.0, 3.0, "ground_ENU"))
    assert reading.velocity_n == (2.0, 1.0, -3.0)


PERIOD = 200 * MS
PARTS = ("place", "velocity_n", "yaw_deg", "position_flag", "yaw_flag")


def part(name: str, number: int, stamp_ns: int) -> RtkReading:
    """Return a part whose value shows its epoch."""
    values = {
        "place": GeodeticPlace(0.9, 0.1, float(number)),
        "velocity_n": (float(number), 0.0, 0.0),
    }
    return RtkReading(stamp_ns, **{name: values.get(name, number)})


def reports(events):
    """Return the readings of (arrival, part)."""
    epochs = RtkEpochs()
    result = []
    for arrival_ns, given_part in events:
        result += epochs.take(given_part, arrival_ns)
    return result + epochs.flush()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.permutations(PARTS), min_size=1, max_size=6),
    st.lists(st.integers(0, 45), min_size=30, max_size=30),
)
def test_any_order_within_an_epoch_and_any_delay_below_half_of_one(orders, delays_ms):
    """The stamp is the position's; every part is with those of its own epoch.

    Yaw and flags have the time of their record for a stamp, and the velocity one of its own.
    """
    events = []
    for number, order in enumerate(orders):
        for place, name in enumerate(order):
            late = sum(delays_ms[5 * number : 5 * number + place]) % 90
            at_ns = number * PERIOD + late * MS
            stamps = {"place": number * PERIOD, "velocity_n": number * PERIOD + 1}
            events.append((at_ns, part(name, number, stamps.get(name, at_ns + 2))))
    events.sort(key=lambda event: event[0])
    result = reports(events)
    assert [reading.stamp_ns for _, reading in result] == [k * PERIOD for k in range(len(orders))]
    for number, (_, reading) in enumerate(result):
        assert reading == RtkReading(
            number * PERIOD,
            GeodeticPlace(0.9, 0.1, float(number)),
            number,
            (float(number), 0.0, 0.0),
            number,
            number,
        )


@pytest.mark.parametrize("lost", PARTS)
def test_a_lost_part_costs_no_other_part(lost):
    events = [
        (number * PERIOD + k * MS, part(name, number, number * PERIOD))
        for number in range(3)
        for k, name in enumerate(PARTS)
        if (number, name) != (1, lost)
    ]
    result = [reading for _, reading in reports(events)]
    assert len(result) == 3
    for number, reading in enumerate(result):
        absent = {name for name in PARTS if getattr(reading, name) is None}
        assert absent == ({lost} if number == 1 else set())


def test_a_whole_epoch_does_not_wait():
    epochs = RtkEpochs()
    result = [epochs.take(part(name, 1, k), k) for k, name in enumerate(PARTS)]
    assert [len(each) for each in result] == [0, 0, 0, 0, 1]
