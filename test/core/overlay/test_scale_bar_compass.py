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
"""The scale bar's length is true on the ground, and the needle points to north."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scenes import PLANE, camera_pose

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.ground.frame_geometry import Sight, camera_heading_rad
from tirgeo_ros.core.overlay.scale_bar_compass import (
    place_rose,
    scale_bar,
    seen_bar,
)
from tirgeo_ros.core.overlay.written_text import text_px

GREY = 128


def pose(height_m=40.0, yaw=0.0, down=60.0, roll=0.0):
    return camera_pose([3.0, -2.0, -height_m], roll, -down, yaw)


def ground_point(camera, at, uv):
    """Computed independently of the code: on the map's plane, flat over so few metres."""
    ray = matrix_from_quat(at.q_nc) @ camera.rays(np.array([uv]))[0]
    return at.position_n + ray * (-at.position_n[2] / ray[2])


@given(
    height_m=st.floats(5, 200),
    yaw=st.floats(0, 360),
    down=st.floats(40, 90),
    roll=st.floats(-10, 10),
)
def test_the_bar_is_as_long_on_the_ground_as_it_says(height_m, yaw, down, roll):
    at = pose(height_m, yaw, down, roll)
    bar = scale_bar(Sight(XT2, at, PLANE, 11.5), 12.0, 470.0)
    assert bar is not None
    ends = [ground_point(XT2, at, (u, bar.row)) for u in (bar.left, bar.right)]
    # Linear between 33 samples: of a lens that bends by 7 px in the picture, below 0.1 %.
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(bar.length_m, rel=1e-3)
    assert XT2.width * 0.06 <= bar.right - bar.left <= XT2.width * 0.25
    assert f"{bar.length_m:.0e}"[0] in "125"


def test_the_bar_is_true_far_from_the_maps_origin():
    """The earth is round and the code says it is flat: by less than 0.2 % here, 3 km away."""
    at = pose(100.0, yaw=40.0, down=35.0)
    at.position_n[:2] = 2000.0, -2200.0
    bar = scale_bar(Sight(XT2, at, PLANE, 0.0), 12.0, 470.0)
    ends, _ = locate(XT2, at, np.array([[bar.left, 470.0], [bar.right, 470.0]]), PLANE, 0.0)
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(bar.length_m, rel=2e-3)


def test_no_bar_where_no_ground_is_seen():
    assert scale_bar(Sight(XT2, pose(down=-40.0), PLANE, 11.5), 12.0, 470.0) is None  # the sky
    assert scale_bar(Sight(XT2, pose(), PLANE, math.nan), 12.0, 470.0) is None  # height unknown
    assert scale_bar(Sight(XT2, pose(), PLANE, 500.0), 12.0, 470.0) is None  # under the ground
    image = np.full((512, 640, 3), GREY, np.uint8)
    assert seen_bar(image, Sight(XT2, pose(down=-40.0), PLANE, 11.5)) is None


@given(yaw=st.floats(0, 359.9), down=st.floats(75, 105))
def test_the_heading_is_steady_through_straight_down(yaw, down):
    """Past it the picture's upper edge still looks the same way."""
    result = math.degrees(camera_heading_rad(pose(yaw=yaw, down=down)))
    if down <= 95:
        assert (result - yaw + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)
    assert 0 <= result < 360


@pytest.mark.parametrize("yaw", [0, 45, 90, 180, 270, 300])
@pytest.mark.parametrize("size", [(320, 256), (640, 512), (1280, 1024)])
def test_the_needle_points_to_north(yaw, size):
    image = np.full((size[1], size[0], 3), GREY, np.uint8)
    rose = place_rose(image, math.radians(yaw))
    rose.paint(image)
    box = rose.box
    changed = (image != GREY).any(axis=2)
    changed[box.top : box.bottom, box.left : box.right] = False
    assert not changed.any()
    half, size_px = (box.right - box.left) / 2, text_px(image)
    ink = np.argwhere((image > 200).all(axis=2))[:, ::-1] - [box.left + half, box.top + half]
    radius = np.hypot(*ink.T)
    letter = ink[(radius > 1.2 * size_px) & (radius < 2.25 * size_px)].mean(axis=0)
    for east, south in (letter, ink[radius < size_px].mean(axis=0) * [-1, -1]):
        bearing = math.degrees(math.atan2(east, -south))
        # A pixel, of the needle's middle which is the nearer one, or a tenth of the letter.
        assert (bearing + yaw + 180) % 360 - 180 == pytest.approx(0, abs=12)
