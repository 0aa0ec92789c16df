"""Sort the messages of a bag's parts by time, with a bound on those that wait."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from tirgeo_ros.core.types.errors import BagError

#: The most bytes that may wait. Parts of a recording overlap by a second or so.
MOST_BYTES = 384 << 20
_BESIDE_BYTES = 600  # memory of a message in addition to its data

M = TypeVar("M")  # a message of a bag, with its bytes as ``data``
#: A message preceded by its sort keys: time, then its place in the file.
Placed = tuple[int, int, int, M]


def in_time_order(parts: Iterable[tuple[int, Iterable[Placed[M]]]], name: object) -> Iterator[M]:
    """Yield the messages of parts, which come in the order of their first times (ns).

    Raises BagError, naming ``name``, if too many overlap.
    """
    waiting: list[Placed[M]] = []
    for start_ns, loaded in parts:
        ready = bisect_left(waiting, (start_ns,))
        yield from (message for *_, message in waiting[:ready])
        del waiting[:ready]
        room = MOST_BYTES - sum(_size(message) for *_, message in waiting)
        for placed in loaded:
            room -= _size(placed[3])
            if room < 0:
                raise BagError(
                    f"{name}: more than {MOST_BYTES >> 20} MiB of messages overlap in time; "
                    "write it anew in order of time, in chunks of a megabyte (mcap sort)"
                )
            waiting.append(placed)
        waiting.sort()
    yield from (message for *_, message in waiting)


def _size(message: Any) -> int:
    return len(message.data) + _BESIDE_BYTES
