"""Pack and unpack a sequence of parts that follow one another without gaps."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

Make = Callable[[tuple[Any, ...]], Any]


class PackedFields:
    """Convert between bytes and the parts (name, ``struct`` form, maker from its numbers).

    ``head`` is the form of the numbers before the parts, with the byte order.
    """

    def __init__(self, head: str, parts: Iterable[tuple[str, str, Make]]) -> None:
        at = _numbers(head)
        #: Name, first and last + 1 of its numbers, and maker of each part. The decoders loop over
        #: them themselves: this runs hundreds of times a second.
        self.parts: list[tuple[str, int, int, Make]] = []
        for name, form, make in parts:
            head, start, at = head + form, at, at + _numbers(f"<{form}")
            self.parts.append((name, start, at, make))
        self._struct = struct.Struct(head)
        self.size = self._struct.size
        self.numbers = self._struct.unpack  # bytes in, all numbers out

    def pack(self, head: Sequence[int | None], values: Mapping[str, Any]) -> bytes:
        """Return the bytes. Raises struct.error for what does not fit."""
        parts = [number for name, *_ in self.parts for number in _flat(values.get(name))]
        return self._struct.pack(*head, *parts)


def _numbers(form: str) -> int:
    return len(struct.unpack(form, bytes(struct.calcsize(form))))


def _flat(part: Any) -> list[Any]:
    """Return the numbers of a part in the order of their bytes, without None."""
    if isinstance(part, tuple):
        return [number for item in part for number in _flat(item)]
    return [] if part is None else [part]
