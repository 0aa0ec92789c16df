"""Twenty pictures that a calibration must refuse, each bad in its own way."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from tirgeo_ros.core.calibration.checkerboard import Checkerboard
from tirgeo_ros.core.frames.rotations import rotation_x, rotation_y, rotation_z
from tirgeo_ros.tools.simulate.boards import BoardLook, BoardRenderer

SEED = 90


def bad_boards(camera, board, look=None, seed=SEED):
    """Name to picture."""
    look = look or BoardLook()
    return dict(_drawn(camera, board, look, seed)) | dict(_spoilt(camera, board, look, seed))


def _place(camera, board, u, v, depth, turn=None):
    """A pose with the board's middle at a pixel."""
    turn = np.eye(3) if turn is None else turn
    middle = camera.rays(np.array([[u, v]]))[0] * depth
    return turn, middle - turn @ board.points_m.mean(0)


def _usual(camera, board):
    """Depth at which the board fills six tenths of the picture."""
    return max(board.columns, board.rows) * board.square_m * camera.fx / (0.6 * camera.width)


def _drawn(camera, board, look, seed):
    """Pictures of boards that are wrong as they stand there."""
    draw = BoardRenderer(camera, board)
    rng = np.random.default_rng(seed)
    far = _usual(camera, board)
    w, h = camera.width, camera.height

    def view(pose, look=look, renderer=draw):
        return renderer.view(*pose, look, rng).image

    yield "half out to the left", view(_place(camera, board, 40, h / 2, far))
    yield "half out at the bottom", view(_place(camera, board, w / 2, h - 30, far))
    yield "a quarter in", view(_place(camera, board, w - 60, 60, far))
    for name, extra in (("smaller board", -1), ("larger board", 1)):
        other = Checkerboard(board.columns + extra, board.rows + extra, board.square_m)
        pose = _place(camera, other, w / 2, h / 2, far)
        yield name, view(pose, renderer=BoardRenderer(camera, other))
    middle = _place(camera, board, w / 2, h / 2, far, rotation_x(0.3))
    yield "moved sideways", view(middle, replace(look, motion_px=(22.0, 0.0)))
    yield "moved askew", view(middle, replace(look, motion_px=(15.0, 15.0)))
    yield "out of focus", view(middle, replace(look, blur_px=7.0))
    yield "no contrast", view(middle, replace(look, foil=look.board, unevenness=0.0))
    yield "drowned in noise", view(middle, replace(look, noise=60.0))
    yield "far away", view(_place(camera, board, w / 2, h / 2, 8 * far))
    steep = rotation_y(math.radians(77)) @ rotation_z(0.1)
    yield "from the side", view(_place(camera, board, w / 2, h / 2, 0.8 * far, steep))
    yield "overexposed", view(middle, replace(look, board=420.0, foil=395.0, wall=400.0))


def _spoilt(camera, board, look, seed):
    """Good pictures with something over them, and pictures of other things."""
    draw = BoardRenderer(camera, board)
    rng = np.random.default_rng(seed + 1)
    far = _usual(camera, board)
    w, h = camera.width, camera.height
    turn = rotation_y(0.3) @ rotation_z(0.1)
    good = draw.view(*_place(camera, board, w / 2, h / 2, far, turn), look, rng)
    other = draw.view(*_place(camera, board, w / 2 + 14, h / 2 + 9, far, turn), look, rng)
    level = float(good.image.mean()) * 1.4
    hand = good.image.copy()
    at = good.corners_px[board.count // 2 + 1]
    cv2.ellipse(hand, (at.astype(int).tolist(), (90, 60), 30), level, -1)
    yield "behind a hand", hand
    finger = good.image.copy()
    at = good.corners_px[0].astype(int)
    cv2.circle(finger, at.tolist(), 14, level, -1)
    yield "a finger on one corner", finger
    yield "two pictures in one", cv2.addWeighted(good.image, 0.5, other.image, 0.5, 0)
    torn = good.image.copy()
    row = int(good.corners_px[:, 1].mean())
    torn[row:] = np.roll(torn[row:], 6, axis=1)
    yield "torn", torn
    wall = np.clip(rng.normal(105, 2, (h, w)), 0, 255).astype(np.uint8)
    text = wall.copy()
    for line in range(12):
        place = 20, 40 + 40 * line
        cv2.putText(text, "TEMPERATURE 21.5 GAIN HIGH", place, 0, 1.2, 140, 3)
    yield "text", text
    facade = wall.copy()
    for x in range(20, w - 30, 45):
        for y in range(20, h - 30, 45):
            facade[y : y + 22, x : x + 22] = 135
    yield "windows of a house", facade
    yield "empty wall", wall
