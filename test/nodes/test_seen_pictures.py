"""From where a picture was taken, and where a place is in it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from message_samples import CAMERA_POSE
from overlays import PLANE, SQUARE_N, pose_at

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, camera_pose
from tirgeo_ros.nodes.picture_sight import level_of, on_ground, pixel_of
from tirgeo_ros.nodes.pose_tape import PoseTape

CDR = Cdr()
TYPE = TOPIC_TYPES["tirgeo/camera_pose"]
MS = 1_000_000
SIGHT = Sight(XT2, pose_at(0), PLANE, 25.0)


@pytest.fixture
def tape():
    """Poses each 20 ms for a second; how many of them were decoded."""
    decoded = []

    def decode(data):
        decoded.append(data)
        return camera_pose(CDR.deserialize(data, TYPE))

    made = PoseTape(decode)
    for k in range(50):
        pose = dataclasses.replace(CAMERA_POSE, stamp_ns=10**18 + 20 * k * MS)
        made.add(CDR.serialize(Messages(CDR.types).camera_pose(pose), TYPE))
    return made, decoded


def test_poses_around_an_instant_alone_are_decoded(tape):
    made, decoded = tape
    found = made.around(10**18 + 410 * MS)
    assert found.at(10**18 + 410 * MS).stamp_ns == 10**18 + 410 * MS
    assert len(decoded) == 2
    found = made.around(10**18 + 410 * MS, before_s=0.1)
    assert found.at(10**18 + 310 * MS).stamp_ns == 10**18 + 310 * MS
    assert made.around(10**18 + 1000 * MS).at(10**18 + 1000 * MS) is Miss.TOO_NEW
    assert made.around(10**18 - MS).at(10**18 - MS) is Miss.TOO_OLD


def test_a_clock_that_goes_back_begins_anew(tape):
    made, _ = tape
    earlier = dataclasses.replace(CAMERA_POSE, stamp_ns=10**17)
    made.add(CDR.serialize(Messages(CDR.types).camera_pose(earlier), TYPE))
    assert made.around(10**17).at(10**17).stamp_ns == 10**17
    assert made.around(10**18).at(10**18) is Miss.TOO_NEW
    with pytest.raises(MessageError, match="too few for a header"):
        made.add(b"\0\1")


def test_a_place_is_found_where_the_camera_sees_it():
    corner_n = SQUARE_N[0]
    latitude, longitude, _ = PLANE.geodetic_from_ned(corner_n)
    point_n = on_ground(PLANE, SQUARE_N, float(latitude), float(longitude))
    np.testing.assert_allclose(point_n, corner_n, atol=1e-3)
    seen = (corner_n - SIGHT.pose.position_n)[None] @ matrix_from_quat(SIGHT.pose.q_nc)
    np.testing.assert_allclose(pixel_of(SIGHT, point_n), XT2.project(seen)[0][0], atol=0.05)
    assert pixel_of(SIGHT, corner_n * -1) is None  # behind the camera
    assert pixel_of(SIGHT, corner_n * [1, 9, 1]) is None  # beside the picture


def test_on_a_slope_the_place_lies_on_the_slope():
    slope_n = SQUARE_N.copy()
    slope_n[:, 2] = -0.2 * slope_n[:, 0]
    place = PLANE.geodetic_from_ned(np.array([36.0, 0.0, 0.0]))
    point_n = on_ground(PLANE, slope_n, float(place[0]), float(place[1]))
    np.testing.assert_allclose(point_n, [36.0, 0.0, -7.2], atol=1e-3)


def test_the_ground_is_known_where_it_is_level():
    assert level_of(SQUARE_N, PLANE) == pytest.approx(25.0, abs=0.01)
    slope_n = SQUARE_N.copy()
    slope_n[2:, 2] = 3.0
    assert math.isnan(level_of(slope_n, PLANE))
    assert math.isnan(level_of(np.empty((0, 3)), PLANE))
