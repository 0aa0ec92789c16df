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
"""Read the temperatures of a still: FLIR's raw data in its JPEG, or the TIFF beside it.

FLIR's JPEG has an FFF file in pieces (APP1): a directory of records, one with the raw values, one
with the camera's constants, both with a byte order of their own (layout: ExifTool's tables). The
measured value is that of the object, of what it reflects, of the air and of a window before the
lens (FLIR's user manuals, "The measurement formula"), each by Planck's law with the camera's own
constants: U(T) = R1 / (R2 (exp(B / T) - F)) - O.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from tirgeo_ros.core.overlay.clicks import TEMPERATURE_SCALE
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.files.whole_files import first_bytes
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO, unpacked
from tirgeo_ros.io.pictures.jpeg_segments import APP1, segments

_FLIR, _APP3 = b"FLIR\0", 0xE3
_PIECE = 8  # bytes before a piece: FLIR, 0, 1, its number, the last number
_ENTRY = 0x20  # bytes of an entry of the directory
_RAW, _CAMERA = 1, 0x20  # types of records
_PIXELS = 0x20  # where they begin in the record of raw values
#: Where the camera's record has which numbers; humidity as a share, window is its transmission.
_CAMERA_AT = {
    0x20: "emissivity distance_m reflected_k air_k window_k window",
    0x3C: "humidity",
    0x58: "r1 b f",
    0x70: "alpha_1 alpha_2 beta_1 beta_2 x",
    0x30C: "r2",
}
_PNG = b"\x89PNG"
_ZERO_K = 273.15
_MOST_OF_TIFF = 1 << 26  # bytes
DJI_NOTE = "DJI's raw data needs DJI's own tool: put its TIFF beside the still"
_BAD = struct.error, ValueError, IndexError, ArithmeticError, KeyError


def temperatures(still: Path, jpeg: bytes, tiff: Path | None = None) -> bytes:
    """Return a PNG of a still's temperatures in the scale of their topic; empty if it has none.

    ``tiff`` is the file beside it. Raise MessageError saying why they cannot be read.
    """
    parts = list(segments(jpeg))
    pieces = {c[6]: c for m, c in parts if m == APP1 and c[:5] == _FLIR and len(c) > _PIECE}
    if tiff is not None:
        degrees = _of_tiff(tiff)
    elif pieces:
        degrees = _of_flir(still, b"".join(pieces[n][_PIECE:] for n in sorted(pieces)))
    elif any(marker == _APP3 for marker, _ in parts):
        raise MessageError(DJI_NOTE)
    else:
        return b""
    scale = TEMPERATURE_SCALE
    counts = np.rint((degrees - scale.celsius_offset) / scale.celsius_per_count)
    counts[~((counts > 0) & (counts <= np.iinfo(np.uint16).max))] = 0  # nan too
    return cv2.imencode(".png", counts.astype(np.uint16))[1].tobytes()


def _of_tiff(path: Path) -> Array:
    """Return the temperatures (deg C, (h, w)) in a TIFF. Raise MessageError."""
    data = first_bytes(path, _MOST_OF_TIFF, MessageError)
    try:
        values = unpacked(data, cv2.IMREAD_UNCHANGED, MOST_OF_VIDEO)
    except ValueError as error:
        raise MessageError(f"{path}: {error}") from None
    if values is None or values.ndim != 2 or values.dtype.kind != "f":
        raise MessageError(f"{path}: no picture of one number with decimals (deg C) a pixel")
    return np.asarray(values, float)


def _of_flir(still: Path, file: bytes) -> Array:
    """Return the temperatures (deg C, (h, w)) in an FFF file. Raise MessageError."""
    try:
        records = _records(file)
        return celsius(_raw(records[_RAW]), _camera(records[_CAMERA]))
    except _BAD as error:
        raise MessageError(f"{still}: FLIR's raw data are damaged: {error}") from None


def transmission(c: Mapping[str, float]) -> float:
    """Return the transmission of the air over the distance (FLIR's two exponentials)."""
    t = c["air_k"] - _ZERO_K
    growth = 1.5587 + 0.06939 * t - 2.7816e-4 * t**2 + 6.8455e-7 * t**3
    wet = math.sqrt(c["humidity"] * math.exp(growth))
    root = math.sqrt(c["distance_m"])
    first = c["x"] * math.exp(-root * (c["alpha_1"] + c["beta_1"] * wet))
    return first + (1 - c["x"]) * math.exp(-root * (c["alpha_2"] + c["beta_2"] * wet))


def black_body(temperature_k: float, c: Mapping[str, float]) -> float:
    """Return the raw value of a black body at a temperature."""
    return c["r1"] / (c["r2"] * (math.exp(c["b"] / temperature_k) - c["f"])) - c["o"]


def celsius(raw: Array, c: Mapping[str, float]) -> Array:
    """Return temperatures (deg C) of raw values, in their shape; nan where there is none."""
    air, window = transmission(c), c["window"]
    others = (1 - c["emissivity"]) * air * window * black_body(c["reflected_k"], c)
    others += (1 - air) * window * black_body(c["air_k"], c)
    others += (1 - window) * black_body(c["window_k"], c)
    with np.errstate(all="ignore"):
        of_object = (raw - others) / (c["emissivity"] * air * window)
        ratio = np.log(c["r1"] / (c["r2"] * (of_object + c["o"])) + c["f"])
        return np.asarray(c["b"] / ratio - _ZERO_K)


def _records(file: bytes) -> dict[int, bytes]:
    """Return the records of an FFF file by type, the first of each."""
    version = struct.unpack_from(">I", file, 0x14)[0]
    order = ">" if 100 <= version < 200 else "<"
    at, count = struct.unpack_from(f"{order}II", file, 0x18)
    records: dict[int, bytes] = {}
    for place in range(at, min(at + count * _ENTRY, len(file) - _ENTRY + 1), _ENTRY):
        kind, offset, length = struct.unpack_from(f"{order}H10xII", file, place)
        records.setdefault(kind, file[offset : offset + length])
    return records


def _order(record: bytes) -> str:
    """Return the byte order of a record, whose first number is small."""
    return "<" if struct.unpack_from("<H", record)[0] < 0x100 else ">"


def _raw(record: bytes) -> Array:
    order = _order(record)
    width, height = struct.unpack_from(f"{order}HH", record, 2)
    if not width * height:
        raise ValueError("they have no pixels")
    content = record[_PIXELS:]
    if content.startswith(_PNG):  # of 16 bits, written with the bytes of each value exchanged
        values = unpacked(content, cv2.IMREAD_UNCHANGED, MOST_OF_VIDEO)
        if values is None or values.dtype != np.uint16:
            raise ValueError("its PNG has no 16 bits")
        return np.asarray(values.byteswap(), float)
    counts = np.frombuffer(content, f"{order}u2", width * height)
    return counts.reshape(height, width).astype(float)


def _camera(record: bytes) -> dict[str, float]:
    order, c = _order(record), dict[str, float]()
    for at, names in _CAMERA_AT.items():
        split = names.split()
        c |= zip(split, struct.unpack_from(f"{order}{len(split)}f", record, at), strict=True)
    (c["o"],) = struct.unpack_from(f"{order}i", record, 0x308)
    c["humidity"] /= 100 if c["humidity"] > 2 else 1  # some write per cent
    if not (0 < c["emissivity"] <= 1 and 0 < c["window"] <= 1 and c["air_k"] > 0):
        raise ValueError("its constants are impossible")
    return c
