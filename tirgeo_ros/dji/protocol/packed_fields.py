"""Pack and unpack a sequence of parts that follow one another without gaps."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from tirgeo_ros.core.types.errors import DjiError

Make = Callable[[tuple[Any, ...]], Any]


class PackedFields:
    """Convert between bytes and the parts (name, ``struct`` form, maker from its numbers).

    ``head`` is the form of the numbers before the parts, with the byte order.
    """

    def __init__(self, head: str, parts: Iterable[tuple[str, str, Make]]) -> None:
        self._first = at = _numbers(head)
        self._parts = []
        for name, form, make in parts:
            head, start, at = head + form, at, at + _numbers(f"<{form}")
            self._parts.append((name, start, at, make))
        self._struct = struct.Struct(head)
        self.size = self._struct.size
        self.names = {name for name, *_ in self._parts}

    def unpack(self, value: bytes) -> tuple[tuple[int, ...], dict[str, Any]]:
        """Return the numbers before the parts, and the parts by name."""
        numbers = self._struct.unpack(value)
        parts = {name: make(numbers[start:stop]) for name, start, stop, make in self._parts}
        return numbers[: self._first], parts

    def pack(self, head: Sequence[int | None], values: Mapping[str, Any], what: str) -> bytes:
        """Return the bytes. Raises DjiError, naming ``what``, for what does not fit."""
        numbers: list[Any] = [*head]
        for name, start, stop, _ in self._parts:
            part = _flat(values.get(name))
            if len(part) != stop - start:
                raise DjiError(f"{what}: {name} needs {stop - start} numbers")
            numbers += part
        try:
            return self._struct.pack(*numbers)
        except (struct.error, OverflowError) as error:
            raise DjiError(f"{what} cannot be sent: {error}") from None


def _numbers(form: str) -> int:
    return len(struct.unpack(form, bytes(struct.calcsize(form))))


def _flat(part: Any) -> list[Any]:
    """Return the numbers of a part in the order of their bytes, without None."""
    if isinstance(part, tuple):
        return [number for item in part for number in _flat(item)]
    return [] if part is None else [part]
