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
"""Convert image and camera messages to arrays and cameras; decode picture files.

A PNG of one colour can be a thousandth of the size of its pixels. So the width and height in the
header are checked before a picture (PNG, JPEG, TIFF ...) is decoded.
"""

from __future__ import annotations

import io
import math
import warnings
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import CameraError, MessageError

#: Formats that Pillow may open: those that OpenCV reads too.
FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP")
#: Most pixels of a video frame (4K): the frames of a second may wait in memory for their poses.
MOST_OF_VIDEO = 1 << 23
#: Most pixels of a single picture: more than the cameras of aircraft have.
MOST_OF_FILE = 50_000_000
#: The size of a picture that Pillow finds too large to open: beyond both limits.
_TOO_LARGE = 1 << 16, 1 << 16

#: Encoding to bytes per pixel; the aliases are other names for the same encodings.
_BYTES = {"mono8": 1, "mono16": 2, "bgr8": 3, "rgb8": 3, "yuv422": 2, "yuv422_yuy2": 2}
_ALIASES = {
    "8UC1": "mono8",
    "16UC1": "mono16",
    "8UC3": "bgr8",
    "uyvy": "yuv422",
    "yuyv": "yuv422_yuy2",
}
_CONVERSIONS = {
    "rgb8": cv2.COLOR_RGB2BGR,
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2,
}
#: Distortion model to the numbers of coefficients that it may have.
_MODELS = {"plumb_bob": (4, 5), "rational_polynomial": (8,)}
#: Cached: all pictures of a flight have the same camera, and computing its lens limits takes time.
_camera = lru_cache(maxsize=16)(Camera)


def unpacked(data: bytes, flags: int, most_pixels: int) -> npt.NDArray[Any] | None:
    """Decode as ``cv2.imdecode``; None if that fails. Raises ValueError above ``most_pixels``."""
    pixels = math.prod(size_of(data))
    if pixels > most_pixels:
        raise ValueError(
            f"more than {most_pixels * 1e-6:.1f} million pixels; use a smaller picture"
        )
    if not pixels:
        return None
    try:
        return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), flags))
    except cv2.error:
        return None


def size_of(data: bytes, formats: tuple[str, ...] = FORMATS) -> tuple[int, int]:
    """Return width and height from the header, or zeros; ``_TOO_LARGE`` past Pillow's limit."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=formats) as picture:
                return picture.size
    except Image.DecompressionBombError:
        return _TOO_LARGE
    except (OSError, ValueError, SyntaxError, ArithmeticError, LookupError, TypeError):
        return 0, 0


def pixels(topic: str, msg: Any) -> RawPixels:
    """Return the pixels of a picture from one of the contract's two image topics."""
    return compressed_pixels(msg) if topic.endswith("/compressed") else image_pixels(msg)


def image_pixels(msg: Any) -> RawPixels:
    """Convert ``sensor_msgs/Image`` to (h, w) uint8 or uint16, or (h, w, 3) uint8, blue first.

    The array may share the message's memory: do not write into it. Raises MessageError.
    """
    encoding = _ALIASES.get(msg.encoding, msg.encoding)
    if encoding not in _BYTES:
        raise MessageError(f"image: encoding {msg.encoding!r} is not one of {', '.join(_BYTES)}")
    rows = _rows(msg, _BYTES[encoding])
    if encoding == "mono8":
        return rows
    if encoding == "mono16":
        order = ">u2" if msg.is_bigendian else "<u2"
        return np.ascontiguousarray(rows).view(order).astype(np.uint16, copy=False)
    colours = rows.reshape(msg.height, msg.width, _BYTES[encoding])
    if encoding == "bgr8":
        return colours
    if encoding.startswith("yuv") and msg.width % 2:
        raise MessageError(f"image: {encoding} needs an even width, has {msg.width}")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(colours), _CONVERSIONS[encoding]))


def _rows(msg: Any, bytes_per_pixel: int) -> npt.NDArray[np.uint8]:
    """Return the bytes (h, w * bytes) without the padding at the end of each row."""
    data = np.frombuffer(msg.data, np.uint8)
    height, width, step = int(msg.height), int(msg.width), int(msg.step)
    used = width * bytes_per_pixel
    if min(height, width) < 1 or step < used or data.size < height * step:
        raise MessageError(
            f"image: {data.size} bytes do not hold {width}x{height} pixels of {msg.encoding} "
            f"with {step} bytes a row"
        )
    return data[: height * step].reshape(height, step)[:, :used]


def compressed_pixels(msg: Any) -> RawPixels:
    """Convert ``sensor_msgs/CompressedImage`` as ``image_pixels`` does. Raises MessageError."""
    data = bytes(msg.data)
    try:
        pixels = unpacked(data, cv2.IMREAD_UNCHANGED, MOST_OF_VIDEO)
    except ValueError as error:
        raise MessageError(f"compressed image: {error}") from None
    if pixels is None or not pixels.ndim:
        raise MessageError(f"compressed image: {len(data)} bytes are no {msg.format or 'picture'}")
    if pixels.ndim == 3 and pixels.dtype == np.uint16:
        # a thermal picture whose writer only supported colour pictures
        pixels = pixels[..., 0].copy()
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = pixels[..., :3]
    if pixels.dtype not in (np.uint8, np.uint16):
        raise MessageError(f"compressed image: pixels of {pixels.dtype}; send 8 or 16 bits")
    return np.asarray(pixels)


def camera(msg: Any, topic: str = "thermal/camera_info") -> Camera:
    """Convert K and D of ``sensor_msgs/CameraInfo``. Raises CameraError naming ``topic``."""
    distortion, model = tuple(float(number) for number in msg.d), msg.distortion_model
    if model not in _MODELS and (distortion or model):
        models = " or ".join(_MODELS)
        raise CameraError(f"{topic}: distortion model {model!r} is not known; use {models}")
    if distortion and len(distortion) not in _MODELS[model]:
        wanted = " or ".join(str(number) for number in _MODELS[model])
        raise CameraError(
            f"{topic}: {model} needs {wanted} coefficients in D, has {len(distortion)}"
        )
    fx, cx, fy, cy = (float(msg.k[i]) for i in (0, 2, 4, 5))
    if fx == 0 or fy == 0:
        raise CameraError(f"{topic}: K is zero: the camera is not calibrated")
    try:
        return _camera(int(msg.width), int(msg.height), fx, fy, cx, cy, distortion)
    except CameraError as error:
        raise CameraError(f"{topic}: {error}") from None
