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
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import cycle

import numpy as np

from dev.dji_damage import KEY, damaged_stream
from tirgeo_ros.core.config.dji_parameters import DjiConfig, DjiHostConfig
from tirgeo_ros.dji.interpret.interpreter import Interpreter, Sample
from tirgeo_ros.dji.link.framing import (
    HEADER_BYTES,
    MAX_BYTES,
    MIN_BYTES,
    FrameReader,
    ProtocolFrame,
    crc16,
    crc32,
)
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.sources.serial import SerialDecoder
from tirgeo_ros.tools.presentation.progress import Progress, Report

STRETCH_BYTES = 250_000
#: Most bytes of a piece: as single bytes, as read from a serial port, as read from a file.
PIECES = (1, 3, 64, 512, 4096, STRETCH_BYTES)
#: The host requests all that it can, so that answers are tested as well.
_CONFIG = DjiConfig(
    key=KEY.hex(), host=DjiHostConfig(app_id=1, broadcast_rates=(4,) * 16, subscribe=True)
)
_START_NS, _STEP_NS = 1_700_000_000_000_000_000, 70_000_000  # two pauses of seven are long


@dataclass
class Found:
    """Hold the results of one stretch or of many."""

    bytes: int = 0
    frames: int = 0
    seconds: float = 0.0  # of CPU, in the reader alone, all bytes at once
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
    found, at = [], 0
    while (at := data.find(0xAA, at)) >= 0:
        length = literal_length(data, at)
        if length:
            found.append((at, length))
        at += length or 1
    return found


def places(frames: Iterable[ProtocolFrame]) -> list[tuple[int, int]]:
    """Return offset and length of each frame."""
    return [(frame.offset, frame.length) for frame in frames]


def pieces(data: bytes, rng: random.Random, most: int) -> Iterable[bytes]:
    """Yield the bytes in pieces of 1 to ``most``."""
    sizes, at = cycle([rng.randint(1, most) for _ in range(997)]), 0
    while at < len(data):
        size = next(sizes)
        yield data[at : at + size]
        at += size


def stretch(data: bytes, rng: random.Random) -> Found:
    """Read ``data`` in every way; the result names the first difference."""
    reader = FrameReader(KEY)
    begun = time.process_time()
    frames = reader.feed(data) + reader.rescan()
    seconds = time.process_time() - begun
    wrong = (
        _against_the_rules(data, frames)
        or _in_pieces(data, rng, frames, reader.counts)
        or _with_pauses(data, rng)
        or _to_samples(data, rng)
    )
    return Found(len(data), len(frames), seconds, wrong)


def _against_the_rules(data: bytes, frames: Iterable[ProtocolFrame]) -> str:
    differing = set(places(frames)) ^ set(literal_frames(data))
    return f"at {min(differing)[0]} the rules give another frame" if differing else ""


def _in_pieces(
    data: bytes, rng: random.Random, expected: Sequence[ProtocolFrame], counts: dict[str, int]
) -> str:
    reader, most = FrameReader(KEY), rng.choice(PIECES)
    frames: list[ProtocolFrame] = []
    for piece in pieces(data, rng, most):
        frames += reader.feed(piece)
        if reader.held >= MAX_BYTES:
            return f"{reader.held} bytes are held, in pieces of up to {most}"
    frames += reader.rescan()
    if frames != expected:
        return f"other frames in pieces of up to {most}"
    return f"other counts in pieces of up to {most}" if reader.counts != counts else ""


def _with_pauses(data: bytes, rng: random.Random) -> str:
    """Check that pauses lose cut frames but never invent one."""
    reader = FrameReader(KEY)
    frames: list[ProtocolFrame] = []
    for piece in pieces(data, rng, 20_000):
        frames += reader.feed(piece) + reader.rescan()
    wrong = [at for at, length in places(frames) if literal_length(data, at) != length]
    return f"no frame is at {wrong[0]}, with pauses" if wrong else ""


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
        decoder.host.due(now_ns * 1e-9)
    samples += interpreter.flush()
    assert decoder.diagnostics
    assert interpreter.diagnostics
    wrong = next((sample for sample in samples if not _is_finite(sample)), None)
    return f"not finite: {wrong}" if wrong else ""


def _is_finite(sample: Sample) -> bool:
    values = (getattr(sample, field.name) for field in fields(sample))
    return all(np.isfinite(v).all() for v in values if isinstance(v, (float, np.ndarray)))


def fuzz(size: int, seed: int, progress: Report) -> Found:
    """Test stretches with successive seeds, until ``size`` bytes or a difference."""
    total = Found()
    while total.bytes < size and not total.difference:
        rng = random.Random(seed)  # noqa: S311 a test, no secret
        try:
            one = stretch(damaged_stream(rng, STRETCH_BYTES), rng)
        except Exception:
            sys.stderr.write(f"fuzz: raised by --seed {seed} --bytes 1\n")
            raise
        total.bytes += one.bytes
        total.frames += one.frames
        total.seconds += one.seconds
        if one.difference:
            total.difference = f"{one.difference} (again: --seed {seed} --bytes 1)"
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
        found = fuzz(round(args.bytes), args.seed, bar)
    speed = found.bytes * 1e-6 / found.seconds
    sys.stdout.write(
        f"{found.bytes * 1e-6:g} MB, {found.frames} frames, {speed:.1f} MB/s in the reader: "
        f"{found.difference or 'no difference'}\n"
    )
    return 1 if found.difference else 0


if __name__ == "__main__":
    sys.exit(main())
