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
"""Poses of one flight against each other."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.rotations import canonical, quat_from_rotvec, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.replay.graph_outputs import differences, in_plane

MS = 1_000_000
HERE = TangentPlane(math.radians(39.85), math.radians(116.7), 11.5)
NEAR = TangentPlane(math.radians(39.86), math.radians(116.72), 25.0)


def poses(count: int) -> list[CameraPose]:
    rng = np.random.default_rng(5)
    q = canonical(rng.normal(size=4))
    return [
        CameraPose(k * 20 * MS, np.array([0.06 * k, 1.0, -20.0]), q, np.eye(6) * 1e-4)
        for k in range(count)
    ]


def test_a_shift_and_a_turn_are_found_with_their_axes():
    turn, shift = np.array([0.0, 0.0, math.radians(2)]), np.array([0.0, 0.3, 0.4])
    moved = [
        dataclasses.replace(
            pose,
            position_n=pose.position_n + shift,
            q_nc=quat_multiply(quat_from_rotvec(turn), pose.q_nc),
        )
        for pose in poses(4)
    ]
    apart = differences([*moved, dataclasses.replace(moved[0], stamp_ns=80 * MS)], poses(4))
    assert np.allclose(apart.position_n, shift)
    assert np.allclose(apart.rotation_n, turn)
    assert apart.distance_m == pytest.approx([0.5] * 4)
    assert apart.angle_rad == pytest.approx([math.radians(2)] * 4)


def test_another_plane_is_the_same_place_and_back_again():
    for pose in poses(3):
        there = in_plane(pose, HERE, NEAR)
        # Same point of the earth: arithmetic of doubles at the earth's radius, 1e-9 m.
        expected = NEAR.ned_from_geodetic(*HERE.geodetic_from_ned(pose.position_n))
        assert there.position_n == pytest.approx(expected, abs=1e-8)
        back = in_plane(there, NEAR, HERE)
        assert back.position_n == pytest.approx(pose.position_n, abs=1e-7)
        assert differences([back], [pose]).angle_rad[0] < 1e-9
        assert back.covariance == pytest.approx(pose.covariance)
