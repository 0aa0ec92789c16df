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
"""Measure the speed of the serial link's decoder, beside that of the line."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from functools import partial

from dev.judging import Figure
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import (
    Layout,
    broadcast_length,
    decode_broadcast,
)
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, Package, PackageTable, decode_push

#: The fastest line, 1 Mbaud: ten bits a byte.
LINE_MB_S = 0.1
FILE_READ, PORT_READ = 4096, 64  # bytes, as a file and as a serial port are read
_SECONDS = 20
_RUNS = 3
_BROADCASTS_HZ = 100
#: Of each ten broadcasts: all parts once, the slower parts four times, else the fast ones alone.
_ALL, _SLOW, _FAST = 0x3FFF, 0x0EFF, 0x0017
_MASKS = (_ALL, _FAST, _SLOW, _FAST, _SLOW, _FAST, _SLOW, _FAST, _SLOW, _FAST)


def dji_speeds(seconds: int = _SECONDS) -> list[Figure]:
    """Measure with a clean capture, which fills a line of 921600 baud to four fifths."""
    frames = list(capture(seconds))
    whole = b"".join(frames)

    def speed(work: Callable[[], int]) -> float:
        return max(_speed(work, len(whole), len(frames)) for _ in range(_RUNS))

    decoded = {read: speed(partial(decode, whole, read)) for read in (FILE_READ, PORT_READ)}
    return [
        *(Figure(f"DJI: decoded, reads of {k} B", v, "MB/s", ">= 2") for k, v in decoded.items()),
        Figure(
            "DJI: decoded over the line of 1 Mbaud", decoded[FILE_READ] / LINE_MB_S, "x", ">= 20"
        ),
    ]


def capture(seconds: int) -> Iterator[bytes]:
    """Yield the frames of an aircraft that sends all it can, in the order in which they come.

    Broadcasts of 100 Hz and the five usual packages, hard sync at 400 Hz among them: 855 frames
    and 75 kB a second, which fills a line of 921600 baud to four fifths. Their numbers are any.
    """
    rng = random.Random(1)  # noqa: S311 no secret
    times: list[tuple[float, Package | None, int]] = [
        (k / _BROADCASTS_HZ, None, k) for k in range(seconds * _BROADCASTS_HZ)
    ]
    times += [
        (k / package.rate_hz, package, k)
        for package in USUAL_PACKAGES
        for k in range(seconds * package.rate_hz)
    ]
    for sequence, (_, package, k) in enumerate(sorted(times, key=lambda due: due[0])):
        if package is None:
            mask = _MASKS[k % len(_MASKS)]
            length = broadcast_length(Layout.MODERN, mask)
            assert length is not None
            data = b"\x02\x00" + mask.to_bytes(2, "little") + rng.randbytes(length - 2)
        else:
            data = bytes((2, 5, package.id)) + rng.randbytes(package.length - 1)
        yield encode_frame(data, sequence=sequence & 0xFFFF)


def decode(whole: bytes, read: int) -> int:
    """Decode every field of every frame, from reads of ``read`` bytes; return their number."""
    table, decoded, reader = PackageTable(), 0, FrameReader()
    for at in range(0, len(whole), read):
        for frame in reader.feed(whole[at : at + read]):
            values = (
                decode_push(frame.value, table)
                if frame.cmd_id == 5
                else decode_broadcast(frame.value)
            )
            decoded += values is not None
    return decoded


def _speed(work: Callable[[], int], size: int, expected: int) -> float:
    begun = time.perf_counter()
    done = work()
    seconds = time.perf_counter() - begun
    assert done == expected
    return size * 1e-6 / seconds
