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
"""Encode and decode CDR of ROS 2 Jazzy without ROS, from the definitions of its messages.

A message type is compiled into steps: runs of numbers, which one ``struct`` reads or writes at
once, strings, arrays and sequences. CDR aligns each number to its own size from the end of the
four bytes of encapsulation, so a run has a ``struct`` for each of the eight positions that it may
begin at (OMG DDS-XTypes 1.3, 7.4.1, the plain encoding of version 1).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import make_dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import BagError, MessageError

#: Raised by the decoders for bytes that are not a message of the type.
UNREADABLE = (AssertionError, IndexError, OverflowError, struct.error, ValueError)
#: Fast CDR sends up to 7 surplus bytes, with arbitrary content, for each empty list.
_MOST_SURPLUS = 64
#: The definition of each message of Jazzy, one after another as MCAP's schemas have them.
_DEFINITIONS = Path(__file__).with_name("interfaces_jazzy.txt")
_SEPARATOR = "=" * 80 + "\n"
#: Type, bound of a string, size of an array, name; a constant has a ``=`` after its name.
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(?:(\[)((?:<=)?\d*)\])? (\w+)$")
_CONSTANT = re.compile(r"^\w+ (\w+)=(.+)$", re.MULTILINE)
_CODES = {"bool": "?", "byte": "B", "char": "B", "float32": "f", "float64": "d"}
_CODES |= {f"int{8 * 2**k}": code for k, code in enumerate("bhiq")}
_CODES |= {f"uint{8 * 2**k}": code for k, code in enumerate("BHIQ")}
_LENGTH = ("I",)

#: Appends the values that it reads from the data at a position; returns the position after them.
_Read = Callable[[memoryview, int, list[Any]], int]
#: Appends to the data what it writes of the next values.
_Write = Callable[[bytearray, Iterator[Any]], None]


class _Order:
    """Read and write values in one order of bytes: ``<`` or ``>``."""

    def __init__(self, mark: str) -> None:
        self._mark = mark

    def run(self, codes: tuple[str, ...]) -> tuple[_Read, _Write]:
        """Return reader and writer of numbers that follow each other."""
        structs = [struct.Struct(self._mark + _padded(codes, phase)) for phase in range(8)]

        def read(data: memoryview, at: int, values: list[Any]) -> int:
            numbers = structs[at & 7]
            values += numbers.unpack_from(data, at)
            return at + numbers.size

        def write(data: bytearray, values: Iterator[Any]) -> None:
            data += structs[len(data) - 4 & 7].pack(*islice(values, len(codes)))

        return read, write

    def string(self) -> tuple[_Read, _Write]:
        """Return reader and writer of a string."""
        read_length, write_length = self.run(_LENGTH)

        def read(data: memoryview, at: int, values: list[Any]) -> int:
            begin = read_length(data, at, values)
            end: int = begin + values.pop()
            if not begin < end <= len(data):
                raise ValueError("a string is longer than the message")
            values.append(str(data[begin : end - 1], "utf-8"))
            return end

        def write(data: bytearray, values: Iterator[Any]) -> None:
            text = next(values).encode() + b"\0"
            write_length(data, iter([len(text)]))
            data += text

        return read, write

    def numbers(self, code: str, size: int | None) -> tuple[_Read, _Write]:
        """Return reader and writer of numbers in an array; ``size`` is None if it may vary."""
        kind = np.dtype(self._mark + code)
        read_length, write_length = self.run(_LENGTH)

        def read(data: memoryview, at: int, values: list[Any]) -> int:
            count = size
            if count is None:
                at = read_length(data, at, values)
                count = values.pop()
            at += -at % kind.itemsize if count else 0
            values.append(np.frombuffer(data, kind, count, at) if count else np.zeros(0, kind))
            return at + count * kind.itemsize

        def write(data: bytearray, values: Iterator[Any]) -> None:
            array = np.asarray(next(values), kind)
            if size is None:
                write_length(data, iter([len(array)]))
            elif array.shape != (size,):
                raise ValueError(f"{array.shape} numbers where {size} are needed")
            if len(array):
                data += bytes(-(len(data) - 4) % kind.itemsize)
                data += np.ascontiguousarray(array).data.cast("B")

        return read, write

    def items(self, codec: _Codec, size: int | None) -> tuple[_Read, _Write]:
        """Return reader and writer of messages or strings in a list."""
        read_length, write_length = self.run(_LENGTH)

        def read(data: memoryview, at: int, values: list[Any]) -> int:
            count, items = size, []
            if count is None:
                at = read_length(data, at, values)
                count = values.pop()
            for _ in range(count):
                item, at = codec.read(data, at)
                items.append(item)
            values.append(items)
            return at

        def write(data: bytearray, values: Iterator[Any]) -> None:
            items = next(values)
            if size is None:
                write_length(data, iter([len(items)]))
            elif len(items) != size:
                raise ValueError(f"{len(items)} items where {size} are needed")
            for item in items:
                codec.write(data, item)

        return read, write


def _padded(codes: tuple[str, ...], phase: int) -> str:
    """Return the format of numbers that begin ``phase`` bytes after a multiple of eight."""
    parts, at = [], phase
    for code in codes:
        size = struct.calcsize(f"<{code}")
        parts.append("x" * (-at % size) + code)
        at += -at % size + size
    return "".join(parts)


class _Codec:
    """Read and write one type: its steps, and how its values make a message."""

    def __init__(
        self,
        steps: list[tuple[_Read, _Write]],
        build: Callable[[Iterator[Any]], Any],
        flatten: Callable[[Any, list[Any]], None],
    ) -> None:
        self._readers = [read for read, _ in steps]
        self._writers = [write for _, write in steps]
        self._build, self._flatten = build, flatten

    def read(self, data: memoryview, at: int) -> tuple[Any, int]:
        """Return the message at a position, and the position after it."""
        values: list[Any] = []
        for read in self._readers:
            at = read(data, at, values)
        return self._build(iter(values)), at

    def write(self, data: bytearray, message: Any) -> None:
        """Append a message."""
        values: list[Any] = []
        self._flatten(message, values)
        left = iter(values)
        for write in self._writers:
            write(data, left)


class _Field(NamedTuple):
    """Hold a field of a message type."""

    name: str
    kind: str  # of a number or string as the definition has it, of a message its type's name
    is_array: bool
    size: int | None  # of an array; None if it may vary


#: The fields of a message without any.
_EMPTY = (_Field("structure_needs_at_least_one_member", "uint8", False, None),)


@cache
def _texts() -> dict[str, str]:
    """Return the text of each definition by the type's name."""
    parts = _DEFINITIONS.read_text(encoding="utf-8").split(_SEPARATOR)
    heads = (part.partition("\n") for part in parts)
    return {head.removeprefix("MSG: "): text for head, _, text in heads}


@cache
def _fields(typename: str) -> tuple[_Field, ...]:
    """Return the fields of a type, without constants. Raises BagError for an unknown one."""
    if typename not in _texts():
        raise BagError(f"message type {typename} is not known")
    matches = filter(None, map(_FIELD.match, _texts()[typename].splitlines()))
    return tuple(map(_field, matches)) or _EMPTY


def _field(match: re.Match[str]) -> _Field:
    kind, bracket, size, name = match.groups()
    fixed = int(size) if size and size.isdigit() else None
    return _Field(name, kind.replace("/", "/msg/"), bool(bracket), fixed)


@cache
def _class(typename: str) -> type:
    """Return the class of a type's messages, with the type's constants."""
    constants = {name: int(text) for name, text in _CONSTANT.findall(_texts()[typename])}
    names = [field.name for field in _fields(typename)]
    name = typename.replace("/", "__")
    return make_dataclass(name, names, namespace={"__msgtype__": typename, **constants})


@cache
def _codec(typename: str, mark: str) -> _Codec:
    order = _Order(mark)
    steps: list[tuple[_Read, _Write]] = []
    run: list[str] = []

    def end_run() -> None:
        if run:
            steps.append(order.run(tuple(run)))
            run.clear()

    def add(name: str) -> tuple[Callable[[Iterator[Any]], Any], Callable[[Any, list[Any]], None]]:
        """Append the steps of a type; return what makes a message of values, and the reverse."""
        parts: list[Any] = []
        for field in _fields(name):
            if field.is_array:
                end_run()
                steps.append(_array_step(order, field, mark))
            elif field.kind == "string":
                end_run()
                steps.append(order.string())
            elif field.kind in _CODES:
                run.append(_CODES[field.kind])
            else:
                parts.append((field.name, *add(field.kind)))
                continue
            parts.append((field.name, next, None))
        return _builder(_class(name), parts), _flattener(parts)

    build, flatten = add(typename)
    end_run()
    return _Codec(steps, build, flatten)


def _array_step(order: _Order, field: _Field, mark: str) -> tuple[_Read, _Write]:
    if field.kind in _CODES:
        return order.numbers(_CODES[field.kind], field.size)
    if field.kind == "string":
        return order.items(_Codec([order.string()], next, _append), field.size)
    return order.items(_codec(field.kind, mark), field.size)


def _append(value: Any, values: list[Any]) -> None:
    values.append(value)


def _builder(cls: type, parts: list[Any]) -> Callable[[Iterator[Any]], Any]:
    makers = [make for _, make, _ in parts]
    if all(make is next for make in makers):
        count = range(len(makers))
        return lambda values: cls(*[next(values) for _ in count])
    return lambda values: cls(*[make(values) for make in makers])


def _flattener(parts: list[Any]) -> Callable[[Any, list[Any]], None]:
    fields = [(name, flatten or _append) for name, _, flatten in parts]

    def flatten(message: Any, values: list[Any]) -> None:
        for name, take in fields:
            take(getattr(message, name), values)

    return flatten


def header_stamp_ns(data: bytes) -> int:
    """Return the stamp (ns) of a message that begins with a header. Raises MessageError."""
    try:
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] else ">iI", data, 4)
    except (IndexError, struct.error):
        raise MessageError(f"{len(data)} bytes are too few for a header") from None
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Cdr:
    """Serialise and deserialise messages by type name (``sensor_msgs/msg/Imu``)."""

    @staticmethod
    def types(typename: str) -> type:
        """Return the message class. Raises BagError for a type that is none of Jazzy's."""
        _fields(typename)
        return _class(typename)

    def __contains__(self, typename: str) -> bool:
        """Return whether a type is known."""
        return typename in _texts()

    @staticmethod
    def serialize(message: Any, typename: str = "") -> bytes:
        """Return a message as CDR, little endian, with its encapsulation header.

        ``typename`` is needed for a message of another class than that of ``types``.
        """
        data = bytearray(b"\0\1\0\0")
        _codec(typename or message.__msgtype__, "<").write(data, message)
        return bytes(data)

    @staticmethod
    def deserialize(data: bytes, typename: str, topic: str = "") -> Any:
        """Decode CDR bytes. Raises MessageError naming ``topic`` if they are no such message."""
        marks = {b"\0\1": "<", b"\0\0": ">"}
        try:
            if data[:2] not in marks:
                raise ValueError("no plain CDR")
            body = memoryview(data)[4:]
            message, end = _codec(typename, marks[data[:2]]).read(body, 0)
        except UNREADABLE as error:
            raise MessageError(
                f"{topic or typename}: {len(data)} bytes are no {typename}: {error}"
            ) from None
        surplus = len(body) - end
        if surplus > _MOST_SURPLUS:
            raise MessageError(
                f"{topic or typename}: {surplus} bytes are left over after a {typename}"
            )
        return message

    @staticmethod
    def definition(typename: str) -> str:
        """Return the text of the definition with all parts, as an MCAP schema holds it."""
        first, *others = _with_parts(typename, [])
        texts = (f"MSG: {name.replace('/msg/', '/')}\n{_texts()[name]}" for name in others)
        return _SEPARATOR.join([_texts()[first], *texts])


def _with_parts(typename: str, names: list[str]) -> list[str]:
    """Add a type and those of its fields to a list, each once, and return the list."""
    if typename not in names:
        names.append(typename)
        for field in _fields(typename):
            if "/" in field.kind:
                _with_parts(field.kind, names)
    return names
