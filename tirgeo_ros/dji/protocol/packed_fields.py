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

    def __init__(self, head: str, parts: Iterable[Sequence[Any]]) -> None:
        at = _numbers(head)
        self._parts: list[tuple[str, int, int, Make]] = []  # with first and last + 1 number
        for name, form, make in parts:
            head, start, at = head + form, at, at + _numbers(f"<{form}")
            self._parts.append((name, start, at, make))
        self._struct = struct.Struct(head)
        self._unpack = self._struct.unpack
        self.size = self._struct.size

    def unpack(self, value: bytes) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Return all numbers, those of the head first, and the parts by name."""
        numbers = self._unpack(value)
        return numbers, {
            name: make(numbers[start:stop]) for name, start, stop, make in self._parts
        }

    def pack(self, head: Sequence[int | None], values: Mapping[str, Any]) -> bytes:
        """Return the bytes. Raises struct.error for what does not fit."""
        parts = [number for name, *_ in self._parts for number in _flat(values.get(name))]
        return self._struct.pack(*head, *parts)


def _numbers(form: str) -> int:
    return len(struct.unpack(form, bytes(struct.calcsize(form))))


def _flat(part: Any) -> list[Any]:
    """Return the numbers of a part in the order of their bytes, without None."""
    if isinstance(part, tuple):
        return [number for item in part for number in _flat(item)]
    return [] if part is None else [part]
