"""Located points in the picture: their ellipse where it says more than the mark."""

import numpy as np
import pytest
from camera_poses import camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.overlay.click_markers import PlacedMarkers
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.line_renderer import LineRenderer

CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
HEIGHT_M = 20.0  # 40 px to a metre, straight down
POSE = camera_pose([0.0, 0.0, -HEIGHT_M], covariance=1e-6)


def painted(sigma_m, point_n=(0.0, 0.0, 0.0)):
    image = np.full((512, 640, 3), 128, np.uint8)
    marker = Marker(np.array(point_n), "x", np.diag([sigma_m**2, sigma_m**2, 0.0]))
    placed = PlacedMarkers(image, CAMERA, POSE, [marker])
    placed.paint(image, LineRenderer())
    for box in placed.boxes:
        image[box.top : box.bottom, box.left : box.right] = 128
    v, u = np.nonzero((image != 128).any(axis=2))
    return np.hypot(u - 319.5, v - 255.5)


@pytest.mark.parametrize("sigma_m", [0.3, 1.0, 2.0])
def test_the_ellipse_holds_95_percent(sigma_m):
    # 2 px of ink and 1 px of halo on each side, both anti-aliased
    assert painted(sigma_m).max() == pytest.approx(2.4477 * sigma_m * 40, abs=4)


def test_an_ellipse_about_as_large_as_the_mark_is_not_drawn():
    """The mark's radius is 7 px, and the least ellipse 1.5 times that."""
    mark = painted(0.0)
    assert 6 < mark.max() < 12
    np.testing.assert_array_equal(painted(10.4 / 2.4477 / 40), mark)
    assert len(painted(10.6 / 2.4477 / 40)) > len(mark)
    np.testing.assert_array_equal(painted(np.nan), mark)


def test_a_point_out_of_the_picture_leaves_it_as_it_is():
    assert len(painted(0.3, point_n=(500.0, 0.0, 0.0))) == 0
