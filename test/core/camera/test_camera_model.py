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
"""The camera against OpenCV's projection, its inverse, its limits, and rectified pictures."""

import contextlib
import math

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.overlay.picture_painter import Rectifier
from tirgeo_ros.core.types.errors import CameraError

BROWN = (-0.28, 0.09, 0.001, -0.0005)
BROWN5 = (-0.31, 0.12, 0.0004, 0.0006, -0.02)
RATIONAL = (0.9, 0.3, 0.0006, -0.0004, 0.01, 1.25, 0.55, 0.06)
FOLDING = (-0.30, 0.0, 0.0, 0.0)  # 1 - 0.9 r^2 = 0 at r = 1.0541
CAMERAS = [
    Camera(640, 512, 800.0, 790.0, 320.0, 255.0),
    XT2,
    Camera(640, 512, 420.0, 425.0, 318.0, 250.0, BROWN),
    Camera(800, 600, 600.0, 605.0, 390.0, 310.0, BROWN5),
    Camera(1280, 720, 600.0, 601.0, 640.0, 350.0, RATIONAL),
]
EACH = pytest.mark.parametrize("camera", CAMERAS, ids=["pinhole", "xt2", "k2", "k3", "rational"])
# A pixel coordinate near 1e3 in float64 is known to 1e-13; the sums add less than a hundred such.
PIXEL = 1e-9


def by_opencv(camera, points_c):
    distortion = np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0))
    zero = np.zeros(3)
    return cv2.projectPoints(points_c, zero, zero, camera.matrix, distortion)[0].reshape(-1, 2)


@EACH
@pytest.mark.parametrize("count", [1, 2, 3, 5000, 20_000])  # 3: a transpose would pass unseen
def test_projects_as_opencv(camera, count):
    rng = np.random.default_rng(count)
    depth = rng.uniform(0.5, 200.0, (count, 1))
    points_c = np.hstack([rng.uniform(-0.6, 0.6, (count, 2)) * depth, depth])
    uv, valid = camera.project(points_c)
    radius = np.hypot(points_c[:, 0], points_c[:, 1]) / points_c[:, 2]
    assert uv.shape == (count, 2)
    np.testing.assert_array_equal(valid, radius <= camera.max_radius)
    np.testing.assert_allclose(uv[valid], by_opencv(camera, points_c)[valid], rtol=0, atol=PIXEL)
    assert np.isnan(uv[~valid]).all()


@EACH
def test_rays_invert_the_projection_over_the_whole_image(camera):
    columns, rows = np.meshgrid(
        np.linspace(-0.5, camera.width - 0.5, 161), np.linspace(-0.5, camera.height - 0.5, 121)
    )
    uv = np.column_stack([columns.ravel(), rows.ravel()])
    rays = camera.rays(uv)
    assert (rays[:, 2] == 1.0).all()
    back, valid = camera.project(rays)
    assert valid.all()
    np.testing.assert_allclose(back, uv, rtol=0, atol=PIXEL)


@EACH
@given(u=st.floats(-1e9, 1e9), v=st.floats(-1e9, 1e9))
def test_a_ray_is_right_or_absent(camera, u, v):
    ray = camera.rays(np.array([[u, v]]))
    if np.isnan(ray).any():
        assert np.isnan(ray).all()
        assert not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5)
    else:
        back, valid = camera.project(ray)
        assert valid.all()
        np.testing.assert_allclose(back, [[u, v]], rtol=0, atol=PIXEL)


def test_the_fold_of_a_lens_is_its_limit():
    camera = Camera(640, 512, 400.0, 400.0, 319.5, 255.5, FOLDING)
    assert camera.max_radius == pytest.approx(0.98 / math.sqrt(0.9), rel=1e-12)
    radius = np.linspace(0, camera.max_radius, 200)
    uv, valid = camera.project(np.column_stack([radius, 0 * radius, 1 + 0 * radius]))
    assert valid.all()
    assert (np.diff(uv[:, 0]) > 0).all()
    beyond = np.array([[1.01 * camera.max_radius, 0.0, 1.0], [3.0, 0.0, 1.0]])
    assert not camera.project(beyond)[1].any()


@given(k=st.lists(st.floats(-2.0, 2.0), min_size=8, max_size=8), few=st.sampled_from([4, 5, 8]))
def test_the_distorted_radius_grows_up_to_the_limit(k, few):
    k = [*k[:2], 0.0, 0.0, *k[4:]][:few]
    with contextlib.suppress(CameraError):  # of a lens that folds within the image
        camera = Camera(640, 512, 500.0, 500.0, 319.5, 255.5, tuple(k))
        radius = np.linspace(0, camera.max_radius, 400)
        points = np.column_stack([radius, 0 * radius, 1 + 0 * radius])
        assert (np.diff(by_opencv(camera, points)[:, 0]) > 0).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((640, 512, 0.0, 800.0, 320, 256), "focal lengths 0, 800 must be positive"),
        ((640, 512, 800.0, -1.0, 320, 256), "must be positive"),
        ((0, 512, 800.0, 800.0, 320, 256), "size 0x512"),
        ((640, 512, math.nan, 800.0, 320, 256), "not finite"),
        ((640, 512, 800.0, 800.0, 320, 256, (0.1, math.inf, 0.0, 0.0)), "not finite"),
        ((640, 512, 800.0, 800.0, 320, 256, (0.1, 0.1)), "2 distortion coefficients"),
        ((640, 512, 800.0, 800.0, 320, 256, (0.0,) * 14), "14 distortion coefficients"),
        ((640, 512, 800.0, 800.0, 320, 256, (-9.0, 0.0, 0.0, 0.0)), "folds 103 px"),
        ((640, 512, 800.0, 800.0, 320, 256, (-1e308, 0.0, 0.0, 0.0)), "impossible values"),
        ((640, 512, 800.0, 800.0, 1e12, 256), "impossible values"),
        ((640, 512, 800.0, 800.0, 320, 256, (1e5, 0.0, 0.0, 0.0)), "too steep to be inverted"),
        ((640, 512, 1e-9, 800.0, 320, 256), "folds 0 px"),
    ],
)
def test_a_wrong_calibration_is_refused(arguments, message):
    with pytest.raises(CameraError, match=message):
        Camera(*arguments)


BARREL = Camera(640, 512, 500.0, 505.0, 310.0, 260.0, (-0.28, 0.07, 0.001, -0.002))
EIGHT_TERMS = Camera(640, 512, 620.0, 622.0, 322.0, 250.0, (0.3, 0.1, 0, 0, 0.01, 0.2, 0.02, 0))
LENSES = [XT2, BARREL, EIGHT_TERMS]
GREY = np.full((512, 640, 3), 90, np.uint8)


def blank_of(camera):
    """Return which rectified pixels come from outside the camera's picture, (h, w)."""
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1
    )
    uv, valid = camera.project(rays.reshape(-1, 3))
    observed = valid & (uv >= -0.5).all(axis=1)
    observed &= (uv <= [camera.width - 0.5, camera.height - 0.5]).all(axis=1)
    return ~observed.reshape(v.shape)


def test_a_camera_of_too_many_pixels_is_refused():
    with pytest.raises(CameraError, match="16384x16384 pixels are too many to rectify"):
        Rectifier(Camera(16384, 16384, 9e3, 9e3, 8e3, 8e3))


@pytest.mark.parametrize("camera", LENSES)
def test_a_dot_moves_to_its_rectified_place(camera):
    """The centre of a blob's brightness is right to 0.1 px, which 8 bits and 1/32 px allow."""
    rectifier = Rectifier(camera)
    for u, v in [(100.0, 80.0), (550.0, 100.0), (320.0, 256.0), (90.0, 430.0), (500.0, 400.0)]:
        rows, columns = np.indices((512, 640))
        blob = 200 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 3.0**2))
        image = cv2.merge([np.rint(blob).astype(np.uint8)] * 3)
        result = rectifier.rectified(image)[..., 0].astype(float)
        result[blank_of(camera)] = 0
        centre = np.array([(result * columns).sum(), (result * rows).sum()]) / result.sum()
        uv, _ = rectifier.camera.project(camera.rays(np.array([[u, v]])))
        np.testing.assert_allclose(centre, uv[0], atol=0.1)


@pytest.mark.parametrize("camera", LENSES)
def test_the_border_is_marked_where_there_is_no_picture_and_nowhere_else(camera):
    straight = Rectifier(camera).rectified(GREY)
    np.testing.assert_array_equal((straight != 90).any(axis=2), blank_of(camera))
