"""Pictures whose headers ask for more memory than any camera's picture does."""

from __future__ import annotations

import re
import struct
import zlib

import cv2
import numpy as np
import pytest
from measured import run_measured

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.messages import Messages, compressed_pixels
from tirgeo_ros.io.messages.pictures import unpacked

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)

COMPRESSED = """
import sys
from pathlib import Path
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.messages import Messages, compressed_pixels
message = Messages(Cdr().types).compressed(0, Path(sys.argv[1]).read_bytes())
try:
    print(compressed_pixels(message).shape)
except TirgeoError as error:
    print(error)
"""
FILE = """
import sys
from pathlib import Path
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.calibrate.board_pictures import pictures_of_files
try:
    print([taken.pixels.shape for taken in pictures_of_files([Path(sys.argv[1])], print)])
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


@pytest.mark.parametrize("program", [COMPRESSED, FILE], ids=["message", "file"])
def test_a_picture_that_would_fill_the_memory_is_refused(tmp_path, program):
    path = tmp_path / "black.png"
    write_black_png(path, 12_000)  # 1.2 GB of pixels
    done = run_measured(program, str(path))
    assert re.search(r"more than (8.4|50.0) million pixels", done.said), done
    done.check_modest()


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".pgm", ".webp"])
def test_every_form_is_measured_before_it_is_unpacked(suffix):
    data = cv2.imencode(suffix, GREY)[1].tobytes()
    assert unpacked(data, cv2.IMREAD_GRAYSCALE, 48).shape == (6, 8)
    with pytest.raises(ValueError, match=r"more than 0\.0 million pixels"):
        unpacked(data, cv2.IMREAD_GRAYSCALE, 47)


def test_a_message_of_more_than_4k_is_refused():
    made = Messages(Cdr().types)
    large = cv2.imencode(".png", np.zeros((2897, 2897), np.uint8))[1].tobytes()
    with pytest.raises(MessageError, match=r"compressed image: more than 8\.4 million pixels"):
        compressed_pixels(made.compressed(0, large))
    ultra = cv2.imencode(".png", np.zeros((2160, 3840), np.uint8))[1].tobytes()
    assert compressed_pixels(made.compressed(0, ultra)).shape == (2160, 3840)
