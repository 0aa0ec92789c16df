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
"""Image and camera messages, sound, broken, and asking for more memory than any camera does."""

from __future__ import annotations

import array
import re
import struct
import zlib

import cv2
import message_samples as samples
import numpy as np
import pytest
from measured import run_measured
from numpy.testing import assert_array_equal

from tirgeo_ros.core.types.errors import CameraError, MessageError
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.pictures import camera, compressed_pixels, image_pixels, unpacked

builder = Messages()
rng = np.random.default_rng(5)
GREY = rng.integers(0, 256, (6, 8), np.uint8)
COLOUR = rng.integers(0, 256, (6, 8, 3), np.uint8)


def image(pixels, encoding=None):
    message = builder.image(0, pixels)
    message.encoding = encoding or message.encoding
    return message


@pytest.mark.parametrize("pixels", [GREY, COLOUR])
def test_eight_bit_round_trip(pixels):
    assert_array_equal(image_pixels(image(pixels)), pixels)


def test_data_of_rclpy_and_padded_rows_are_read_too():
    message = image(GREY)
    message.data = array.array("B", GREY.tobytes())
    assert_array_equal(image_pixels(message), GREY)
    padded = np.hstack([COLOUR.reshape(6, 24), np.full((6, 5), 77, np.uint8)])
    message = image(COLOUR)
    message.step, message.data = 29, padded.ravel()
    assert_array_equal(image_pixels(message), COLOUR)
    assert_array_equal(image_pixels(image(COLOUR, "rgb8")), COLOUR[..., ::-1])


@pytest.mark.parametrize(
    ("encoding", "order"), [("yuv422", (128, 0, 128, 1)), ("yuv422_yuy2", (0, 128, 1, 128))]
)
def test_yuv422_without_colour_is_grey_and_needs_pairs(encoding, order):
    # order: where luminance 0 and 1 of a pair of pixels stand among the neutral colour bytes.
    luminance = np.array([[60, 200]], np.uint8)
    packed = np.array([[{0: 60, 1: 200}.get(place, place) for place in order]], np.uint8)
    message = image(np.zeros((1, 2), np.uint8), encoding)
    message.step, message.data = 4, packed.ravel()
    pixels = image_pixels(message)
    # ITU-R BT.601 with 16 to 235: grey = 255 / 219 (Y - 16), to a rounding.
    wanted = 255 / 219 * (luminance.astype(float) - 16)
    assert pixels.shape == (1, 2, 3)
    assert np.abs(pixels.astype(float) - wanted[..., None]).max() <= 1
    odd = image(np.zeros((2, 3), np.uint8), encoding)
    odd.step, odd.data = 6, np.zeros(12, np.uint8)
    with pytest.raises(MessageError, match=f"{encoding} needs an even width, has 3"):
        image_pixels(odd)


@pytest.mark.parametrize(("order", "big"), [("<u2", 0), (">u2", 1)])
def test_mono16_keeps_its_values_in_either_order_of_bytes(order, big):
    values = rng.integers(0, 1 << 16, (6, 8), np.uint16)
    message = image(values)
    message.is_bigendian = big
    message.data = np.frombuffer(values.astype(order).tobytes(), np.uint8)
    pixels = image_pixels(message)
    assert pixels.dtype == np.uint16  # of this machine's order: OpenCV takes no other
    assert_array_equal(pixels, values)


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("encoding", "bayer_rggb8", "encoding 'bayer_rggb8' is not one of mono8"),
        ("height", 7, "48 bytes do not hold 8x7 pixels"),
        ("height", 0, "do not hold 8x0 pixels"),
        ("step", 7, "with 7 bytes a row"),
        ("data", np.zeros(0, np.uint8), "0 bytes do not hold"),
    ],
)
def test_broken_images_are_refused(field, value, reason):
    message = image(GREY)
    setattr(message, field, value)
    with pytest.raises(MessageError, match=reason):
        image_pixels(message)


# compressed


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_of_16_bits_keeps_its_values(channels):
    values = rng.integers(0, 1 << 16, (6, 8), np.uint16)
    written = values if channels == 1 else np.dstack([values] * channels)
    message = builder.compressed(0, cv2.imencode(".png", written)[1].tobytes())
    pixels = compressed_pixels(message)
    assert pixels.dtype == np.uint16
    assert_array_equal(pixels, values)
    clear = np.dstack([COLOUR, np.full((6, 8), 9, np.uint8)])  # it loses its transparency
    message = builder.compressed(0, cv2.imencode(".png", clear)[1].tobytes())
    assert_array_equal(compressed_pixels(message), COLOUR)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff"])
def test_what_is_no_picture_is_refused(data):
    tiff = cv2.imencode(".tiff", np.ones((6, 8), np.float32))[1].tobytes()
    with pytest.raises(MessageError, match="pixels of float32; send 8 or 16 bits"):
        compressed_pixels(builder.compressed(0, tiff))
    with pytest.raises(MessageError, match=f"{len(data)} bytes are no jpeg"):
        compressed_pixels(builder.compressed(0, data))


# camera_info


@pytest.mark.parametrize("lens", [samples.BROWN, samples.RATIONAL])
def test_camera_round_trip(lens):
    result = camera(builder.camera_info(lens, 0))
    padded = (*lens.distortion, 0.0) if len(lens.distortion) == 4 else lens.distortion
    assert result.distortion == padded
    assert (result.width, result.height, result.fx, result.cy) == (
        lens.width,
        lens.height,
        lens.fx,
        lens.cy,
    )


def test_camera_info_of_a_brown_lens():
    message = builder.camera_info(samples.BROWN, 0)
    assert message.distortion_model == "plumb_bob"
    assert_array_equal(message.d, [0.054, 0.3462, -0.0037, 0.0076, 0])
    assert_array_equal(message.p.reshape(3, 4)[:, :3], message.k.reshape(3, 3))
    assert_array_equal(message.r.reshape(3, 3), np.eye(3))
    assert message.header.frame_id == "tir_optical_frame"


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("k", np.zeros(9), "K is zero"),
        ("distortion_model", "equidistant", "distortion model 'equidistant' is not known"),
        ("distortion_model", "rational_polynomial", "needs 8 coefficients in D, has 5"),
        ("d", np.zeros(3), "plumb_bob needs 4 or 5 coefficients in D, has 3"),
        ("d", np.full(5, np.nan), "not finite"),
        ("width", 0, "must be positive"),
    ],
)
def test_useless_calibrations_are_refused(field, value, reason):
    message = builder.camera_info(samples.BROWN, 0)
    setattr(message, field, value)
    with pytest.raises(CameraError, match=rf"^cam0/camera_info: .*{reason}"):
        camera(message, "cam0/camera_info")


SHADES = np.arange(48, dtype=np.uint8).reshape(6, 8)
COMPRESSED = """
import sys
from pathlib import Path
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.pictures import compressed_pixels
message = Messages().compressed(0, Path(sys.argv[1]).read_bytes())
try:
    print(compressed_pixels(message).shape)
except TirgeoError as error:
    print(error)
"""


def write_black_png(path, side: int) -> None:
    """A square of black of 16 bits in four channels, whose rows are packed once and repeated."""

    def chunk(name: bytes, body: bytes) -> bytes:
        whole = name + body
        return struct.pack(">I", len(body)) + whole + struct.pack(">I", zlib.crc32(whole))

    packer, row = zlib.compressobj(9, wbits=-15), bytes(1 + 8 * side)
    rows = packer.compress(row * 100) + packer.flush(zlib.Z_FULL_FLUSH)
    checksum = struct.pack(">HH", len(row) * side % 65521, 1)  # Adler's, of zeros
    packed = b"\x78\xda" + rows * (side // 100) + b"\x03\0" + checksum
    head = struct.pack(">IIBBBBB", side, side, 16, 6, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


def test_a_picture_that_would_fill_the_memory_is_refused(tmp_path):
    path = tmp_path / "black.png"
    write_black_png(path, 12_000)  # 1.2 GB of pixels
    done = run_measured(COMPRESSED, str(path))
    assert re.search(r"more than 8.4 million pixels", done.said), done
    done.check_modest()
    large = cv2.imencode(".png", np.zeros((2897, 2897), np.uint8))[1].tobytes()
    with pytest.raises(MessageError, match=r"compressed image: more than 8\.4 million pixels"):
        compressed_pixels(builder.compressed(0, large))
    ultra = cv2.imencode(".png", np.zeros((2160, 3840), np.uint8))[1].tobytes()  # 4k
    assert compressed_pixels(builder.compressed(0, ultra)).shape == (2160, 3840)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".pgm", ".webp"])
def test_every_form_is_measured_before_it_is_unpacked(suffix):
    data = cv2.imencode(suffix, SHADES)[1].tobytes()
    assert unpacked(data, cv2.IMREAD_GRAYSCALE, 48).shape == (6, 8)
    with pytest.raises(ValueError, match=r"more than 0\.0 million pixels"):
        unpacked(data, cv2.IMREAD_GRAYSCALE, 47)
