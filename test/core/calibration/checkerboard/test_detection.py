"""Boards in thermal pictures: found whatever their polarity, refused with the right reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_boards import bad_boards

from tirgeo_ros.core.calibration.checkerboard.board import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
    board_of,
)
from tirgeo_ros.core.calibration.checkerboard.detection import find_board
from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.tools.simulate.board import BoardLook, BoardRenderer, board_views

BOARD = Checkerboard(9, 6, 0.1)
LOOK = BoardLook()


def off_px(found, truth):
    """Root mean square from the true corners, counted from either end."""
    return min(np.sqrt(((found.corners_px - c) ** 2).mean()) for c in (truth, truth[::-1]))


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
def test_boards_are_found_whatever_they_look_like(look):
    for view in board_views(XT2, BOARD, 2, 7, look):
        found = find_board(view.image, BOARD)
        assert isinstance(found, BoardSighting), found
        assert off_px(found, view.corners_px) < 3.5 * found.sigma_px
        assert found.sigma_px < 0.15


def test_a_hot_spot_does_not_hide_a_16_bit_board():
    view = board_views(XT2, BOARD, 1, 7, replace(LOOK, bits=16))[0]
    image = view.image.copy()
    image[5:80, 5:80] = 60000
    assert off_px(find_board(image, BOARD), view.corners_px) < 0.1


def test_a_large_picture_is_searched_in_small_and_fitted_as_it_is():
    camera = Camera(1400, 1120, 1750.0, 1750.0, 705.0, 552.0)
    view = board_views(camera, BOARD, 1, 7, parts=1)[0]
    found = find_board(view.image, BOARD)
    assert isinstance(found, BoardSighting), found
    assert off_px(found, view.corners_px) < 3.5 * found.sigma_px


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6), (4, 3)])
@pytest.mark.parametrize("turn", [0.1, 3.1])
def test_the_order_is_right_handed(columns, rows, turn):
    board = Checkerboard(columns, rows, 0.1)
    rotation = rotation_z(turn)
    position = np.array([0, 0, 2.2]) - rotation @ board.points_m.mean(0)
    rng = np.random.default_rng(3)
    view = BoardRenderer(XT2, board).view(rotation, position, LOOK, rng)
    found = find_board(view.image, board)
    assert isinstance(found, BoardSighting), found
    grid = found.corners_px.reshape(rows, columns, 2)
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
def test_none_of_twenty_bad_pictures_is_taken_and_reasons_are_right():
    found = {name: find_board(image, BOARD) for name, image in bad_boards(XT2, BOARD).items()}
    assert len(found) == 20
    assert [name for name, one in found.items() if not isinstance(one, Refused)] == []
    assert {name: found[name].reason for name in EXPECTED} == EXPECTED


def test_a_moderate_motion_is_told_from_a_blur():
    look = replace(LOOK, motion_px=(10.0, 0.0))
    position = np.array([0, 0, 2.0]) - BOARD.points_m.mean(0)
    view = BoardRenderer(XT2, BOARD).view(np.eye(3), position, look, np.random.default_rng(5))
    found = find_board(view.image, BOARD)
    assert isinstance(found, Refused)
    assert found.reason is RefusalReason.SMEARED, found


@pytest.mark.parametrize(
    "image", [np.zeros((512, 640), np.uint8), np.full((64, 80), 9, np.uint16)]
)
def test_empty_pictures_show_no_board(image):
    found = find_board(image, BOARD)
    assert isinstance(found, Refused)
    assert found.reason is RefusalReason.NO_BOARD


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
