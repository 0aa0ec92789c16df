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
"""Interpolated poses: position, attitude and covariance; and when there is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from motions import angle_between

from tirgeo_ros.core.frames.rotations import (
    quat_from_rotvec,
    quat_multiply,
)
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.types.poses import BodyPose

STEP_NS = 10_000_000


def body(stamp_ns, position_n=(0.0, 0.0, 0.0), rotvec=(0.0, 0.0, 0.0), variance=1.0):
    q = quat_from_rotvec(np.array(rotvec, float))
    return BodyPose(stamp_ns, np.array(position_n, float), q, np.diag(np.full(6, variance)))


def constant_motion(stamp_ns, velocity_n, rate_b, start_q):
    """Straight line and constant body rate: interpolation has no error on it."""
    t = stamp_ns * 1e-9
    q = quat_multiply(start_q, quat_from_rotvec(np.asarray(rate_b) * t))
    return BodyPose(stamp_ns, np.asarray(velocity_n) * t, q, np.eye(6) * (1 + t))


vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(vectors, vectors, vectors, st.integers(0, 20 * STEP_NS))
def test_constant_motion_is_met_at_every_instant(velocity_n, rate_b, rotvec, stamp_ns):
    history: PoseBuffer[BodyPose] = PoseBuffer()
    start_q = quat_from_rotvec(rotvec)
    for k in range(21):
        history.add(constant_motion(k * STEP_NS, velocity_n, rate_b, start_q))
    truth = constant_motion(stamp_ns, velocity_n, rate_b, start_q)
    result = history.at(stamp_ns)
    assert isinstance(result, BodyPose)
    assert result.stamp_ns == stamp_ns
    # arithmetic on numbers of order one
    np.testing.assert_allclose(result.position_n, truth.position_n, atol=1e-12)
    np.testing.assert_allclose(result.covariance, truth.covariance, atol=1e-12)
    assert angle_between(result.q_nb, truth.q_nb) < 1e-7  # 2 atan2 near zero: root of epsilon


def test_never_outside_the_poses():
    history: PoseBuffer[BodyPose] = PoseBuffer()
    assert history.at(0) is Miss.EMPTY
    first, last = body(STEP_NS), body(2 * STEP_NS)
    history.add(first)
    history.add(last)
    assert history.at(STEP_NS - 1) is Miss.TOO_OLD
    assert history.at(STEP_NS) is first
    assert history.at(2 * STEP_NS) is last
    assert history.at(2 * STEP_NS + 1) is Miss.TOO_NEW


def test_a_gap_is_not_interpolated_but_its_ends_are_returned():
    history: PoseBuffer[BodyPose] = PoseBuffer(max_gap_s=0.1)
    for stamp_ns in (0, 100_000_000, 200_000_001):
        history.add(body(stamp_ns))
    assert isinstance(history.at(50_000_000), BodyPose)  # 0.1 s exactly is no gap
    assert history.at(150_000_000) is Miss.GAP
    assert isinstance(history.at(200_000_001), BodyPose)


def test_stamp_going_back_starts_again():
    history: PoseBuffer[BodyPose] = PoseBuffer()
    history.add(body(5 * STEP_NS))
    history.add(body(6 * STEP_NS))
    history.add(body(STEP_NS))
    assert history.went_back == 1
    assert len(history) == 1
    assert history.at(5 * STEP_NS) is Miss.TOO_NEW


@pytest.mark.parametrize(
    "pose",
    [
        body(0, position_n=(np.nan, 0, 0)),
        BodyPose(0, np.array([np.inf, -np.inf, 0]), np.array([np.inf, 0, 0, 1.0]), np.eye(6)),
    ],
)
def test_invalid_pose_is_refused_and_counted(pose):
    history: PoseBuffer[BodyPose] = PoseBuffer()
    assert not history.add(pose)
    assert history.invalid == 1
    assert history.fault
    assert history.at(0) is Miss.EMPTY
