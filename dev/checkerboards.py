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
"""Write pictures and a video of a thermal checkerboard for ``tirgeo calibrate lens``, ``gimbal``.

``python -m dev.checkerboards -o boards`` writes ``lens/``, pictures as for a lens calibration, and
``wall.mcap``, a video of a board on a wall while the aircraft yaws to and fro (Ren et al. 2022,
section 5.2).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dev.judging import exit_code
from tirgeo_ros.core.calibration.checkerboard import Checkerboard
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, matrix_from_euler, rotation_z
from tirgeo_ros.core.types.arrays import Array, RawPixels
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages
from tirgeo_ros.tools.simulate.processes import generator, scaled_noise
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.sensors import ERROR_TIME_S

Floats = npt.NDArray[np.float32]
Pose = tuple[Array, Array]  # rotation (3, 3) board to optical frame; its first corner (3,), m

BOARD = Checkerboard(9, 6, 0.1)
RATE_HZ = 10.0  # of the video's pictures, as the paper took from its own
#: The camera follows the airframe, which is turned to and fro by hand: Table 8's sigma.
YAW_STD_DEG, YAW_PERIOD_S = 13.8857, 6.0
_DISTANCE_M, _FOLLOWED = 2.2, 0.7  # so that the board stays in the picture
_MARGIN_SQUARES = 1.5  # plain board around the outer squares
_EDGE_PX = 8.0  # distance of corners from the picture's edge
_TRIES, _SEED = 2000, 2205


@dataclass(frozen=True)
class BoardLook:
    """Hold how a board appears, in 8-bit grey levels; 16 bits are ``20000 + 40 * level``."""

    board: float = 118.0  # bare squares and margin
    foil: float = 92.0  # colder: copper mirrors the sky
    wall: float = 105.0  # background behind the board
    unevenness: float = 4.0  # standard deviation from square to square
    gradient: float = 6.0  # from one end of the board to the other
    blur_px: float = 0.9  # standard deviation of the optics' point spread
    motion_px: tuple[float, float] = (0.0, 0.0)  # movement of the picture during an exposure
    noise: float = 1.5  # standard deviation of a pixel
    vignetting: float = 0.12  # loss in the corners
    bits: int = 8


class BoardView(NamedTuple):
    """Hold a picture and the board's true corners (count, 2) in it; nan outside the lens model."""

    image: RawPixels  # (h, w) uint8 or uint16
    corners_px: Array


class BoardRenderer:
    """Render boards through a camera, with ``parts`` x ``parts`` rays per pixel."""

    def __init__(self, camera: Camera, board: Checkerboard, parts: int = 2) -> None:
        """Compute the rays once."""
        self.camera, self.board, self._parts = camera, board, parts
        width, height = camera.width * parts, camera.height * parts
        u = (np.arange(width) + 0.5) / parts - 0.5
        v = (np.arange(height) + 0.5) / parts - 0.5
        rays = camera.rays(np.stack(np.meshgrid(u, v), -1).reshape(-1, 2))
        self._rays: Floats = rays.reshape(height, width, 3).astype(np.float32)
        coarse = self._rays[parts // 2 :: parts, parts // 2 :: parts, :2]
        off_axis = np.nan_to_num((coarse**2).sum(-1))
        self._falloff: Floats = np.asarray(off_axis / off_axis.max(), np.float32)

    def view(
        self, rotation_cb: Array, position_c: Array, look: BoardLook, rng: np.random.Generator
    ) -> BoardView:
        """Render the board from a pose in the optical frame."""
        shape = self.board.rows + 1, self.board.columns + 1
        row, column = np.indices(shape)
        levels = np.where((row + column) % 2 == 0, look.foil, look.board)
        levels = levels + look.gradient * (column / shape[1] - 0.5)
        levels = np.asarray(levels + rng.normal(0, look.unevenness, shape), np.float32)
        plane = np.column_stack([rotation_cb[:, :2] * self.board.square_m, position_c])
        to_board = np.linalg.inv(plane).astype(np.float32)
        x, y, w = np.moveaxis(self._rays @ to_board.T, -1, 0)
        scale = np.where(w > 1e-6, w, np.float32(np.nan))  # nan outside the lens model
        image = self._sensed(_drawn(levels, x / scale, y / scale, look), look, rng)
        points_c = self.board.points_m @ rotation_cb.T + position_c
        return BoardView(image, self.camera.project(points_c)[0])

    def _sensed(self, drawn: Floats, look: BoardLook, rng: np.random.Generator) -> RawPixels:
        parts = self._parts
        blurred: Any = cv2.GaussianBlur(drawn, (0, 0), look.blur_px * parts)
        if any(look.motion_px):
            blurred = _smeared(blurred, np.array(look.motion_px) * parts)
        height, width = self._falloff.shape
        mean = np.asarray(blurred).reshape(height, parts, width, parts).mean((1, 3))
        levels = mean * (1 - look.vignetting * self._falloff)
        levels = levels + rng.normal(0, look.noise, levels.shape)
        if look.bits == 16:
            return np.asarray(np.clip(np.rint(levels * 40.0 + 20000.0), 0, 65535), np.uint16)
        return np.asarray(np.clip(np.rint(levels), 0, 255), np.uint8)


def _drawn(levels: Floats, column: Floats, row: Floats, look: BoardLook) -> Floats:
    """Return the level at points of the board's plane; square (0, 0) is before the first corner.

    Each part of a pixel gets the mean over its own footprint, so that edges along the pixel rows
    do not shift to the next part.
    """
    padded = np.pad(levels, 2, constant_values=np.float32(look.board))
    size = np.array(levels.shape) - 1
    beside = np.maximum(
        np.maximum(-row, row - size[0] + 1), np.maximum(-column, column - size[1] + 1)
    )
    i, below = _edge(row, len(padded))
    j, right = _edge(column, padded.shape[1])
    upper = padded[i, j] * (1 - right) + padded[i, j + 1] * right
    lower = padded[i + 1, j] * (1 - right) + padded[i + 1, j + 1] * right
    with np.errstate(invalid="ignore"):
        on_board = beside < 1 + _MARGIN_SQUARES
    drawn = upper * (1 - below) + lower * below
    return np.asarray(np.where(on_board, drawn, look.wall), np.float32)


def _edge(place: Floats, count: int) -> tuple[npt.NDArray[np.intp], Floats]:
    """Return the padded square before the nearest edge, and a footprint's share beyond it."""
    footprint = sum(np.abs(np.gradient(place, axis=axis)) for axis in (0, 1))
    nearest = np.nan_to_num(np.rint(place))
    with np.errstate(invalid="ignore"):
        share = np.clip((place - nearest) / np.maximum(footprint, 1e-9) + 0.5, 0, 1)
    before = np.clip(nearest + 2, 0, count - 2).astype(np.intp)
    return before, np.nan_to_num(share).astype(np.float32)


def _smeared(image: Any, motion: Array) -> Any:
    """Return the mean over a straight motion (columns, rows) of the picture, px."""
    steps = math.ceil(np.hypot(*motion)) + 1
    half = math.ceil(np.abs(motion).max() / 2) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, steps):
        column, row = np.rint(half + share * motion).astype(int)
        kernel[row, column] += 1 / steps
    return cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE)


def board_views(
    camera: Camera,
    board: Checkerboard,
    count: int,
    seed: int,
    look: BoardLook | None = None,
    parts: int = 2,
) -> list[BoardView]:
    """Render views as for a calibration: all over the frame, tilted, near and far."""
    renderer, rng = BoardRenderer(camera, board, parts), np.random.default_rng(seed)
    poses = calibration_poses(camera, board, count, rng)
    return [renderer.view(*pose, look or BoardLook(), rng) for pose in poses]


def calibration_poses(
    camera: Camera,
    board: Checkerboard,
    count: int,
    rng: np.random.Generator,
    most_tilt_deg: float = 45.0,
) -> Iterator[Pose]:
    """Yield poses with all corners visible, one in four upside down.

    Raise ValueError if the board does not fit into the picture.
    """
    made, size = 0, np.array([camera.width, camera.height])
    long_m = max(board.columns, board.rows) * board.square_m
    for _ in range(_TRIES * count):
        if made == count:
            return
        turn = rng.normal(0, 0.25) + math.pi * (made % 4 == 3)
        about = rng.uniform(0, 2 * math.pi)
        tilt = rng.uniform(0, math.radians(most_tilt_deg))
        axis = np.array([math.cos(about), math.sin(about), 0])
        rotation = np.asarray(cv2.Rodrigues(tilt * axis)[0]) @ rotation_z(turn)
        depth = long_m * camera.fx / (camera.width * rng.uniform(0.4, 0.85))
        middle = camera.rays(rng.uniform([0, 0], size)[None])[0] * depth
        position = middle - rotation @ board.points_m.mean(0)
        corners, valid = camera.project(board.points_m @ rotation.T + position)
        if valid.all() and ((corners > _EDGE_PX) & (corners < size - _EDGE_PX)).all():
            made += 1
            yield rotation, position
    if made < count:
        raise ValueError("the board does not fit into the picture")


def gimbal_pose(
    board: Checkerboard, angles_rad: Array, distance_m: float, followed: float = 0.0
) -> Pose:
    """Return a board's pose on a wall for a camera's roll, pitch, yaw from the board's normal.

    The camera is straight in front of the board's middle and turns on the spot, or it is also
    moved around the board by the share ``followed`` of each angle: the board stays in the picture.
    """
    rotation_gw = matrix_from_euler(*angles_rad).T
    rotation_cb = BODY_OPTICAL.T @ rotation_gw @ BODY_OPTICAL
    carried = matrix_from_euler(*(np.asarray(angles_rad) * [0.0, followed, followed]))
    away = BODY_OPTICAL.T @ carried @ [distance_m, 0.0, 0.0]
    return rotation_cb, rotation_cb @ (away - board.points_m.mean(0))


def camera_angles(times_s: Array, duration_s: float, seed: int) -> Array:
    """Return the camera's roll, pitch, yaw relative to the wall (n, 3), rad.

    Roll and pitch drift as for the camera of a simulated flight (Table 8); yaw oscillates.
    """
    rms = np.radians(Scenario().gimbal.error_rms_deg)
    wander = scaled_noise(generator(seed, "gimbal"), duration_s, ERROR_TIME_S, rms)
    swing = math.sqrt(2) * math.radians(YAW_STD_DEG)
    yaw = swing * np.sin(2 * np.pi * times_s / YAW_PERIOD_S)
    return np.column_stack([wander(times_s), yaw])


def write_wall(path: Path, duration_s: float, seed: int) -> Array:
    """Write the video; return the true angles (n, 3), rad, of its pictures. Raise BagError."""
    times_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    angles = camera_angles(times_s, duration_s, seed)
    messages, draw = Messages(), BoardRenderer(XT2, BOARD)
    with BagWriter(path) as bag:
        for number, rpy in enumerate(angles):
            stamp_ns = Scenario().start_ns + round(number * 1e9 / RATE_HZ)
            pose = gimbal_pose(BOARD, rpy, _DISTANCE_M, _FOLLOWED)
            view = draw.view(*pose, BoardLook(), generator(seed, f"picture {number}"))
            for topic, message in (
                ("thermal/camera_info", messages.camera_info(XT2, stamp_ns)),
                ("thermal/image_raw", messages.image(stamp_ns, view.image)),
            ):
                bag.write(f"/{topic}", TOPIC_TYPES[topic], message, stamp_ns)
    return angles


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command's arguments."""
    made = argparse.ArgumentParser(prog="python -m dev.checkerboards", description=__doc__)
    made.add_argument("-o", "--output", type=Path, metavar="DIR", required=True)
    made.add_argument("--views", type=int, default=40, metavar="N", help="default: %(default)s")
    made.add_argument("--seconds", type=float, default=30.0, metavar="S", help="of video")
    return made


def run(args: argparse.Namespace) -> dict[str, object]:
    """Write all files; ``angles_std_deg`` in the result is the truth of the video."""
    lens = made_folder(args.output / "lens", CalibrationError)
    for number, view in enumerate(board_views(XT2, BOARD, args.views, _SEED), 1):
        _, data = cv2.imencode(".png", view.image)
        (lens / f"view_{number:02d}.png").write_bytes(data.tobytes())
    std = np.degrees(write_wall(args.output / "wall.mcap", args.seconds, _SEED).std(0, ddof=1))
    return {"angles_std_deg": dict(zip(("roll", "pitch", "yaw"), std.tolist(), strict=True))}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    args = parser().parse_args(argv)
    return exit_code("checkerboards", lambda: 0 if run(args) else 1)


if __name__ == "__main__":
    sys.exit(main())
