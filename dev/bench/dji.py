"""The speed of the serial link's decoder, beside bare calls over the same bytes and the line's."""

from __future__ import annotations

import random
import time
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from struct import Struct

from dev.judging import Figure
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.broadcast import Layout, broadcast_length, decode_broadcast
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

    def frames_in(read: int) -> int:
        return sum(map(len, _framed(whole, read)))

    decoded = {read: speed(partial(decode, whole, read)) for read in (FILE_READ, PORT_READ)}
    framed = {read: speed(partial(frames_in, read)) for read in decoded}
    return [
        *(Figure(f"DJI: decoded, reads of {k} B", v, "MB/s", ">= 2") for k, v in decoded.items()),
        *(Figure(f"DJI: frames alone, reads of {k} B", v, "MB/s") for k, v in framed.items()),
        Figure("DJI: bare zlib.crc32 and struct", speed(partial(_bare, frames)), "MB/s"),
        Figure(
            "DJI: decoded over the line of 1 Mbaud", decoded[FILE_READ] / LINE_MB_S, "x", ">= 20"
        ),
    ]


def capture(seconds: int) -> Iterator[bytes]:
    """The frames of an aircraft that sends all it can, in the order in which they come.

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
    """Every field of every frame, from reads of so many bytes; how many frames."""
    table, decoded = PackageTable(), 0
    for frames in _framed(whole, read):
        for frame in frames:
            found = (
                decode_push(frame.value, table)
                if frame.cmd_id == 5
                else decode_broadcast(frame.value)
            )
            decoded += found is not None
    return decoded


def _framed(whole: bytes, read: int) -> Iterator[list[ProtocolFrame]]:
    reader = FrameReader()
    for at in range(0, len(whole), read):
        yield reader.feed(whole[at : at + read])


def _bare(frames: list[bytes]) -> int:
    """A check sum and numbers of four bytes from each frame, which stands alone already."""
    layouts = {size: Struct(f"<{size // 4}f") for size in set(map(len, frames))}
    for whole in frames:
        zlib.crc32(whole)
        layouts[len(whole)].unpack_from(whole)
    return len(frames)


def _speed(work: Callable[[], int], size: int, expected: int) -> float:
    begun = time.perf_counter()
    done = work()
    seconds = time.perf_counter() - begun
    assert done == expected
    return size * 1e-6 / seconds
