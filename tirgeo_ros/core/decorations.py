"""What helps to read the picture as a map: a bar of known length on the ground, and north."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tirgeo_ros.core.attitude import matrix_from_quat
from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.locating import Ground, locate
from tirgeo_ros.core.painting import status_box
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.core.terrain import Terrain
from tirgeo_ros.core.text import TEXT_BGR, Box, Pixels, Stamp, stamp, text_px

_LONGEST_PART, _SHORTEST_PART = 0.25, 0.06  # of the picture's width, for the bar
_SAMPLES = 33
_STEEP = math.cos(math.radians(10))  # of the optical axis: its own heading says little
_NEEDLE = np.array([[0.0, 1.0], [0.32, -0.8], [0.0, -0.45], [-0.32, -0.8]])  # right, to north
_NEEDLE_TIMES = 1.1  # half its length, by the size of the text
_TICK_TIMES = 0.3
_SHIFT = 4
_FULL = 255


@dataclass(frozen=True, slots=True)
class ScaleBar:
    """A part of a row of the picture that spans a round length on the ground."""

    left: float  # pixels
    right: float
    row: float
    length_m: float

    @property
    def text(self) -> str:
        """The length as it is written."""
        if self.length_m >= 1000:
            return f"{self.length_m / 1000:g} km"
        return f"{self.length_m:g} m" if self.length_m >= 1 else f"{self.length_m * 100:g} cm"


def ground_sample_m(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground
) -> float:
    """Ground that a pixel in the middle of the picture spans along its row, m; nan if none."""
    u, v = (camera.width - 1) / 2, (camera.height - 1) / 2
    points, sees = _row_points(camera, pose, plane, ground, np.array([u - 0.5, u + 0.5]), v)
    return float(np.linalg.norm(points[1] - points[0])) if sees else math.nan


def scale_bar(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground, left: float, row: float
) -> ScaleBar | None:
    """A bar that begins at a pixel (left, row) and goes to the right; None without ground there.

    Its length is the largest of 1, 2 and 5 times a power of ten, m, that a quarter of the
    picture's width holds. On an elevation model the ground is taken as level along the bar.
    """
    u = np.linspace(left, left + _LONGEST_PART * camera.width, _SAMPLES)
    points, sees = _row_points(camera, pose, plane, ground, u, row)
    away_m = np.linalg.norm(points - points[0], axis=1)
    if not sees or not (np.diff(away_m) > 0).all():
        return None
    length_m = _round_length(float(away_m[-1]))
    right = float(np.interp(length_m, away_m, u))
    return ScaleBar(left, right, row, length_m) if right - left >= _shortest(camera) else None


def _shortest(camera: Camera) -> float:
    return _SHORTEST_PART * camera.width


def _round_length(most_m: float) -> float:
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m)


def _row_points(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground, u: Array, row: float
) -> tuple[Array, bool]:
    """Ground points (N, 3) of pixels of a row, NED, and whether all of them see ground.

    The ground is flat here: the curvature of the earth and the map's plane are together less than
    0.1 % of a length that is seen from 100 m up, 1 km from the map's origin.
    """
    uv = np.column_stack([u, np.full_like(u, row)])
    rays_n = camera.rays(uv) @ matrix_from_quat(pose.q_nc).T
    height_m = _height_m(camera, pose, plane, ground, uv[len(uv) // 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = height_m / rays_n[:, 2]
        points = pose.position_n + ways[:, None] * rays_n
    return points, bool((ways > 0).all() and np.isfinite(points).all())


def _height_m(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground, uv: Array
) -> float:
    """Of the camera over the ground, on an elevation model over where a pixel (2,) meets it."""
    if isinstance(ground, Terrain):
        points, _ = locate(camera, pose, uv[None], plane, ground)
        return float(points[0, 2] - pose.position_n[2])
    return float(plane.geodetic_from_ned(pose.position_n)[2]) - ground


def camera_heading_rad(pose: CameraPose) -> float:
    """Where the camera looks: 0 is north, clockwise, 0 to 2 pi.

    The heading of the optical axis; as that comes within 10 degrees of straight down, more and
    more that of the picture's upper edge.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    ahead, up = rotation_nc[:, 2], -rotation_nc[:, 1]
    steep = min(max((ahead[2] - _STEEP) / (1 - _STEEP), 0.0), 1.0)
    north, east = ahead[:2] + steep * up[:2]
    return math.atan2(east, north) % (2 * math.pi) % (2 * math.pi)  # -1e-20 becomes 2 pi, then 0


@dataclass(frozen=True, slots=True)
class PlacedBar:
    """A scale bar with its place: over the left end of the status line."""

    bar: ScaleBar
    box: Box

    def paint(self, image: Pixels) -> None:
        """Draw it on the picture (h, w, 3) for which it was placed."""
        bar, size_px = self.bar, text_px(image)
        tick = bar.row - _TICK_TIMES * size_px
        ends = [[bar.left, tick], [bar.left, bar.row], [bar.right, bar.row], [bar.right, tick]]
        _ink(image, np.array(ends), size_px, closed=False)
        text = stamp(bar.text, size_px, TEXT_BGR)
        text.lay(image, round((bar.left + bar.right - text.size[0]) / 2), self.box.top)


def place_scale_bar(
    image: Pixels, camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground
) -> PlacedBar | None:
    """The scale bar of a picture (h, w, ...); None where no ground is seen, or no room is."""
    size_px, bottom = text_px(image), status_box(image).top
    row = bottom - 0.6 * size_px
    bar = scale_bar(camera, pose, plane, ground, 0.8 * size_px, row)
    if bar is None or row < 3 * size_px:
        return None
    width, height = stamp(bar.text, size_px, TEXT_BGR).size
    top = round(row - _TICK_TIMES * size_px) - height
    right = max(bar.right, (bar.left + bar.right + width) / 2)
    return PlacedBar(bar, Box(0, top, math.ceil(right + size_px / 2), bottom))


@dataclass(frozen=True, slots=True)
class PlacedRose:
    """A needle to north with the camera's heading, in the upper right corner."""

    heading_rad: float
    box: Box

    def paint(self, image: Pixels) -> None:
        """Draw it on the picture (h, w, 3) for which it was placed."""
        size_px, reach = text_px(image), _reach_px(image)
        middle = np.array([self.box.right - reach, reach], float)
        to_north = np.array([-math.sin(self.heading_rad), -math.cos(self.heading_rad)])
        to_right = np.array([-to_north[1], to_north[0]])
        needle = _NEEDLE_TIMES * size_px * (_NEEDLE @ np.stack([to_right, to_north]))
        _ink(image, middle + needle, size_px, closed=True)
        _lay_middle(image, "N", middle + 1.75 * size_px * to_north)
        text = _heading_stamp(self.heading_rad, size_px)
        text.lay(image, round(middle[0] - text.size[0] / 2), 2 * reach - size_px // 4)


def place_rose(image: Pixels, heading_rad: float) -> PlacedRose | None:
    """The rose of a picture (h, w, ...), up being where the camera looks; None without room."""
    reach, (height, width) = _reach_px(image), image.shape[:2]
    text = _heading_stamp(heading_rad, text_px(image))
    box = Box(width - 2 * reach, 0, width, 2 * reach + text.size[1])
    if box.left < width // 2 or box.bottom > height // 2:
        return None
    return PlacedRose(heading_rad, box)


def _reach_px(image: Pixels) -> int:
    """Of needle and letter, from the needle's middle."""
    return round(2.4 * text_px(image))


def _heading_stamp(heading_rad: float, size_px: int) -> Stamp:
    degrees = round(math.degrees(heading_rad)) % 360
    return stamp(f"{degrees:03d}\u00b0", size_px, TEXT_BGR)


def _lay_middle(image: Pixels, text: str, uv: Array) -> None:
    made = stamp(text, text_px(image), TEXT_BGR)
    left, top = np.rint(uv - np.array(made.size) / 2).astype(int).tolist()
    made.lay(image, left, top)


def _ink(image: Pixels, uv: Array, size_px: int, *, closed: bool) -> None:
    """A line, or a filled shape, (N, 2) pixels in the text's colour, with a dark halo."""
    halo_px, wide_px = max(round(size_px / 10), 1), max(round(size_px / 8), 1)
    room = halo_px + wide_px + 2
    left, top = np.maximum(np.floor(uv.min(axis=0)).astype(int) - room, 0).tolist()
    right, bottom = (np.ceil(uv.max(axis=0)).astype(int) + room).tolist()
    part = image[top:bottom, left:right]
    mask = np.zeros(part.shape[:2], np.uint8)
    points = [np.rint((uv - [left, top]) * (1 << _SHIFT)).astype(np.int32)]
    if closed:
        cv2.fillPoly(mask, points, (_FULL,), cv2.LINE_AA, _SHIFT)
    else:
        cv2.polylines(mask, points, False, (_FULL,), wide_px, cv2.LINE_AA, _SHIFT)
    halo = cv2.dilate(mask, np.ones((2 * halo_px + 1, 2 * halo_px + 1), np.uint8))
    dark = cv2.subtract(part, cv2.cvtColor(halo, cv2.COLOR_GRAY2BGR))
    image[top:bottom, left:right] = cv2.add(dark, cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR))
