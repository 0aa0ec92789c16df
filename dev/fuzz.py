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
"""Feed 1e8 bytes of frames and damage to the frame reader and the interpreter: ``make fuzz``.

In whatever pieces the bytes come, the frames must be those that the bare rules give byte by byte,
the counts must be the same, and little may be held between the pieces. The samples made of the
frames must be finite. No bytes may raise an exception. If a stretch differs, the exit code is 1
and the message says how to repeat that stretch alone.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import cycle

import numpy as np

from tirgeo_ros.core.config.dji_parameters import DjiConfig
from tirgeo_ros.dji.interpret.interpreter import Interpreter, Sample
from tirgeo_ros.dji.link.framing import (
    HEADER_BYTES,
    MAX_BYTES,
    MAX_DATA_BYTES,
    MIN_BYTES,
    FrameReader,
    ProtocolFrame,
    crc16,
    crc32,
    encode_frame,
)
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Layout, broadcast_length
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, PackageTable
from tirgeo_ros.dji.sources.serial import SerialDecoder
from tirgeo_ros.tools.presentation.progress import Progress, Report

#: What a part of the encrypted frames is encrypted with; the others have another key.
KEY = bytes(range(32))
_OTHER_KEY = bytes(32)
_MAX_GARBAGE = 200
_HEADER_VALUES = b"\xaa\x00\x01\x03\x10\x20\xff"


def damaged_stream(rng: random.Random, size: int) -> bytes:
    """Return ``size`` bytes of pieces of every kind below; the last may be cut."""
    stream = bytearray()
    while len(stream) < size:
        stream += rng.choice(_KINDS)(rng)
    return bytes(stream[:size])


def any_frame(rng: random.Random) -> bytes:
    """An intact frame with any data: of any length, ack, session, header alone, encrypted."""
    most = rng.choice((2, 40, 300, MAX_DATA_BYTES - 16))
    return encode_frame(
        rng.randbytes(rng.randint(0, most)),
        session=rng.randrange(32),
        sequence=rng.randrange(0x10000),
        is_ack=rng.random() < 0.2,
        key=rng.choice((None, None, None, KEY, _OTHER_KEY)),
    )


def _broadcast(rng: random.Random) -> bytes:
    """A push whose length fits its mask, of any numbers: NaN, infinities and all."""
    layout = rng.choice(tuple(Layout))
    mask = rng.getrandbits(rng.choice((3, 14)))
    length = broadcast_length(layout, mask) or 2
    return encode_frame(b"\x02\x00" + mask.to_bytes(2, "little") + rng.randbytes(length - 2))


def _false_header(rng: random.Random) -> bytes:
    """A header with any length, legal or not, and a right CRC-16; something else behind it."""
    length = rng.randrange(0x400)
    fields = bytes((0xAA, length & 0xFF, length >> 8, 0, rng.randrange(256), 0, 0, 0))
    fields += rng.randbytes(2)
    return fields + crc16(fields).to_bytes(2, "little")


def _flipped(rng: random.Random) -> bytes:
    frame = bytearray(any_frame(rng))
    frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def _cut(rng: random.Random) -> bytes:
    frame = any_frame(rng)
    at = rng.randrange(len(frame))
    return frame[at:] if rng.random() < 0.3 else frame[:at]


def _shifted(rng: random.Random) -> bytes:
    """A byte too many or one lost, as by an overrun of the serial port."""
    frame = any_frame(rng)
    at = rng.randrange(len(frame))
    return frame[:at] + (rng.randbytes(1) + frame[at:] if rng.random() < 0.5 else frame[at + 1 :])


def _nested(rng: random.Random) -> bytes:
    """A frame, intact or not, in the data of another, intact or not."""
    inner = rng.choice((any_frame, _flipped, _false_header))(rng)[:500]
    outer = encode_frame(rng.randbytes(rng.randrange(30)) + inner + rng.randbytes(5))
    return outer if rng.random() < 0.5 else outer[:-1] + bytes([outer[-1] ^ 1])


_KINDS: tuple[Callable[[random.Random], bytes], ...] = (
    any_frame,
    _broadcast,
    # a push of a subscribed package
    lambda rng: encode_frame(
        bytes([2, 5, (package := rng.choice(USUAL_PACKAGES)).id])
        + rng.randbytes(package.length - 1)
    ),
    lambda rng: rng.randbytes(rng.randint(1, _MAX_GARBAGE)),
    # bytes that each could begin a frame
    lambda rng: b"\xaa" * rng.randint(1, _MAX_GARBAGE),
    # bytes of the values that headers are made of
    lambda rng: bytes(rng.choices(_HEADER_VALUES, k=rng.randint(12, _MAX_GARBAGE))),
    _false_header,
    _flipped,
    _cut,
    _shifted,
    _nested,
)


STRETCH_BYTES = 250_000
#: Most bytes of a piece: as single bytes, as read from a serial port, as read from a file.
PIECES = (1, 3, 64, 512, 4096, STRETCH_BYTES)
_CONFIG = DjiConfig(key=KEY.hex())
_START_NS, _STEP_NS = 1_700_000_000_000_000_000, 70_000_000  # two pauses of seven are long


@dataclass
class Result:
    """Hold the results of one stretch or of many."""

    bytes: int = 0
    frames: int = 0
    difference: str = ""


def literal_length(data: bytes, at: int) -> int:
    """Return the length of the intact frame at ``at``, 0 if there is none, by the bare rules."""
    header = data[at : at + HEADER_BYTES]
    if len(header) < HEADER_BYTES or header[0] != 0xAA:
        return 0
    length, version = (header[1] | header[2] << 8) & 0x3FF, header[2] >> 2
    if version or header[3] >> 6 or any(header[5:8]) or crc16(header):
        return 0
    if length == HEADER_BYTES:
        return length
    good = length >= MIN_BYTES and at + length <= len(data) and not crc32(data[at : at + length])
    return length if good else 0


def literal_frames(data: bytes) -> list[tuple[int, int]]:
    """Return offset and length of each frame; where none begins, skip one byte."""
    places, at = [], 0
    while (at := data.find(0xAA, at)) >= 0:
        length = literal_length(data, at)
        if length:
            places.append((at, length))
        at += length or 1
    return places


def pieces(data: bytes, rng: random.Random, most: int) -> Iterable[bytes]:
    """Yield the bytes in pieces of 1 to ``most``."""
    sizes, at = cycle([rng.randint(1, most) for _ in range(997)]), 0
    while at < len(data):
        size = next(sizes)
        yield data[at : at + size]
        at += size


def stretch(data: bytes, rng: random.Random) -> Result:
    """Read ``data`` in every way; the result names the first difference."""
    reader = FrameReader(KEY)
    frames = reader.feed(data) + reader.rescan()
    differing = {(f.offset, f.length) for f in frames} ^ set(literal_frames(data))
    wrong = f"at {min(differing)[0]} the rules give another frame" if differing else ""
    wrong = wrong or _in_pieces(data, rng, frames, reader.counts)
    wrong = wrong or _with_pauses(data, rng) or _to_samples(data, rng)
    return Result(len(data), len(frames), wrong)


def _in_pieces(
    data: bytes, rng: random.Random, expected: Sequence[ProtocolFrame], counts: dict[str, int]
) -> str:
    reader, most = FrameReader(KEY), rng.choice(PIECES)
    frames: list[ProtocolFrame] = []
    for piece in pieces(data, rng, most):
        frames += reader.feed(piece)
        if reader.buffered >= MAX_BYTES:
            return f"{reader.buffered} bytes are buffered, in pieces of up to {most}"
    frames += reader.rescan()
    if frames != expected:
        return f"other frames in pieces of up to {most}"
    return f"other counts in pieces of up to {most}" if reader.counts != counts else ""


def _with_pauses(data: bytes, rng: random.Random) -> str:
    """Check that pauses lose cut frames but never invent one."""
    reader = FrameReader(KEY)
    for piece in pieces(data, rng, 20_000):
        for frame in reader.feed(piece) + reader.rescan():
            if literal_length(data, frame.offset) != frame.length:
                return f"no frame is at {frame.offset}, with pauses"
    return ""


def _to_samples(data: bytes, rng: random.Random) -> str:
    """Decode as dji_node does, with pauses; every value of a sample must be finite."""
    decoder, interpreter = SerialDecoder(_CONFIG, PackageTable()), Interpreter(_CONFIG)
    samples: list[Sample] = []
    now_ns = _START_NS
    for piece in pieces(data, rng, 2000):
        for part in (piece, b""):
            now_ns += rng.randrange(_STEP_NS)
            for reading in decoder.take(part, now_ns, now_ns * 1e-9):
                samples += interpreter.take(reading)
    samples += interpreter.flush()
    assert decoder.diagnostics
    assert interpreter.diagnostics
    for sample in samples:
        values = (getattr(sample, field.name) for field in fields(sample))
        if not all(np.isfinite(v).all() for v in values if isinstance(v, (float, np.ndarray))):
            return f"not finite: {sample}"
    return ""


def fuzz(size: int, seed: int, progress: Report) -> Result:
    """Test stretches with successive seeds, until ``size`` bytes or a difference."""
    total = Result()
    while total.bytes < size and not total.difference:
        rng = random.Random(seed)  # noqa: S311 a test, no secret
        try:
            part = stretch(damaged_stream(rng, STRETCH_BYTES), rng)
        except Exception:
            sys.stderr.write(f"fuzz: raised by --seed {seed} --bytes 1\n")
            raise
        total.bytes += part.bytes
        total.frames += part.frames
        if part.difference:
            total.difference = f"{part.difference} (again: --seed {seed} --bytes 1)"
        seed += 1
        progress(total.bytes * 1e-6, size * 1e-6)
    return total


def main(argv: Sequence[str] | None = None) -> int:
    """Run and print the result."""
    parser = argparse.ArgumentParser(prog="python -m dev.fuzz")
    parser.add_argument("--bytes", type=float, default=1e8, metavar="N", help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the first stretch")
    args = parser.parse_args(argv)
    with Progress("fuzz", "MB") as bar:
        total = fuzz(round(args.bytes), args.seed, bar)
    outcome = total.difference or "no difference"
    sys.stdout.write(f"{total.bytes * 1e-6:g} MB, {total.frames} frames: {outcome}\n")
    return 1 if total.difference else 0


if __name__ == "__main__":
    sys.exit(main())
