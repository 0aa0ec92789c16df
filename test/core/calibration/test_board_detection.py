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
"""Boards of either polarity in thermal pictures, refusals, and the accuracy of the corners."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from dev.checkerboards import (
    BoardLook,
    BoardRenderer,
    board_views,
    calibration_poses,
)
from tirgeo_ros.core.calibration.board_detection import find_board, fit_corners
from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
    board_of,
    steps_of,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import rotation_x, rotation_y, rotation_z
from tirgeo_ros.core.types.errors import CalibrationError

SEED = 90


BOARD = Checkerboard(9, 6, 0.1)
LOOK = BoardLook()
W, H = XT2.width, XT2.height
FAR = BOARD.columns * BOARD.square_m * XT2.fx / (0.6 * W)  # the board fills six tenths


def placed(u, v, depth, turn=None, board=BOARD):
    """Return a pose with the board's middle at a pixel."""
    turn = np.eye(3) if turn is None else turn
    return turn, XT2.rays(np.array([[u, v]]))[0] * depth - turn @ board.points_m.mean(0)


def drawn():
    """Return pictures of boards that must be refused, by name."""
    rng = np.random.default_rng(SEED)
    middle = placed(W / 2, H / 2, FAR, rotation_x(0.3))
    steep = rotation_y(math.radians(77)) @ rotation_z(0.1)
    larger = Checkerboard(10, 7, 0.1)
    scenes = {
        "half out to the left": (placed(40, H / 2, FAR), LOOK),
        "a quarter in": (placed(W - 60, 60, FAR), LOOK),
        "moved askew": (middle, replace(LOOK, motion_px=(15.0, 15.0))),
        "out of focus": (middle, replace(LOOK, blur_px=7.0)),
        "no contrast": (middle, replace(LOOK, foil=LOOK.board, unevenness=0.0)),
        "drowned in noise": (middle, replace(LOOK, noise=60.0)),
        "far away": (placed(W / 2, H / 2, 8 * FAR), LOOK),
        "from the side": (placed(W / 2, H / 2, 0.8 * FAR, steep), LOOK),
        "overexposed": (middle, replace(LOOK, board=420.0, foil=395.0, wall=400.0)),
    }
    images = {
        name: renderer().view(*pose, look, rng).image for name, (pose, look) in scenes.items()
    }
    pose = placed(W / 2, H / 2, FAR, board=larger)
    return images | {"larger board": BoardRenderer(XT2, larger).view(*pose, LOOK, rng).image}


def spoilt():
    """Return pictures of covered boards and of other things, by name."""
    rng = np.random.default_rng(SEED + 1)
    turn = rotation_y(0.3) @ rotation_z(0.1)
    good = renderer().view(*placed(W / 2, H / 2, FAR, turn), LOOK, rng)
    other = renderer().view(*placed(W / 2 + 14, H / 2 + 9, FAR, turn), LOOK, rng)
    finger, torn = good.image.copy(), good.image.copy()
    cv2.circle(finger, good.corners_px[0].astype(int).tolist(), 14, good.image.mean() * 1.4, -1)
    row = int(good.corners_px[:, 1].mean())
    torn[row:] = np.roll(torn[row:], 6, axis=1)
    facade = np.clip(rng.normal(105, 2, (H, W)), 0, 255).astype(np.uint8)
    for x in range(20, W - 30, 45):
        for y in range(20, H - 30, 45):
            facade[y : y + 22, x : x + 22] = 135
    return {
        "a finger on one corner": finger,
        "two pictures in one": cv2.addWeighted(good.image, 0.5, other.image, 0.5, 0),
        "torn": torn,
        "windows of a house": facade,
    }


def off_px(sighting, truth):
    """Return the rms distance to the true corners, counted from either end."""
    return min(np.sqrt(((sighting.corners_px - c) ** 2).mean()) for c in (truth, truth[::-1]))


LOOKS = {
    "cold foil": LOOK,
    "warm foil": replace(LOOK, board=LOOK.foil, foil=LOOK.board),
    "faint, one grey value of noise": replace(
        LOOK, foil=LOOK.board - 9, unevenness=1.0, noise=1.0
    ),
    "noisy": replace(LOOK, noise=4.0),
    "out of focus": replace(LOOK, blur_px=2.0),
    "vignette": replace(LOOK, vignetting=0.5),
    "from warm to cold": replace(LOOK, gradient=30.0),
    "16 bit": replace(LOOK, bits=16),
}


@pytest.mark.slow
@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_boards_of_every_appearance_are_found(look):
    for view in board_views(XT2, BOARD, 2, 7, look):
        sighting = find_board(view.image, BOARD)
        assert isinstance(sighting, BoardSighting), sighting
        assert off_px(sighting, view.corners_px) < 3.5 * sighting.sigma_px
        assert sighting.sigma_px < 0.15


def test_a_hot_spot_does_not_hide_a_16_bit_board():
    view = board_views(XT2, BOARD, 1, 7, replace(LOOK, bits=16))[0]
    image = view.image.copy()
    image[5:80, 5:80] = 60000
    assert off_px(find_board(image, BOARD), view.corners_px) < 0.1


def test_a_large_picture_is_reduced_for_detection_and_fitted_in_full():
    camera = Camera(1400, 1120, 1750.0, 1750.0, 705.0, 552.0)
    view = board_views(camera, BOARD, 1, 7, parts=1)[0]
    sighting = find_board(view.image, BOARD)
    assert isinstance(sighting, BoardSighting), sighting
    assert off_px(sighting, view.corners_px) < 3.5 * sighting.sigma_px


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6), (4, 3)])
@pytest.mark.parametrize("turn", [0.1, 3.1])
def test_the_order_is_right_handed(columns, rows, turn):
    board = Checkerboard(columns, rows, 0.1)
    rotation = rotation_z(turn)
    position = np.array([0, 0, 2.2]) - rotation @ board.points_m.mean(0)
    rng = np.random.default_rng(3)
    view = BoardRenderer(XT2, board).view(rotation, position, LOOK, rng)
    sighting = find_board(view.image, board)
    assert isinstance(sighting, BoardSighting), sighting
    grid = sighting.corners_px.reshape(rows, columns, 2)
    along, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    assert along[0] * down[1] - along[1] * down[0] > 0


EXPECTED = {
    "half out to the left": RefusalReason.PARTIAL,
    "larger board": RefusalReason.OTHER_BOARD,
    "out of focus": RefusalReason.BLURRED,
    "overexposed": RefusalReason.NO_BOARD,
    "a finger on one corner": RefusalReason.COVERED,
    "torn": RefusalReason.UNEVEN,
    "windows of a house": RefusalReason.NO_BOARD,
}


@pytest.mark.slow
def test_no_bad_picture_is_taken_and_reasons_are_right():
    results = {name: find_board(image, BOARD) for name, image in (drawn() | spoilt()).items()}
    assert [name for name, item in results.items() if not isinstance(item, Refused)] == []
    assert {name: results[name].reason for name in EXPECTED} == EXPECTED


def test_a_moderate_motion_is_a_blur():
    look = replace(LOOK, motion_px=(10.0, 0.0))
    position = np.array([0, 0, 2.0]) - BOARD.points_m.mean(0)
    view = BoardRenderer(XT2, BOARD).view(np.eye(3), position, look, np.random.default_rng(5))
    refused = find_board(view.image, BOARD)
    assert isinstance(refused, Refused)
    assert refused.reason is RefusalReason.BLURRED, refused


@pytest.mark.parametrize(
    "image", [np.zeros((512, 640), np.uint8), np.full((64, 80), 9, np.uint16)]
)
def test_empty_pictures_show_no_board(image):
    refused = find_board(image, BOARD)
    assert isinstance(refused, Refused)
    assert refused.reason is RefusalReason.NO_BOARD


@pytest.mark.parametrize(
    ("text", "square", "message"),
    [
        ("9x-6", 0.1, "give inner corners as COLUMNSxROWS"),
        ("9x2", 0.1, "it needs 3 to 100 inner corners"),
        ("9x6", float("nan"), "its side must be positive"),
    ],
)
def test_wrong_boards_are_refused(text, square, message):
    with pytest.raises(CalibrationError, match=message):
        board_of(text, square)


@cache
def renderer():
    return BoardRenderer(XT2, BOARD)


def view(look, seed=1, number=0):
    rng = np.random.default_rng(seed)
    poses = list(calibration_poses(XT2, BOARD, number + 1, rng))
    return renderer().view(*poses[number], look, rng)


def fitted(seen, off_px=0.7, seed=2):
    """Return the fit that starts at places as a detector gives them."""
    off = np.random.default_rng(seed).uniform(-off_px, off_px, seen.corners_px.shape)
    begun = seen.corners_px + off
    return fit_corners(seen.image.astype(np.float32), begun, steps_of(begun, BOARD))


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_errors_agree_with_the_covariance_of_the_fit(look):
    seen = view(look)
    fit = fitted(seen)
    errors = fit.uv - seen.corners_px
    chi2 = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(fit.covariance), errors)
    # 54 corners, 2 degrees of freedom each: the mean is 2 +- 0.27; 1 px is not told by the rest.
    assert 1.2 < chi2.mean() < 3.0
    assert np.isfinite(fit.uv).all()


def test_corners_are_better_than_opencvs_where_foil_is_uneven():
    seen = view(LOOK)
    start = seen.corners_px.astype(np.float32)[:, None].copy()
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    theirs = cv2.cornerSubPix(seen.image, start, (8, 8), (-1, -1), stop)[:, 0]
    ours = fitted(seen).uv

    def rms(uv):
        return np.sqrt(((uv - seen.corners_px) ** 2).mean())

    assert rms(ours) < 0.05  # of a coordinate: a tenth of the 0.5 px that a calibration may have
    assert rms(ours) < rms(theirs) / 2


@pytest.mark.parametrize("blur_px", [0.8, 1.3, 2.0])
def test_the_blur_is_found(blur_px):
    fit = fitted(view(replace(LOOK, blur_px=blur_px, noise=0.5)))
    expected = np.hypot(blur_px, 1 / np.sqrt(12))  # the optics' and the pixel's own width
    assert np.median(fit.blur_px) == pytest.approx(expected, rel=0.1)
