"""What is written on a picture: each by itself, and why none of the map is in it."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from overlays import GREY, LATENCY, MS, PLANE, SQUARE_N, START, geo, pose_at, ready
from scenes import camera_pose, graticule

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.map.visibility import why_absent
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.map_renderer import drape_layers
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import DrawingVerdict, PicturePainter
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
    drawing = PicturePainter(OverlayConfig(ground_height_m=25.0), [MapLayer("t", town(rng))], None)
    drawing.set_plane(PLANE)
    drawing.set_lens(camera, rectify=False)
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


def notice(features, pose=None, style=None):
    layer = MapLayer("m", features, style or LayerStyle())
    overlay = Overlay(OverlayConfig(ground_height_m=25.0), [layer])
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    overlay.add_pose(pose or pose_at(START))
    overlay.add_frame(START + LATENCY, GREY, START)
    result = overlay.take(START)
    assert result.pose is not None
    return result.notice


def looking(down_deg, yaw_deg=0.0):
    return camera_pose([0.0, 0.0, -20.0], 0.0, -down_deg, yaw_deg, 1e-4, START)


def at(latitude_deg, longitude_deg):
    return GeoFeature("", False, np.array([[*np.radians([latitude_deg, longitude_deg]), 25.0]]))


@pytest.mark.parametrize(
    ("features", "pose", "why"),
    [
        ([geo(SQUARE_N)], looking(-30), "the camera looks above the horizon"),
        ([geo(SQUARE_N)], looking(30, 180), "map 30 m away to the north; the camera looks south"),
        (
            [geo([[-210, 210, 0]])],
            None,
            "map 300 m away to the south-east; the camera looks north",
        ),
        ([geo([[5000, 10, 0]])], None, "map 5 km away to the north; it is drawn up to 1 km"),
        ([at(34.4, 114.3)], None, "map 430 km away to the north"),
        ([at(30.5, 108.3)], None, "map 580 km away to the west; is it UTM zone 50 instead of 49?"),
    ],
)
def test_why_none_of_it_is_in_view(features, pose, why):
    assert notice(features, pose) == f"NO MAP IN VIEW: {why}"


def test_no_layer_at_this_scale():
    """The middle is 40 m away, through a lens of 804 px: 5 cm, less what it bends."""
    why = notice([geo(SQUARE_N)], style=LayerStyle(scale_m_px=(0.5, 2.0)))
    assert why == "NO MAP IN VIEW: no layer is shown at this scale (4.9 cm a pixel)"


def test_a_map_beside_the_elevation_model_lies_on_no_ground():
    grid_of = graticule((40.0, 10.0), (1e-4, 1e-4), 3)
    elsewhere = Terrain(np.full((3, 3), 25.0), grid_of)
    laid = drape_layers([MapLayer("m", [geo(SQUARE_N)])], PLANE, elsewhere)
    why = why_absent(laid.map, PLANE, laid.first_n, XT2, pose_at(START), 1000.0)
    assert why == "none of the map lies on the elevation model"


def test_the_notice_stands_in_the_picture_and_the_verdict_above_it():
    overlay = ready([geo([[-210, 210, 0]])], ground_height_m=25.0)
    pictures = []
    for k, verdict in enumerate(
        (DrawingVerdict(), DrawingVerdict(Severity.STOP, "NO GO: gimbal"))
    ):
        overlay.verdict = verdict
        overlay.add_pose(pose_at(START + k * MS))
        overlay.add_frame(START + LATENCY + k * MS, GREY, START)
        pictures.append(overlay.take(START).image.astype(int))
    plain, told = (np.abs(image - [80, 200, 255]).max(axis=2) < 20 for image in pictures)
    assert plain[:30].sum() > 100  # letters
    red = np.abs(pictures[1] - [60, 140, 255]).max(axis=2) < 20
    assert red[:30].sum() > 30  # the verdict has the first line
    assert told[:20].sum() == 0 < told[20:60].sum()
    assert red[480:].sum() > 10  # and leads the status line
