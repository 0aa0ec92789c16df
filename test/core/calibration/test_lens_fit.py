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
"""Lenses from corners with known errors, and a board's pose: truth, sigmas, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dev.checkerboards import calibration_poses, gimbal_pose
from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    BoardTracker,
    Checkerboard,
    RefusalReason,
    board_poses,
    camera_angles,
)
from tirgeo_ros.core.calibration.lens_fit import (
    doubtful_views,
    fit_lens,
    most_distinct,
)
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.types.errors import CalibrationError

BOARD = Checkerboard(9, 6, 0.1)
SIZE = XT2.width, XT2.height
TRUTH = np.array([XT2.fx, XT2.fy, XT2.cx, XT2.cy, *XT2.distortion])


def sighting(uv, blur_px=1.0):
    return BoardSighting(uv, 0.05, np.full(2, blur_px))


def views_of(count, seed, sigma_px=0.05, camera=XT2, tilt_deg=45.0):
    rng = np.random.default_rng(seed)
    made = {}
    for rotation, position in calibration_poses(camera, BOARD, count, rng, tilt_deg):
        uv = camera.project(BOARD.points_m @ rotation.T + position)[0]
        made[f"v{len(made)}"] = sighting(uv + rng.normal(0, sigma_px, uv.shape))
    return made


def test_exact_corners_give_the_exact_lens():
    fit = fit_lens(views_of(10, 1, sigma_px=0.0), BOARD, SIZE)
    # OpenCV takes corners in single precision: 3e-5 px at 640.
    assert fit.values == pytest.approx(TRUTH, rel=1e-4, abs=1e-4)
    assert fit.rms_px < 1e-4
    assert fit.camera.distortion == tuple(fit.values[4:])


def test_views_that_do_not_fit_are_refused_with_the_reason():
    views = views_of(14, 2)
    bent = views["v3"].corners_px.copy()
    bent[:, 1] += 3.0 * np.sin(bent[:, 0] / 60)  # a board that is not flat
    views["v3"] = sighting(bent)
    views["v7"] = sighting(views["v7"].corners_px * [1.0, 1.04])  # a board of other squares
    fit = fit_lens(views, BOARD, SIZE)
    assert set(fit.refused) == {"v3", "v7"}
    assert {refused.reason for refused in fit.refused.values()} == {RefusalReason.OUTLIER}
    assert np.abs((fit.values - TRUTH) / fit.sigma).max() < 4


def test_k3_is_estimated_on_request():
    with_k3 = replace(XT2, distortion=(-0.30, 0.20, 0.001, -0.002, -0.15))
    fit = fit_lens(views_of(25, 4, camera=with_k3), BOARD, SIZE, with_k3=True)
    assert fit.names[-1] == "k3"
    assert np.abs((fit.values[4:] - with_k3.distortion) / fit.sigma[4:]).max() < 4


@pytest.mark.parametrize(
    ("count", "tilt_deg", "message"),
    [
        (3, 45.0, "3 usable views are left; at least 4 are needed"),
        (8, 2.0, "tilt the board by 20 to 45 deg"),
    ],
)
def test_views_that_do_not_determine_a_lens_are_refused(count, tilt_deg, message):
    with pytest.raises(CalibrationError, match=message):
        fit_lens(views_of(count, 1, tilt_deg=tilt_deg), BOARD, SIZE)


def test_of_like_views_the_sharpest_stays():
    views = views_of(4, 6)
    again = views["v1"].corners_px[::-1] + 0.5  # counted from the other end
    views["again"] = replace(views["v1"], corners_px=again, sigma_px=0.01)
    refused = doubtful_views(views, 640)
    assert set(refused) == {"v1"}
    assert refused["v1"].reason is RefusalReason.DUPLICATE


def test_a_view_that_is_blurred_beside_the_others_is_refused():
    views = views_of(5, 7)
    views["v2"] = replace(views["v2"], blur_px=np.array([1.0, 2.2]))
    refused = doubtful_views(views, 640)
    assert {name: why.reason for name, why in refused.items()} == {"v2": RefusalReason.BLURRED}
    assert doubtful_views({}, 640) == {}


def test_the_most_different_views_are_chosen():
    views = views_of(6, 8)
    crowd = {
        f"c{i}": replace(views["v0"], corners_px=views["v0"].corners_px + 4.0 * i)
        for i in range(5)
    }
    chosen = most_distinct(views | crowd, 6)
    assert len(chosen) == 6
    assert len([name for name in chosen if name.startswith("c") or name == "v0"]) <= 2


def observed(board, angles_deg, distance_m=2.2, sigma_px=0.0, rng=None, turned=False):
    rotation, position = gimbal_pose(board, np.radians(angles_deg), distance_m, 0.7)
    uv = XT2.project(board.points_m @ rotation.T + position)[0]
    if rng is not None:
        uv = uv + rng.normal(0, sigma_px, uv.shape)
    return BoardSighting(uv[::-1] if turned else uv, sigma_px, np.ones(2))


@pytest.mark.parametrize(
    "angles_deg", [(0, 0, 0), (0.3, -0.5, 14), (-2, 3, -20), (10, -20, 5), (0, 15, 0)]
)
def test_exact_corners_give_the_exact_angles(angles_deg):
    pose = BoardTracker(BOARD, XT2).pose(observed(BOARD, angles_deg))
    assert np.degrees(camera_angles(pose)[0]) == pytest.approx(np.array(angles_deg), abs=1e-4)


def test_angles_over_sigmas_are_those_of_a_normal_distribution():
    rng = np.random.default_rng(2)
    z = []
    for _ in range(60):
        angles = rng.normal(0, [0.3, 0.5, 14.0])
        pose = BoardTracker(BOARD, XT2).pose(observed(BOARD, angles, sigma_px=0.1, rng=rng))
        result, sigma = camera_angles(pose)
        z.append((result - np.radians(angles)) / sigma)
    # 60 squares an axis: 1 +- 0.18 of a mean square, at three of these.
    assert (np.array(z) ** 2).mean(0) == pytest.approx(np.ones(3), abs=0.55)


@pytest.mark.parametrize("size", [(9, 6), (8, 6), (7, 7)])
def test_the_end_that_is_counted_from_does_not_matter(size):
    board = Checkerboard(*size, 0.1)
    tracker, rng = BoardTracker(board, XT2), np.random.default_rng(3)
    for number in range(20):
        angles = np.array([0.3, -0.5, 10.0 * np.sin(number)])
        turned = number > 0 and bool(rng.integers(2))
        result, _ = camera_angles(tracker.pose(observed(board, angles, turned=turned)))
        assert np.degrees(result) == pytest.approx(angles, abs=1e-3)


def test_an_upright_frame_is_made_of_a_board_that_lies_on_its_side():
    board = Checkerboard(6, 9, 0.1)
    for number in range(3):
        sighting = observed(board, (90.0 - 180.0 * (number == 1), 0, 0))
        result, _ = camera_angles(BoardTracker(board, XT2).pose(sighting))
        assert np.degrees(result) == pytest.approx([0, 0, 0], abs=1e-3)


def test_a_plane_has_two_poses_and_the_tracker_keeps_one():
    board, rng = Checkerboard(4, 3, 0.05), np.random.default_rng(4)
    tracker = BoardTracker(board, XT2)
    tracker.pose(observed(board, (0, 12, 0), 2.0))  # without noise: the right one
    second = 0
    for _ in range(40):
        noisy = observed(board, (0, 12, 0), 2.0, 0.25, rng)
        second += np.degrees(camera_angles(board_poses(noisy, board, XT2)[0])[0][1]) < 0
        assert np.degrees(camera_angles(tracker.pose(noisy))[0][1]) > 0
    assert second > 0  # the smaller error alone would have taken the mirrored one


def test_a_board_that_is_not_there_has_no_pose():
    board = Checkerboard(4, 3, 0.05)
    flat = BoardSighting(np.zeros((12, 2)), 0.1, np.ones(2))
    assert BoardTracker(board, XT2).pose(flat) is None
