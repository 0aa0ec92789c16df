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
"""A writer of FLIR's R-JPEG: an FFF file with raw values and constants, in pieces of APP1."""

from __future__ import annotations

import io
import struct

import cv2
import numpy as np
from PIL import Image

#: Constants of a real camera (Thermimage's defaults), without air and window.
CONSTANTS = {
    "emissivity": 1.0,
    "distance": 0.0,
    "reflected": 293.15,
    "air": 293.15,
    "window": 293.15,
    "window_transmission": 1.0,
    "humidity": 0.5,
    "planck": (21106.77, 1501.0, 1.0, -7340, 0.012545258),  # R1, B, F, O, R2
    "of_air": (0.006569, 0.012620, -0.002276, -0.006670, 1.9),  # alpha, alpha, beta, beta, X
}


def camera_record(order="<", **changes):
    """The record with the constants, in one of two byte orders."""
    own = CONSTANTS | changes
    record = bytearray(0x400)
    r1, b, f, o, r2 = own["planck"]
    struct.pack_into(f"{order}H", record, 0, 2)
    names = ("emissivity", "distance", "reflected", "air", "window", "window_transmission")
    struct.pack_into(f"{order}6f", record, 0x20, *(own[name] for name in names))
    struct.pack_into(f"{order}f", record, 0x3C, own["humidity"])
    struct.pack_into(f"{order}3f", record, 0x58, r1, b, f)
    struct.pack_into(f"{order}5f", record, 0x70, *own["of_air"])
    struct.pack_into(f"{order}if", record, 0x308, o, r2)
    return bytes(record)


def raw_record(values, order="<", *, png=False):
    """The record with the raw values (h, w), plain or as the PNG that FLIR's cameras write."""
    height, width = values.shape
    head = struct.pack(f"{order}3H", 2, width, height).ljust(0x20, b"\0")
    values = values.astype(np.uint16)
    if png:
        return head + cv2.imencode(".png", values.byteswap())[1].tobytes()
    return head + values.astype(f"{order}u2").tobytes()


def flir_jpeg(values, size=(640, 512), order=">", *, png=False, piece=60_000, **changes):
    """An R-JPEG with raw values (h, w); ``order`` is that of the file, not of its records."""
    records = {1: raw_record(values, png=png), 0x20: camera_record(**changes)}
    directory, body, at = b"", b"", 0x40 + 0x20 * len(records)
    for kind, record in records.items():
        entry = struct.pack(f"{order}HHIIII", kind, 1, 100, 1, at + len(body), len(record))
        directory, body = directory + entry.ljust(0x20, b"\0"), body + record
    head = (
        b"FFF\0" + b"tirgeo".ljust(16, b"\0") + struct.pack(f"{order}3I", 100, 0x40, len(records))
    )
    file = head.ljust(0x40, b"\0") + directory + body
    pieces = [file[place : place + piece] for place in range(0, len(file), piece)]
    out = io.BytesIO()
    Image.new("L", size, 90).save(out, "JPEG")
    marked = b""
    for number, part in enumerate(pieces):
        content = b"FLIR\0\1" + bytes([number, len(pieces) - 1]) + part
        marked += b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content
    return out.getvalue()[:2] + marked + out.getvalue()[2:]
