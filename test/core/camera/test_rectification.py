"""The picture without distortion: straight lines are straight, the blank border is marked."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.camera.rectification import Rectifier
from tirgeo_ros.core.types.errors import CameraError

BARREL = Camera(640, 512, 500.0, 505.0, 310.0, 260.0, (-0.28, 0.07, 0.001, -0.002))
RATIONAL = Camera(640, 512, 620.0, 622.0, 322.0, 250.0, (0.3, 0.1, 0, 0, 0.01, 0.2, 0.02, 0))
LENSES = [XT2, BARREL, RATIONAL]
GREY = np.full((512, 640, 3), 90, np.uint8)


def blank_of(camera):
    """Pixels of the straight picture whose place in the camera's picture lies outside it."""
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1
    )
    uv, valid = camera.project(rays.reshape(-1, 3))
    seen = valid & (uv >= -0.5).all(axis=1)
    seen &= (uv <= [camera.width - 0.5, camera.height - 0.5]).all(axis=1)
    return ~seen.reshape(v.shape)


def test_a_camera_of_too_many_pixels_is_refused():
    with pytest.raises(CameraError, match="16384x16384 pixels are too many to rectify"):
        Rectifier(Camera(16384, 16384, 9e3, 9e3, 8e3, 8e3))


@pytest.mark.parametrize("camera", LENSES)
def test_a_dot_comes_to_its_straight_place(camera):
    """Of a blob's brightness, the centre: a tenth of a pixel is what 8 bits and 1/32 px leave."""
    rectifier = Rectifier(camera)
    for u, v in [(100.0, 80.0), (550.0, 100.0), (320.0, 256.0), (90.0, 430.0), (500.0, 400.0)]:
        rows, columns = np.indices((512, 640))
        blob = 200 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 3.0**2))
        image = cv2.merge([np.rint(blob).astype(np.uint8)] * 3)
        found = rectifier.rectified(image)[..., 0].astype(float)
        found[blank_of(camera)] = 0
        centre = np.array([(found * columns).sum(), (found * rows).sum()]) / found.sum()
        uv, _ = rectifier.camera.project(camera.rays(np.array([[u, v]])))
        np.testing.assert_allclose(centre, uv[0], atol=0.1)


@pytest.mark.parametrize("camera", LENSES)
def test_the_border_is_marked_where_there_is_no_picture_and_nowhere_else(camera):
    straight = Rectifier(camera).rectified(GREY)
    np.testing.assert_array_equal((straight != 90).any(axis=2), blank_of(camera))
