"""What a view returns of a map: marks, places on the map, how far, and in how much detail."""

import cv2
import numpy as np
import pytest
from scenes import camera_pose, map_of

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.visibility import FAR_M, View

PINHOLE = Camera(640, 512, 500.0, 500.0, 319.5, 255.5)


def pose_at(position_n=(0, 0, -20), roll=0.0, pitch=-30.0, yaw=0.0):
    return camera_pose(position_n, roll, pitch, yaw)


def test_marks_are_projected_points_of_the_image():
    pose = pose_at()
    points = [[35, 0, 0], [40, 3, 0], [35, 100, 0], [-20, 0, 0]]
    vector_map = map_of(*[[point] for point in points])
    marks = View(XT2).marks(vector_map, pose)
    wanted, _ = XT2.project(
        (np.array(points[:2], float) - pose.position_n) @ matrix_from_quat(pose.q_nc)
    )
    assert marks.owner.tolist() == [0, 1]
    np.testing.assert_allclose(np.concatenate(marks.split()), wanted, atol=1e-6)


@pytest.mark.parametrize("camera", [PINHOLE, XT2])
def test_what_is_seen_knows_its_place_on_the_map(camera):
    rng = np.random.default_rng(5)
    line = np.column_stack([rng.uniform(-50, 200, 40), rng.uniform(-80, 80, 40), np.zeros(40)])
    pose = pose_at(pitch=-20, roll=5)
    seen = View(camera).lines(map_of(line, [[35, 0, 0]]), pose)
    x, y, nearness = seen.rays
    points_c = np.stack([x, y, np.ones_like(x)]) / nearness
    points_n = matrix_from_quat(pose.q_nc) @ points_c + pose.position_n[:, None]
    assert points_n.shape == (3, seen.points.shape[1])
    uv, valid = camera.project((points_n.T - pose.position_n) @ matrix_from_quat(pose.q_nc))
    assert valid.mean() > 0.9  # but those cut at a limit itself
    np.testing.assert_allclose(uv[valid], seen.points.T[valid], atol=1e-6)
    # A tangent plane point at 200 m comes back to 1e-7 m; times 200 / 20 of slant.
    np.testing.assert_allclose(points_n[2], 0.0, atol=1e-5)


def test_ground_ends_sixteen_rows_under_the_horizon():
    """By what the camera itself projects: a point at the farthest, as high as the ground."""
    view = View(XT2)
    for height_m in (20.0, 100.0, 250.0):
        far_m = view.farthest_m(height_m)
        near_axis = Camera(640, 512, XT2.fx, XT2.fy, XT2.cx, XT2.cy)
        uv, _ = near_axis.project(np.array([[0.0, height_m, far_m], [0.0, 0.0, far_m]]))
        assert uv[0, 1] - uv[1, 1] == pytest.approx(16.0)
    assert view.farthest_m(1000.0) == FAR_M
    for unknown in (np.nan, 0.0, -3.0):
        assert view.farthest_m(unknown) == FAR_M


def test_a_crowd_is_drawn_with_few_vertices_and_the_same_ink():
    """Ten thousand small outlines, most of them far off, against all of their vertices."""
    rng = np.random.default_rng(6)
    corners = 4.0 * np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]])
    places = rng.uniform([100, -1500, 0], [4000, 1500, 0], (10_000, 3))
    vector_map = map_of(*(place + corners for place in places))
    pose = pose_at((0, 0, -120), pitch=-5)
    seen = View(PINHOLE).lines(vector_map, pose)
    assert seen.points.shape[1] < 0.4 * vector_map.lines.points.shape[1]
    middle = corners[:4].mean(axis=0)
    truth, valid = PINHOLE.project(
        (places + middle - pose.position_n) @ matrix_from_quat(pose.q_nc)
    )
    truth = truth[valid]
    truth = truth[View(PINHOLE).inside(truth.T)]
    drawn = np.zeros((PINHOLE.height, PINHOLE.width), np.uint8)
    runs = [np.rint(run * 16).astype(np.int32) for run in seen.split()]
    cv2.polylines(drawn, runs, False, (255,), 1, cv2.LINE_AA, 4)
    off = cv2.distanceTransform((drawn == 0).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.floor(truth.T + 0.5).astype(int)
    # From 800 m on an outline's middle is at most 2 px from its ink, which may be off by 2 px and
    # be that of another one in its dot of 4 px.
    far = (-pose.position_n[2] * 500 / np.maximum(row - 212, 1)) > 800
    assert far.sum() > 3000
    assert off[row, column][far].max() < 2.0 + 2.0 + 4.0
