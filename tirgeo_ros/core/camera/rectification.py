"""Remove the lens distortion from pictures, as in Ren et al. 2022 (Fig. 35).

The camera keeps its focal lengths and its principal point. Where the source picture has no
pixels, a border of one colour remains, so that nobody takes it for a dark scene.
"""

from __future__ import annotations

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import CameraError

_BORDER_BGR = (40, 40, 110)
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
        shape = camera.height, camera.width
        v, u = np.indices(shape, dtype=float)
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        held = x * x + y * y <= camera.max_radius**2
        column, row = np.full(shape, -1e3), np.full(shape, -1e3)
        column[held], row[held] = camera.pixels(x[held], y[held])
        places = column.astype(np.float32), row.astype(np.float32)
        self._maps = cv2.convertMaps(*places, cv2.CV_16SC2)
        inside = (column >= -0.5) & (column <= camera.width - 0.5)
        inside &= (row >= -0.5) & (row <= camera.height - 0.5)
        self._blank = np.where(inside, np.uint8(0), np.uint8(255))
        self._border = np.full((*shape, 3), _BORDER_BGR, np.uint8)

    def rectified(self, image: Pixels) -> Pixels:
        """Return the rectified picture, a new array (h, w, 3) BGR, of a picture (h, w, 3) BGR."""
        straight = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.copyTo(self._border, self._blank, straight), np.uint8)
