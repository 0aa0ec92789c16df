"""Decode many ``sensor_msgs/Imu`` at once from their CDR, for records of hours.

All of an Imu but its header has a fixed length, so byte order and length of ``frame_id`` determine
the layout. Messages of one layout are read as one array.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array

_MARKS = {b"\0\1": "<", b"\0\0": ">"}
_BEHIND_HEADER = 4 + 9 + 3 + 9 + 3 + 9  # numbers: orientation, rate, acceleration; covariances
_RATE = 4 + 9
_FORCE = _RATE + 3 + 9
_FRAME_AT = 4 + 8  # of the frame's length, after encapsulation and stamp
_ABSENT = -1.0  # first entry of a covariance whose value is absent


class ImuBlock(NamedTuple):
    """Hold samples in the order of their messages, FLU as in the message."""

    stamps_ns: npt.NDArray[np.int64]  # (n,)
    values: Array  # (n, 6) angular rate (rad/s), specific force (m/s2); NaN where absent
    unreadable: int  # messages that are no Imu


def imu_block(messages: Sequence[bytes]) -> ImuBlock:
    """Decode these CDR messages, as far as they are readable."""
    stamps_ns = np.zeros(len(messages), np.int64)
    values = np.zeros((len(messages), 6))
    readable = np.zeros(len(messages), bool)
    for (mark, frame, size), places in _layouts(messages).items():
        layout = _layout(_MARKS[mark], frame, size)
        rows = np.frombuffer(b"".join(messages[k] for k in places), layout)
        numbers = rows["numbers"].astype(float)
        for first, at in ((0, _RATE), (3, _FORCE)):
            values[places, first : first + 3] = numbers[:, at : at + 3]
            absent = numbers[:, at + 3] == _ABSENT
            values[np.array(places)[absent], first : first + 3] = np.nan
        stamps_ns[places] = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        readable[places] = True
    return ImuBlock(stamps_ns[readable], values[readable], int((~readable).sum()))


def _layouts(messages: Sequence[bytes]) -> dict[tuple[bytes, int, int], list[int]]:
    """Return the message indices for each byte order, length of the frame, and length."""
    found: dict[tuple[bytes, bytes, int], list[int]] = defaultdict(list)
    for place, data in enumerate(messages):
        found[data[:2], data[_FRAME_AT : _FRAME_AT + 4], len(data)].append(place)
    sound = {}
    for (mark, length, size), places in found.items():
        if mark in _MARKS and len(length) == 4:
            (frame,) = struct.unpack(_MARKS[mark] + "I", length)
            if _numbers_at(frame) + 8 * _BEHIND_HEADER <= size:
                sound[mark, frame, size] = places
    return sound


def _numbers_at(frame: int) -> int:
    """Return the offset of the numbers: aligned to 8 from the end of the encapsulation on."""
    return 4 + (8 + 4 + frame + 7) // 8 * 8


@cache
def _layout(order: str, frame: int, size: int) -> np.dtype[Any]:
    return np.dtype(
        {
            "names": ["sec", "nanosec", "numbers"],
            "formats": [f"{order}i4", f"{order}u4", (f"{order}f8", (_BEHIND_HEADER,))],
            "offsets": [4, 8, _numbers_at(frame)],
            "itemsize": size,
        }
    )
