"""What is written on a picture: labels, rose, scale bar, notices, status line, each by itself."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from overlays import PLANE, geo
from scenes import camera_pose

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.map_renderer import DrawingVerdict, MapRenderer
from tirgeo_ros.core.types.finding import Severity

POSES = 40
WORDS = "NO GO: height above ground at rest 47.3 m, should be 1 m: overlay_node ground_height_m"


def camera_of(width):
    part = width / XT2.width
    height = round(part * XT2.height)
    return Camera(width, height, part * XT2.fx, part * XT2.fy, part * XT2.cx, part * XT2.cy)


def town(rng):
    """Points, lines and outlines with names long and short, 200 m around."""
    names = ["N", "Hydrant 12", "Linde", "Sammelplatz an der alten Mühle", "7"]
    features = []
    for number in range(150):
        middle = np.append(rng.uniform(-100, 100, 2), 0.0)
        size = rng.uniform(2, 20)
        shapes = (
            [[0, 0, 0]],
            [[-size, 0, 0], [size, size, 0]],
            [[0, 0, 0], [size, 0, 0], [size, size, 0], [0, size, 0]],
        )
        features.append(geo(middle + np.array(shapes[number % 3], float), names[number % 5]))
    return features


def pose_of(rng):
    angles_deg = rng.uniform([-15, -90, 0], [15, -5, 360])
    place = np.append(rng.uniform(-80, 80, 2), -rng.uniform(10, 120))
    return camera_pose(place, *angles_deg, 1e-3)


def clicked(rng):
    points = np.column_stack([rng.uniform(-100, 100, (20, 2)), np.zeros(20)])
    return [Marker(point, f"30.500123 114.30012{k}", np.eye(3)) for k, point in enumerate(points)]


@pytest.mark.parametrize("width", [336, 640])
def test_nothing_that_is_written_meets_another(width):
    rng = np.random.default_rng(13)
    camera, labels = camera_of(width), 0
    drawing = MapRenderer(OverlayConfig(ground_height_m=25.0), [MapLayer("t", town(rng))], None)
    drawing.set_plane(PLANE)
    drawing.set_camera(camera)
    for number in range(POSES):
        image = np.full((camera.height, width, 3), 90, np.uint8)
        verdict = DrawingVerdict(Severity(number % 3), WORDS)
        drawn = drawing.draw(image, pose_of(rng), None, clicked(rng), verdict)
        for one, other in combinations(drawn.boxes, 2):
            assert not one.meets(other), (number, one, other)
        for box in drawn.boxes:
            assert 0 <= box.left < box.right <= width
            assert 0 <= box.top < box.bottom <= camera.height
        labels += len(drawn.boxes)
    assert labels > 8 * POSES  # or it has shown nothing
