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
"""The composer: which samples wait, are composed or dropped, and how they are counted."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.config import GimbalConfig, NorthConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    matrix_from_quat,
    quat_from_euler,
    wrap_pi,
)
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose

MS = 1_000_000
YAW_RATE = 0.8  # rad/s, of the body


def body(t_ms, yaw=None):
    yaw = YAW_RATE * t_ms * 1e-3 if yaw is None else yaw
    position_n = np.array([3e-3 * t_ms, 0.0, -20.0])
    return BodyPose(t_ms * MS, position_n, quat_from_euler(0.0, 0.0, yaw), np.eye(6) * 1e-4)


def joints(t_ms):
    return JointSample(t_ms * MS, 0.1, 0.0, -0.5)


def reported(t_ms, yaw):
    return CameraAttitudeSample(t_ms * MS, quat_from_euler(0.0, -0.5, yaw))


def heading(pose):
    forward = (matrix_from_quat(pose.q_nc) @ BODY_OPTICAL.T)[:, 0]
    return float(np.arctan2(forward[1], forward[0]))


def composing(composition="encoders", **values):
    return GimbalComposer(GimbalConfig(composition=composition, **values))


def test_waits_for_the_body_then_interpolates():
    composer = composing()
    assert composer.add_body(body(0)) == []
    assert composer.add_joints(joints(5)) == []
    (pose,) = composer.add_body(body(10))
    assert pose.stamp_ns == 5 * MS
    np.testing.assert_allclose(pose.position_n, [15e-3, 0, -20], atol=1e-12)
    assert heading(pose) == pytest.approx(YAW_RATE * 5e-3 + 0.1, abs=1e-12)
    assert composer.counts == {"composed": 1}


def test_paper_takes_the_autopilot_of_the_same_instant():
    """The autopilot's heading error, and its turning, cancel in psi_coder."""
    composer = composing("paper")
    error = 0.3
    poses = []
    for t_ms in range(0, 101, 10):
        autopilot_yaw = YAW_RATE * t_ms * 1e-3 + error
        poses += composer.add_autopilot(t_ms * MS, quat_from_euler(0.0, 0.0, autopilot_yaw))
        poses += composer.add_body(body(t_ms))
    at_ms = 43  # between two samples of the autopilot
    true_yaw = YAW_RATE * at_ms * 1e-3
    poses += composer.add_attitude(reported(at_ms, true_yaw + 0.1 + error))
    (pose,) = poses
    assert wrap_pi(heading(pose) - (true_yaw + 0.1)) == pytest.approx(0, abs=1e-12)


def arrivals():
    """Return the samples of 200 ms, each stream in its own order."""
    bodies = [("add_body", (body(t),)) for t in range(0, 201, 10)]
    autopilot = [
        ("add_autopilot", (t * MS, quat_from_euler(0.0, 0.0, YAW_RATE * t * 1e-3 + 0.3)))
        for t in range(0, 201, 10)
    ]
    attitudes = [
        ("add_attitude", (reported(t, YAW_RATE * t * 1e-3 + 0.4),)) for t in range(3, 200, 20)
    ]
    return [bodies, autopilot, attitudes]


@settings(max_examples=20)  # each composes twenty poses
@given(st.randoms(use_true_random=False))
def test_order_of_arrival_changes_nothing(random):
    """Streams mixed in any way give the same poses to the last bit."""
    outputs = []
    for mixed in (False, True):
        composer = composing("paper")
        streams = [list(stream) for stream in arrivals()]
        poses = []
        while any(streams):
            open_streams = [stream for stream in streams if stream]
            stream = random.choice(open_streams) if mixed else open_streams[0]
            name, arguments = stream.pop(0)
            poses += getattr(composer, name)(*arguments)
        outputs.append([(p.stamp_ns, p.q_nc.tolist(), p.covariance.tolist()) for p in poses])
    assert len(outputs[0]) == 10
    assert outputs[0] == outputs[1]


def test_dropped_when_the_body_does_not_come():
    composer = composing(max_wait_s=0.1)
    composer.add_body(body(0))
    for t_ms in range(10, 131, 20):
        assert composer.add_joints(joints(t_ms)) == []
    # at 130 ms the samples of 10 ms and no other waited for more than 100 ms
    assert composer.counts == {"body_too_new": 1}
    assert [pose.stamp_ns for pose in composer.add_body(body(60))] == [30 * MS, 50 * MS]


def feed(composer, t_ms, *, joint=True, attitude=True, bias=0.0):
    """Add the samples of one instant of a level hover; return the composed poses."""
    poses = composer.add_autopilot(t_ms * MS, quat_from_euler(0.0, 0.0, 0.3))
    poses += composer.add_body(body(t_ms, 0.0))
    if joint:
        poses += composer.add_joints(joints(t_ms))
    if attitude:
        poses += composer.add_attitude(reported(t_ms, 0.3 + 0.1 + bias))
    return poses


def test_auto_goes_over_to_steady_joints_and_back_when_they_are_silent():
    """The bias of the gimbal's north, 3 deg, is estimated by then: the heading does not jump."""
    composer = composing("auto")
    driven, poses = [], []
    for t_ms in range(0, 10_000, 20):
        poses += feed(composer, t_ms, joint=t_ms <= 4000, bias=np.radians(3.0))
        driven.append((t_ms, composer.composition))
    stamps = [pose.stamp_ns for pose in poses]
    late = [heading(pose) for pose in poses if pose.stamp_ns > 2000 * MS]
    # three readings of 0.2 deg each against the prior of 3 deg; FLU joints turn the other way
    assert np.ptp(np.degrees(late)) < 0.1
    changes = [
        (t_ms, now) for (_, before), (t_ms, now) in itertools.pairwise(driven) if now != before
    ]
    assert driven[0] == (0, "paper")
    assert changes == [(2000, "encoders"), (6000, "paper")]
    # one pose for each sample of the driving stream: none twice, none back, two seconds silent
    expected = [t * MS for t in range(0, 10_000, 20) if not 4000 < t < 6000]
    assert stamps == expected
    counts = composer.counts
    assert (counts["joints_steady"], counts["joints_silent"]) == (1, 1)
    assert counts["composed"] == len(expected)
    assert counts["composed"] + counts["unused"] == 500 + 201


def test_computed_joints_do_not_measure_the_bias_of_the_north():
    """They would measure zero, because the reported attitude has the same bias."""
    bias = np.radians(4.0)
    composer = composing("auto")
    for t_ms in range(0, 8000, 20):
        feed(composer, t_ms, joint=False, bias=bias)
        # What a level aircraft's reported attitude of 0.1 rad off the nose gives as joints.
        composer.add_joints(JointSample(t_ms * MS, 0.1 + bias, 0.0, -0.5, computed=True))
    assert "north_used" not in composer.counts
    assert composer.north.bias_rad == 0.0
    assert composer.north.variance > np.radians(3.0) ** 2


def test_computed_joints_of_a_centred_gimbal_show_its_north():
    """Once the joints are in use, reported attitudes no longer measure it."""
    bias_deg = 2.0
    composer = composing(north=NorthConfig(centred=True))
    for t_ms in range(0, 20_000, 50):
        composer.add_body(body(t_ms, 0.7))
        composer.add_joints(JointSample(t_ms * MS, np.radians(bias_deg), 0.0, -0.5, computed=True))
    assert composer.counts["north_used"] == 16  # 3 s to settle, then one in 1.05 s
    # hypot(0.2 / 4, 0.3) deg of the readings against 3 of the prior
    assert np.degrees(composer.north.bias_rad) == pytest.approx(bias_deg, abs=0.03)
    assert np.degrees(np.sqrt(composer.north.variance)) == pytest.approx(0.31, abs=0.02)


def test_bad_samples_are_counted():
    composer = composing("auto")
    nan = float("nan")
    composer.add_attitude(CameraAttitudeSample(0, np.zeros(4)))
    composer.add_attitude(CameraAttitudeSample(0, np.array([nan, 0, 0, 1.0])))
    composer.add_joints(JointSample(0, nan, 0.0, 0.0))
    composer.add_joints(JointSample(0, 0.0, float("inf"), 0.0))
    composer.add_joints(JointSample(0, 0.0, 1e200, 0.0))
    composer.add_autopilot(0, np.zeros(4))
    composer.add_body(BodyPose(0, np.full(3, nan), quat_from_euler(0.0, 0.0, 0.0), np.eye(6)))
    assert composer.counts == {"invalid": 5, "autopilot_invalid": 1, "body_invalid": 1}
    assert "not on the Earth" in composer.diagnostics["body_invalid_because"]
    assert composer.composition == "paper"  # a broken joint sample changes nothing


def test_clock_going_back_starts_again():
    composer = composing()
    composer.add_body(body(5000))
    composer.add_joints(joints(5005))
    composer.add_body(body(0))
    composer.add_joints(joints(5))
    (pose,) = composer.add_body(body(10))
    assert pose.stamp_ns == 5 * MS
    assert composer.counts == {"composed": 1, "went_back": 1, "body_went_back": 1}


@pytest.mark.parametrize("computed", [False, True])
def test_the_yaw_zero_is_subtracted_only_from_an_encoders_angle(computed):
    def heading_of(zero_deg):
        composer = composing(yaw_zero_deg=zero_deg)
        composer.add_body(body(0, 0.0))
        composer.add_body(body(20, 0.0))
        (pose,) = composer.add_joints(JointSample(10 * MS, 0.3, 0.0, -0.5, computed=computed))
        assert composer.sees_joints is not computed
        return np.degrees(heading(pose))

    # the joint's axis is up, a heading turns about down: an angle sent 2 deg too large to the
    # left stands for a camera 2 deg farther to the right
    expected = 0.0 if computed else 2.0
    assert heading_of(2.0) - heading_of(0.0) == pytest.approx(expected, abs=1e-9)
