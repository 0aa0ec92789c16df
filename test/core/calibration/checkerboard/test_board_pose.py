"""A board's pose over a video: truth, sigma, half turns and the plane's second pose."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.calibration.checkerboard.board import BoardSighting, Checkerboard
from tirgeo_ros.core.calibration.checkerboard.board_pose import (
    BoardTracker,
    board_poses,
    camera_angles,
)
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.tools.simulate.board import gimbal_pose


def seen(board, angles_deg, distance_m=2.2, sigma_px=0.0, rng=None, turned=False):
    rotation, position = gimbal_pose(board, np.radians(angles_deg), distance_m, 0.7)
    uv = XT2.project(board.points_m @ rotation.T + position)[0]
    if rng is not None:
        uv = uv + rng.normal(0, sigma_px, uv.shape)
    return BoardSighting(uv[::-1] if turned else uv, sigma_px, np.ones(2))


@pytest.mark.parametrize(
    "angles_deg", [(0, 0, 0), (0.3, -0.5, 14), (-2, 3, -20), (10, -20, 5), (0, 15, 0)]
)
def test_exact_corners_give_the_exact_angles(angles_deg):
    board = Checkerboard(9, 6, 0.1)
    pose = BoardTracker(board, XT2).pose(seen(board, angles_deg))
    assert np.degrees(camera_angles(pose)[0]) == pytest.approx(np.array(angles_deg), abs=1e-4)


def test_angles_over_sigmas_are_those_of_a_normal_distribution():
    board, rng = Checkerboard(9, 6, 0.1), np.random.default_rng(2)
    z = []
    for _ in range(60):
        angles = rng.normal(0, [0.3, 0.5, 14.0])
        pose = BoardTracker(board, XT2).pose(seen(board, angles, sigma_px=0.1, rng=rng))
        found, sigma = camera_angles(pose)
        z.append((found - np.radians(angles)) / sigma)
    # 60 squares an axis: 1 +- 0.18 of a mean square, at three of these.
    assert (np.array(z) ** 2).mean(0) == pytest.approx(np.ones(3), abs=0.55)


@pytest.mark.parametrize("size", [(9, 6), (8, 6), (7, 7)])
def test_the_end_that_is_counted_from_does_not_matter(size):
    board = Checkerboard(*size, 0.1)
    tracker, rng = BoardTracker(board, XT2), np.random.default_rng(3)
    for number in range(20):
        angles = np.array([0.3, -0.5, 10.0 * np.sin(number)])
        turned = number > 0 and bool(rng.integers(2))
        found, _ = camera_angles(tracker.pose(seen(board, angles, turned=turned)))
        assert np.degrees(found) == pytest.approx(angles, abs=1e-3)


def test_an_upright_frame_is_made_of_a_board_that_lies_on_its_side():
    board = Checkerboard(6, 9, 0.1)
    for number in range(3):
        sighting = seen(board, (90.0 - 180.0 * (number == 1), 0, 0))
        found, _ = camera_angles(BoardTracker(board, XT2).pose(sighting))
        assert np.degrees(found) == pytest.approx([0, 0, 0], abs=1e-3)


def test_a_plane_has_two_poses_and_the_track_keeps_to_one():
    board, rng = Checkerboard(4, 3, 0.05), np.random.default_rng(4)
    tracker = BoardTracker(board, XT2)
    tracker.pose(seen(board, (0, 12, 0), 2.0))  # without noise: the right one
    second = 0
    for _ in range(40):
        noisy = seen(board, (0, 12, 0), 2.0, 0.25, rng)
        second += np.degrees(camera_angles(board_poses(noisy, board, XT2)[0])[0][1]) < 0
        assert np.degrees(camera_angles(tracker.pose(noisy))[0][1]) > 0
    assert second > 0  # the smaller error alone would have taken the mirrored one


def test_a_board_that_is_not_there_has_no_pose():
    board = Checkerboard(4, 3, 0.05)
    flat = BoardSighting(np.zeros((12, 2)), 0.1, np.ones(2))
    assert BoardTracker(board, XT2).pose(flat) is None
