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
"""Transforms, outlines and tracks as messages: against rotations by SciPy, and their frames."""

from __future__ import annotations

import message_samples as samples
import numpy as np
import pytest
from message_samples import builder, through_cdr
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from transform_chains import Chains, rigid

from tirgeo_ros.core.config import AircraftConfig, FramesConfig
from tirgeo_ros.io.messages import Messages, sensed

#: Some ten products of numbers of order 30.
ROUNDING = 1e-13
AIRCRAFT = AircraftConfig(
    imu_m=(0.5, 0.25, -0.125),
    imu_rpy_deg=(0.0, 0.0, 90.0),
    rtk_antenna_m=(1.0, 2.0, 3.0),
    second_antenna_m=(1.0, -2.0, 3.0),
    gps_antenna_m=(4.0, 5.0, 6.0),
    gimbal_pivot_m=(0.25, 0.0, -0.5),
)


def test_the_chain_of_transforms_is_the_camera_pose():
    body = builder.body_transform(samples.BODY)
    camera = builder.camera_transform(samples.BODY, samples.CAMERA_POSE)
    chains = Chains([through_cdr(builder.tf([body])), through_cdr(builder.tf([camera]))])
    pose = builder.camera_pose(samples.CAMERA_POSE).pose.pose
    wanted = rigid(pose.position, pose.orientation)
    result = chains.pose("tir_optical_frame", samples.STAMP_NS)
    assert_allclose(result, wanted, rtol=0, atol=ROUNDING)
    odometry = builder.odometry(samples.SOLUTION, samples.BODY).pose.pose
    assert_array_equal(
        rigid(odometry.position, odometry.orientation),
        rigid(body.transform.translation, body.transform.rotation),
    )


def test_what_is_fixed_is_where_the_aircraft_block_has_it():
    result = builder.fixed_transforms(AIRCRAFT, samples.STAMP_NS)
    chains = Chains([through_cdr(builder.tf(result))])
    assert set(chains.parents.values()) == {"base_link"}
    places = {
        "rtk_antenna": (0.5, 1.75, 3.125),
        "second_antenna": (0.5, -2.25, 3.125),
        "gps_antenna": (3.5, 4.75, 6.125),
        "gimbal_pivot": (-0.25, -0.25, -0.375),
        "imu_link": (0.0, 0.0, 0.0),
    }
    assert set(chains.parents) == set(places)
    for name, place in places.items():
        pose = chains.pose(name, samples.STAMP_NS)
        assert_array_equal(pose[:3, 3], place)
        if name != "imu_link":
            assert_array_equal(pose[:3, :3], np.eye(3))
    # Turned by 90 deg about up, the IMU's forward axis points to the aircraft's left.
    assert_allclose(chains.pose("imu_link", samples.STAMP_NS)[:3, 0], [0, 1, 0], atol=1e-15)
    alone = Chains([builder.tf(builder.fixed_transforms(AircraftConfig(), 0))])
    assert "second_antenna" not in alone.parents


@pytest.mark.parametrize("rpy_deg", [(10.0, 0.0, 0.0), (0.0, 20.0, 0.0), (10.0, -20.0, 30.0)])
def test_the_imu_is_turned_as_the_block_says(rpy_deg):
    """Roll, pitch, yaw about forward, left, up, applied yaw first."""
    aircraft = AircraftConfig(imu_rpy_deg=rpy_deg)
    pose = Chains([builder.tf(builder.fixed_transforms(aircraft, 0))]).pose("imu_link", 0)
    wanted = Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True).as_matrix()
    assert_allclose(pose[:3, :3], wanted, atol=1e-15)


def test_outline_and_track_are_in_the_map():
    outline_n = np.array([[1.0, 2.0, -3.0], [4.0, 5.0, -6.0]])
    footprint = through_cdr(builder.footprint(samples.STAMP_NS, outline_n))
    points = [(p.x, p.y, p.z) for p in footprint.polygon.points]
    assert points == [(2.0, 1.0, 3.0), (5.0, 4.0, 6.0)]
    path = through_cdr(builder.path(7, [builder.track_point(samples.BODY)]))
    place = path.poses[0].pose.position
    assert (place.x, place.y, place.z) == (-20.0, 10.0, 30.0)
    assert (footprint.header.frame_id, path.header.frame_id) == ("map", "map")
    assert through_cdr(builder.footprint(0, np.empty((0, 3)))).polygon.points == []


def ids_of(message) -> set[str]:
    """Every frame id in a message, but for that of a marker's texture."""
    result = set()
    for name in message.__dataclass_fields__:
        if name == "texture":
            continue
        value = getattr(message, name)
        if name in ("frame_id", "child_frame_id"):
            result.add(value)
        for each in value if isinstance(value, list) else [value]:
            if hasattr(each, "__dataclass_fields__"):
                result |= ids_of(each)
    return result


def test_every_message_has_the_prefix():
    config = FramesConfig("field", "body", "eye", "uav1/")
    named = Messages(config.frame_ids)
    sent = (samples.IMU, samples.POSITION, samples.VELOCITY, samples.HEADING, samples.JOINTS)
    messages = [sensed(named, sample)[1] for sample in (*sent, samples.CAMERA_ATTITUDE)]
    without = ("position", "velocity", "clock", "diagnostics", "answer")  # given there, or none
    makers = {
        name: make for name, (_, make) in samples.EVERY_MESSAGE.items() if name not in without
    }
    messages += [make(named) for make in makers.values()]
    messages += [named.tf(named.fixed_transforms(AIRCRAFT, 0))]
    result = set().union(*map(ids_of, messages))
    assert result == {
        *("uav1/field", "uav1/body", "uav1/eye", "uav1/imu_link", "uav1/gimbal_pivot"),
        *("uav1/rtk_antenna", "uav1/second_antenna", "uav1/gps_antenna"),
    }
    assert named.odometry(samples.SOLUTION, samples.BODY).child_frame_id == "uav1/body"
    assert named.image(0, np.zeros((2, 2), np.uint8)).header.frame_id == "uav1/eye"
