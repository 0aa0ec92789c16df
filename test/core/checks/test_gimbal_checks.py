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
"""Mistakes planted in the joints of the sample flight are named; right joints are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from checked_flights import checked_flight

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.rotations import heading_of, matrix_from_quat, wrapped
from tirgeo_ros.core.gimbal.camera_pose import camera_turn, joint_angles
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import JointSample


def right(joints):
    return joints


def exchanged(joints):
    return replace(joints, roll_rad=joints.pitch_rad, pitch_rad=joints.roll_rad)


def exchanged_and_turned(joints):
    return replace(joints, roll_rad=-joints.pitch_rad, pitch_rad=joints.roll_rad)


def in_degrees(joints):
    angles = (joints.yaw_rad, joints.roll_rad, joints.pitch_rad)
    return JointSample(joints.stamp_ns, *map(math.degrees, angles))


def turned(axis):
    return lambda joints: replace(joints, **{axis: -getattr(joints, axis)})


pitch_turned, yaw_turned, roll_turned = map(turned, ("pitch_rad", "yaw_rad", "roll_rad"))


def result(sample, fault, *, reported=True, autopilot=True, config=None, given=None):
    checks = GimbalChecks(config or GimbalConfig(), given)
    for kind, what, _ in checked_flight(sample).events:
        if kind == "gimbal/joint_states":
            checks.joints(fault(what))
        elif kind == "gimbal/attitude" and reported:
            checks.reported(what)
        elif kind == "imu/data" and autopilot:
            checks.autopilot(what.stamp_ns, what.autopilot_q_nb)
        elif kind == "body":
            checks.body(what)
    return checks.findings()


@pytest.mark.parametrize("reported", [True, False])
def test_a_flight_that_is_right_says_nothing(sample, reported):
    assert not result(sample, right, reported=reported)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (exchanged, "are gimbal_yaw_joint, gimbal_pitch_joint, gimbal_roll_joint:"),
        (exchanged_and_turned, "are gimbal_yaw_joint, gimbal_pitch_joint, -gimbal_roll_joint:"),
        (in_degrees, "gimbal_pitch_joint, in degrees:"),
        (pitch_turned, "gimbal_roll_joint, -gimbal_pitch_joint:"),
        (yaw_turned, "are -gimbal_yaw_joint, "),
        (roll_turned, "joint, -gimbal_roll_joint, "),
    ],
)
@pytest.mark.parametrize("autopilot", [True, False])
def test_a_mistake_in_the_joints_is_named(sample, fault, words, autopilot):
    [finding] = result(sample, fault, autopilot=autopilot)
    assert finding.check == "joint_angles"
    assert finding.severity is Severity.STOP
    assert words in finding.evidence
    assert finding.parameter == "gimbal/joint_states"


def of_order(order):
    """A fault: the same camera on a gimbal with another order of its joints."""

    def change(joints):
        rotation = matrix_from_quat(camera_turn(joints))
        return JointSample(joints.stamp_ns, *joint_angles(rotation, order).tolist())

    return change


@pytest.mark.parametrize(
    "order", ["yaw-pitch-roll", "roll-pitch-yaw", "pitch-yaw-roll", "pitch-roll-yaw"]
)
def test_joints_of_another_order_are_named_and_may_be_configured(sample, order):
    [finding] = result(sample, of_order(order))
    assert (finding.check, finding.severity) == ("joint_order", Severity.STOP)
    assert f"a gimbal {order}, not yaw-roll-pitch" in finding.evidence
    assert finding.parameter == "gimbal_node joint_order"
    assert not result(sample, of_order(order), config=GimbalConfig(joint_order=order))
    [back] = result(sample, right, config=GimbalConfig(joint_order=order))
    assert "set it to yaw-roll-pitch" in back.mend


def off_by(axis, off_deg):
    return lambda joints: replace(joints, **{axis: getattr(joints, axis) + math.radians(off_deg)})


def test_a_joint_with_a_wrong_zero_is_reported_with_its_size_and_far_off_stops(sample):
    [finding] = result(sample, off_by("pitch_rad", 6.0))
    # The sample's reported pitch is within 0.5 deg (Table 8's wander) of the encoder's.
    mean_deg = float(finding.evidence.split(")")[0].split(",")[2])
    assert mean_deg == pytest.approx(6.0, abs=0.7)
    assert finding.severity is Severity.CAUTION
    [finding] = result(sample, off_by("yaw_rad", 25.0))
    assert (finding.check, finding.severity) == ("joints_unlike", Severity.STOP)


def test_yaw_counted_from_north_is_named(sample):
    bodies = [what for kind, what, _ in checked_flight(sample).events if kind == "body"]
    stamps_ns = np.array([body.stamp_ns for body in bodies])
    headings_rad = [heading_of(body.q_nb) for body in bodies]

    def from_north(joints):
        body = min(np.searchsorted(stamps_ns, joints.stamp_ns), len(bodies) - 1)
        return replace(joints, yaw_rad=wrapped(joints.yaw_rad + headings_rad[body]))

    [finding] = result(sample, from_north)
    assert (finding.check, finding.severity) == ("joint_angles", Severity.STOP)
    assert "are gimbal_yaw_joint, gimbal_roll_joint, gimbal_pitch_joint, yaw" in finding.evidence
    assert "yaw counted from north:" in finding.evidence


@pytest.mark.parametrize("late_s", [0.12, 0.3, 0.7, -0.15])
@pytest.mark.parametrize("reported", [True, False])
def test_joints_of_another_time_are_reported_with_their_delay(sample, late_s, reported):
    def restamped(joints):
        return replace(joints, stamp_ns=joints.stamp_ns + round(late_s * 1e9))

    [finding] = result(sample, restamped, reported=reported)
    assert (finding.check, finding.severity) == ("joints_late", Severity.STOP)
    reported_s = float(finding.evidence.split("stamped ")[1].split()[0])
    # Half a step between joints, 10 ms, and as much between attitudes of the autopilot.
    assert reported_s == pytest.approx(abs(late_s), abs=0.02)
    assert ("later" if late_s > 0 else "earlier") in finding.evidence
    assert finding.parameter == "gimbal/joint_states header.stamp"


def test_computed_joints_are_ignored(sample):
    assert not result(sample, lambda joints: replace(exchanged(joints), computed=True))


def test_a_boresight_at_its_default_is_reported(sample):
    [finding] = result(sample, right, given=())
    assert finding.check == "boresight_default"
    assert not result(sample, right, given={"boresight_rpy_deg"})
    assert not result(sample, right, config=GimbalConfig(boresight_rpy_deg=(1.0, 0, 0)), given=())
