"""Remove the lens distortion from pictures, as in Ren et al. 2022 (Fig. 35).

The camera keeps its focal lengths and its principal point. Where the source picture has no
pixels, a border remains. It is hatched and outlined so that nobody takes it for a dark scene.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import BoolArray, Pixels
from tirgeo_ros.core.types.errors import CameraError

Places = npt.NDArray[np.float32]

_GROUND_BGR, _HATCH_BGR, _EDGE_BGR = (24, 24, 24), (40, 40, 110), (60, 60, 230)
_HATCH_PX = 12
_MOST_PIXELS = 10_000_000  # cinema 4K has 9e6; building the maps takes 80 bytes for each pixel


class Rectifier:
    """Rectify the pictures of a camera: show them as a camera without distortion would.

    ``camera`` is the camera without distortion. The remap tables and the border are computed once.
    """

    def __init__(self, camera: Camera) -> None:
        """Compute the tables; raise CameraError if the picture has too many pixels for them."""
        if camera.width * camera.height > _MOST_PIXELS:
            size = f"{camera.width}x{camera.height}"
            raise CameraError(
                f"camera: {size} pixels are too many to rectify: set rectify to false"
            )
        self.camera = Camera(
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        )
        columns, rows, blank = _sources(camera)
        self._maps = cv2.convertMaps(columns, rows, cv2.CV_16SC2)
        self._blank = np.where(blank, np.uint8(255), np.uint8(0))
        v, u = np.indices(blank.shape)
        self._border = np.empty((*blank.shape, 3), np.uint8)
        self._border[:] = _GROUND_BGR
        self._border[(u + v) % _HATCH_PX < 2] = _HATCH_BGR
        # Outside the picture counts as blank.
        inner = cv2.erode(blank.astype(np.uint8), np.ones((3, 3), np.uint8))
        self._border[blank & (inner == 0)] = _EDGE_BGR

    def rectified(self, image: Pixels) -> Pixels:
        """Return the rectified picture, a new array (h, w, 3) BGR, of a picture (h, w, 3) BGR."""
        straight = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.copyTo(self._border, self._blank, straight), np.uint8)


def _sources(camera: Camera) -> tuple[Places, Places, BoolArray]:
    """Return for each rectified pixel its source column and row, and whether it has none.

    Columns and rows are (h, w) float32 in the distorted picture; the mask is (h, w).
    """
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    held = x * x + y * y <= camera.max_radius**2
    column, row = np.full(u.shape, -1e3), np.full(u.shape, -1e3)
    column[held], row[held] = camera.pixels(x[held], y[held])
    inside = (column >= -0.5) & (column <= camera.width - 0.5)
    inside &= (row >= -0.5) & (row <= camera.height - 0.5)
    return column.astype(np.float32), row.astype(np.float32), ~inside
