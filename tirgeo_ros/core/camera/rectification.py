"""The picture without the lens's distortion, as Ren et al. 2022 show it (Fig. 35).

The camera keeps its focal lengths and its principal point. Where the lens has no picture to give
a blank border is left, which is hatched and edged so that nobody takes it for a dark scene.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.model import Camera
from tirgeo_ros.core.types.arrays import BoolArray, Pixels
from tirgeo_ros.core.types.errors import CameraError

Places = npt.NDArray[np.float32]

_GROUND_BGR, _HATCH_BGR, _EDGE_BGR = (24, 24, 24), (40, 40, 110), (60, 60, 230)
_HATCH_PX = 12
_MOST_PIXELS = 10_000_000  # cinema 4K has 9; the maps take 80 bytes for each while they are made


class Rectifier:
    """Pictures of a camera as one without distortion would have taken them.

    ``camera`` is that one. Its maps and its border are computed once.
    """

    def __init__(self, camera: Camera) -> None:
        """Raise CameraError for more pixels than memory should go to."""
        if camera.width * camera.height > _MOST_PIXELS:
            size = f"{camera.width}x{camera.height}"
            raise CameraError(f"camera: {size} pixels are too many to rectify: set rectify false")
        self.camera = Camera(
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        )
        columns, rows, blank = _sources(camera)
        self._maps = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
        self._blank = np.where(blank, np.uint8(255), np.uint8(0))
        self._border = _hatched(blank)

    def rectified(self, image: Pixels) -> Pixels:
        """A new (h, w, 3) BGR picture of one (h, w, 3) as the camera took it."""
        straight = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.copyTo(self._border, self._blank, straight), np.uint8)


def _sources(camera: Camera) -> tuple[Places, Places, BoolArray]:
    """Column and row (h, w) float32 in the camera's picture of each pixel, and which have none."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    held = x * x + y * y <= camera.max_radius**2
    column, row = np.full(u.shape, -1e3), np.full(u.shape, -1e3)
    column[held], row[held] = camera.pixels(x[held], y[held])
    inside = (column >= -0.5) & (column <= camera.width - 0.5)
    inside &= (row >= -0.5) & (row <= camera.height - 0.5)
    return column.astype(np.float32), row.astype(np.float32), ~inside


def _hatched(blank: BoolArray) -> Pixels:
    """(h, w, 3) BGR: hatching, with a line along the edge of what is blank."""
    v, u = np.indices(blank.shape)
    border = np.empty((*blank.shape, 3), np.uint8)
    border[:] = _GROUND_BGR
    border[(u + v) % _HATCH_PX < 2] = _HATCH_BGR
    inner = cv2.erode(blank.astype(np.uint8), np.ones((3, 3), np.uint8))  # what is beyond is blank
    border[blank & (inner == 0)] = _EDGE_BGR
    return border
