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
"""The topics of psdk_ros2: units and axes by numbers computed by hand, and stamps."""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import (
    ENU_NED,
    FLU_FRD,
    matrix_from_quat,
    quat_from_matrix,
    quat_from_rotvec,
)
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.sources.psdk import PSDK_TOPICS, PsdkDecoder
from tirgeo_ros.dji.sources.readings import GpsReading

MS = 1_000_000
SECOND = 1000 * MS
START = 1_700_000_000 * SECOND
EPOCH = 200 * MS


def xyz(x, y, z):
    return Message(x=x, y=y, z=z)


def fix(latitude, longitude, altitude):
    return Message(latitude=latitude, longitude=longitude, altitude=altitude)


def twist(x, y, z):
    return Message(twist=Message(linear=xyz(x, y, z)))


def details(fix_state, horizontal, vertical, speed):
    accuracies = {"horizontal_accuracy": horizontal, "vertical_accuracy": vertical}
    return Message(fix_state=fix_state, speed_accuracy=speed, **accuracies)


HOME = fix(52.0, 13.0, 80.0)
LEVEL_EAST = Message(w=1.0, x=0.0, y=0.0, z=0.0)  # FLU to ENU: the nose points east
IMU = Message(
    orientation=LEVEL_EAST,
    angular_velocity=xyz(0.0, 0.0, 0.0),
    linear_acceleration=xyz(0.0, 0.0, 9.8),
)
#: Rounding of a few products of numbers of order one.
ROUNDING = 2e-15


def single(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


PI32 = single(math.pi)
angles = st.floats(-179.99, 179.99)


@pytest.fixture
def decoder():
    return PsdkDecoder()


def near(metres: float) -> Message:
    """Return a fix this far north of home."""
    return fix(HOME.latitude + metres / 111e3, HOME.longitude, HOME.altitude)


@given(st.integers(-(2**15), 2**15 - 1))
def test_every_rtk_yaw_is_read(yaw_deg):
    (sent,) = struct.unpack("<H", struct.pack("<h", yaw_deg))
    assert PSDK_TOPICS["rtk_yaw"][1](7, Message(yaw=sent)).yaw_deg == yaw_deg


@given(angles, st.floats(-120, 60), st.floats(-30, 30))
def test_gimbal_round_trip(yaw_deg, pitch_deg, roll_deg):
    """As psdk_ros2 computes them: with constants of single precision, and one turn added."""
    z = single(1.571) - yaw_deg * PI32 / 180
    if z < -PI32:
        z += 2 * PI32
    elif z > PI32:
        z -= 2 * PI32
    sent = (roll_deg * PI32 / 180, -pitch_deg * PI32 / 180, z)
    _, roll, pitch, yaw = PSDK_TOPICS["gimbal_angles"][1](7, Message(vector=xyz(*sent)))
    # Its pi is 8.7e-8 too large, its 1.571 is 2.4e-8 off: over a turn less than 3e-7.
    assert roll == pytest.approx(math.radians(roll_deg), abs=3e-7)
    assert pitch == pytest.approx(math.radians(pitch_deg), abs=3e-7)
    assert abs(math.remainder(yaw - math.radians(yaw_deg), math.tau)) < 3e-7
    assert -math.pi <= yaw < math.pi


@given(st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array))
def test_attitude_round_trip(rotvec):
    """R_ENU<-NED R R_FRD<-FLU is sent; q and -q are the same attitude."""
    matrix = matrix_from_quat(quat_from_rotvec(rotvec))
    sent = quat_from_matrix(ENU_NED @ matrix @ FLU_FRD)
    for sign in (1, -1):
        w, x, y, z = (sign * sent).tolist()
        reading = PSDK_TOPICS["attitude"][1](7, Message(quaternion=Message(w=w, x=x, y=y, z=z)))
        back = matrix_from_quat(np.array(reading.q_nb))
        np.testing.assert_allclose(back, matrix, atol=10 * ROUNDING)


@pytest.mark.parametrize(("fix", "is_fix"), [(3.0, 3), (math.nan, 0), (math.inf, 0)])
def test_accuracies_are_millimetres_and_centimetres_a_second(fix, is_fix):
    reading = PSDK_TOPICS["gps_details"][1](7, details(fix, 1500.0, 2500.0, 40.0))
    assert reading == GpsReading(7, None, None, is_fix, 1.5, 2.5, pytest.approx(0.4, rel=ROUNDING))


def test_receivers_keep_the_stamps_of_their_headers(decoder):
    """Their delay is a parameter, which is subtracted later."""
    (position,) = decoder.take("gps_position", HOME, START, START + 3 * MS)
    (velocity,) = decoder.take("gps_velocity", twist(1.0, 2.0, 3.0), START + 1, START + 3 * MS)
    quality = details(3.0, 1e3, 2e3, 10.0)
    (accuracy,) = decoder.take("gps_details", quality, START + 2, START + 3 * MS)
    assert [r.stamp_ns - START for r in (position, velocity, accuracy)] == [0, 1, 2]
    assert velocity.velocity_n == (1.0, 2.0, 3.0)  # north, east, down, as it comes
    decoder.take("rtk_velocity", twist(1.0, 2.0, 3.0), START + 1, START + 2 * MS)
    decoder.take("rtk_position", HOME, START, START + 3 * MS)
    decoder.take("rtk_position_info", Message(data=50), 0, START + 4 * MS)
    (fixed,) = decoder.due(START + EPOCH)
    assert (fixed.stamp_ns, fixed.position_flag) == (START, 50)
    assert fixed.velocity_n == (1.0, 2.0, 3.0)


def test_streams_of_a_steady_rate_lose_their_jitter(decoder):
    """At 100 Hz, with the delays of a callback, 0 to 8 ms."""
    late = np.random.default_rng(3).exponential(1.5 * MS, 3000).clip(0, 8 * MS).astype(int)
    sent = START + np.arange(3000) * 10 * MS
    angles = Message(vector=xyz(0, 0, 0))
    attitude = Message(quaternion=LEVEL_EAST)
    for topic, message in (("imu", IMU), ("attitude", attitude), ("gimbal_angles", angles)):
        stamps = [
            decoder.take(topic, message, int(at), int(at))[0].stamp_ns
            for at in np.maximum.accumulate(sent + late)
        ]
        assert all(b > a for a, b in pairwise(stamps))
        # Only the second half: the first is for learning. The clock is settled within 0.1 ms.
        off = (np.array(stamps) - sent)[1500:]
        assert late[1500:].std() > 1 * MS
        assert off.std() < 0.1 * MS


@pytest.mark.parametrize("flag_after_ns", [-5 * MS, 5 * MS])
def test_a_lost_fix_is_published_at_once(decoder, flag_after_ns):
    """Not an epoch later, whether the flag comes before the position or after it."""
    interpreter, events = Interpreter(DjiConfig(geoid_undulation_m=40.0)), []
    for number, flag in enumerate([50, 50, 34, 34, 50]):
        at = START + number * EPOCH
        events += [("rtk_position", near(number), at, at)]
        events += [("rtk_position_info", Message(data=flag), 0, at + flag_after_ns)]
    events.sort(key=lambda event: event[3])
    readings = [reading for event in events for reading in decoder.take(*event)]
    readings += decoder.due(START + 5 * EPOCH)
    samples = [s for r in readings for s in interpreter.take(r) if isinstance(s, PositionSample)]
    for number, sample in enumerate(samples):
        assert sample.latitude_rad == pytest.approx(math.radians(near(number).latitude))
        assert sample.height_m == pytest.approx(HOME.altitude + 40.0)
    fixed, floating = FixStatus.FIXED, FixStatus.FLOAT
    assert [s.status for s in samples] == [fixed, fixed, floating, floating, fixed]
