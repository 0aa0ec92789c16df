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
"""Readings of an aircraft for the tests of their meaning."""

from __future__ import annotations

import math

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
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

MS = 1_000_000
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
LEVEL = (1.0, 0.0, 0.0, 0.0)
AT_REST_G = (0.0, 0.0, -1.0)
#: DJI's kit: the first antenna left, the second right.
KIT = AircraftConfig(rtk_antenna_m=(0.0, 0.55, 0.35), second_antenna_m=(0.0, -0.55, 0.35))


def wxyz(roll=0.0, pitch=0.0, yaw=0.0):
    return tuple(quat_from_euler(roll, pitch, yaw).tolist())


def imu(t_ms, acceleration=AT_REST_G, unit=AccelerationUnit.G, q_nb=LEVEL, **other):
    origin = other.get("origin", ImuOrigin.BROADCAST)
    rate = other.get("rate", (0.0, 0.0, 0.0))
    return ImuReading(START + round(t_ms * MS), origin, acceleration, unit, rate, q_nb)


def attitude(t_ms, q_nb=LEVEL):
    return AttitudeReading(START + round(t_ms * MS), q_nb)


def place(number=0, height_m=30.0):
    """Each number is a place of its own, 3 m further north."""
    return GeodeticPlace(math.radians(52.0) + number * 3 / 6.4e6, math.radians(4.0), height_m)


def rtk(t_ms, **parts):
    return RtkReading(START + round(t_ms * MS), **parts)


def epoch(number, position_flag=50, yaw_deg=100, yaw_flag=50):
    """Every part of an epoch; the yaw is a whole degree that stays the same."""
    return {
        "place": place(number),
        "position_flag": position_flag,
        "velocity_n": (3.0 + 1e-3 * number, -1.0, 0.2),
        "yaw_deg": yaw_deg,
        "yaw_flag": yaw_flag,
    }


def gps(t_ms, **parts):
    return GpsReading(START + round(t_ms * MS), **parts)


def gimbal(t_ms, roll=0.0, pitch=-0.5, yaw=0.0):
    return GimbalReading(START + round(t_ms * MS), roll, pitch, yaw)


def taken(interpreter, readings):
    """All samples of readings, in the order in which they come out."""
    return [sample for reading in readings for sample in interpreter.take(reading)]


def of(kind, samples):
    return [sample for sample in samples if isinstance(sample, kind)]


def t_ms(sample):
    return (sample.stamp_ns - START) / MS
