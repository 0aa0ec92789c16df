"""Filled areas, pixel by pixel: is the place on the ground where its ray ends in the polygon?"""

import cv2
import numpy as np
import pytest
from scenes import PLANE, camera_pose

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import View

FOLDING = Camera(640, 512, 400.0, 400.0, 319.5, 255.5, (-0.30, 0.0, 0.0, 0.0))
CAMERAS = {"xt2": XT2, "pinhole": Camera(640, 512, 500, 500, 319.5, 255.5), "folds": FOLDING}
EACH = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
#: Ink of a contour and rounding to 1/16 px: a pixel about an edge may be of either side.
EDGE = np.ones((5, 5), np.uint8)
FILL = LayerStyle(fill_bgr=(255, 0, 0))


def pose_at(height_m=20.0, pitch=-30.0, roll=0.0, yaw=0.0):
    return camera_pose([0.0, 0.0, -height_m], roll, pitch, yaw)


def map_of(*rings):
    """One feature; its rings (N, 2) are north, east on the plane."""
    features = [
        GeoFeature("", True, np.column_stack(PLANE.geodetic_from_ned(flat(ring))), group=0)
        for ring in rings
    ]
    return VectorMap.from_layers([MapLayer("", features, FILL)], PLANE)


def flat(ring):
    ring = np.asarray(ring, float)
    return np.column_stack([ring, np.zeros(len(ring))])


def filled(camera, vector_map, pose):
    image = np.zeros((camera.height, camera.width), np.uint8)
    view = View(camera)
    areas = view.areas(vector_map, pose)
    rings = [np.rint(ring * 16).astype(np.int32) for ring in areas.split()]
    if rings:
        cv2.fillPoly(image, rings, (255,), cv2.LINE_8, 4)
    if view.reached is not None:
        image &= view.reached
    return image


def wanted(camera, rings, pose):
    """(h, w) by the crossings of a ray along the ground from each pixel's place."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays_c = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]))
    rays_n = rays_c @ matrix_from_quat(pose.q_nc).T
    with np.errstate(invalid="ignore", divide="ignore"):
        north, east = (rays_n[:, :2] * (-pose.position_n[2] / rays_n[:, 2:])).T
        odd = np.zeros(len(north), bool)
        for ring in rings:
            ring = np.asarray(ring, float)  # noqa: PLW2901
            for (n0, e0), (n1, e1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                spans = (n0 > north) != (n1 > north)
                if n0 != n1:
                    odd ^= spans & (east < e0 + (north - n0) / (n1 - n0) * (e1 - e0))
        odd &= rays_n[:, 2] > 0
    return 255 * odd.reshape(columns.shape).astype(np.uint8)


def assert_filled_as_wanted(camera, rings, pose):
    got, want = filled(camera, map_of(*rings), pose), wanted(camera, rings, pose)
    inner = np.s_[2:-2, 2:-2]  # contours beside the image have ink in it
    assert not ((got > 0) & (cv2.dilate(want, EDGE) == 0))[inner].any()
    assert not ((want > 0) & (cv2.dilate(got, EDGE) == 0))[inner].any()
    return want


def ring_about(north, east, radius, corners=40, spread=0.0, seed=0):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    reach = radius * (1 + rng.uniform(-spread, spread, corners))
    return np.column_stack([north + reach * np.cos(angle), east + reach * np.sin(angle)])


@EACH
def test_a_polygon_in_the_image_with_a_hole(camera):
    rings = [ring_about(35, 0, 8), ring_about(35, 1, 3)]
    want = assert_filled_as_wanted(camera, rings, pose_at())
    assert 0.02 < (want > 0).mean() < 0.5


@EACH
def test_a_polygon_around_the_camera_fills_all_of_the_ground(camera):
    want = assert_filled_as_wanted(camera, [ring_about(0, 0, 5000)], pose_at(pitch=-60))
    assert (want > 0).sum() > 1e5


FOLDING_RATIONALLY = Camera(
    640, 512, 420.0, 420.0, 320.0, 256.0, (0.0, -0.1, 0.0, 0.0, 0.0, 0.2, 0.1, 0.0)
)
#: Rounding of ink at sharp corners may reach a pixel beyond ``EDGE``.
INK = np.ones((7, 7), np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [*CAMERAS.values(), FOLDING_RATIONALLY])
@pytest.mark.parametrize("seed", range(12))
def test_random_polygons(camera, seed):
    rng = np.random.default_rng(seed)
    north, east = rng.uniform(-30, 80), rng.uniform(-40, 40)
    outer = ring_about(north, east, rng.uniform(5, 80), 30, 0.5, seed)
    inner = ring_about(north, east, rng.uniform(1, 30), 12, 0.3, seed)
    pose = pose_at(
        rng.uniform(5, 60), rng.uniform(-90, 5), rng.normal(0, 15), rng.uniform(-90, 90)
    )
    got, want = filled(camera, map_of(outer, inner), pose), wanted(camera, [outer, inner], pose)
    inside = np.full(got.shape, 255, np.uint8)
    reached = View(camera).reached
    if reached is not None:
        # Of the rim two pixels are given up, and half of one to the polygon that stands for it.
        inside = cv2.erode(reached, EDGE)
    # Contours beside the image have ink in it.
    assert not ((got > 0) & (cv2.dilate(want, INK) == 0))[2:-2, 2:-2].any()
    assert not ((want > 0) & (inside > 0) & (cv2.dilate(got, EDGE) == 0))[2:-2, 2:-2].any()
