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
"""Write logs as autopilots do: DataFlash (ArduPilot, binary) and ULog (PX4, version 1)."""

from __future__ import annotations

import struct
from pathlib import Path

_HEAD = b"\xa3\x95"
_FMT = 0x80
#: ArduPilot's letters, those of ``struct``, and by how much an integer is larger than the value.
_LETTERS = {"Q": ("Q", 1), "B": ("B", 1), "I": ("I", 1), "H": ("H", 1), "f": ("f", 1)}
_LETTERS |= {"L": ("i", 1e7), "e": ("i", 100), "c": ("h", 100), "C": ("H", 100), "N": ("16s", 1)}


class DataflashFile:
    """Collect records, and write them in the order in which they were added."""

    def __init__(self) -> None:
        self._types: dict[str, tuple[int, str]] = {}
        self._parts: list[bytes] = []
        self._format(_FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)

    def message(self, name: str, letters: str, columns: str) -> None:
        """Define a message: a letter and a column for each field."""
        number = len(self._types) + 1
        self._types[name] = number, letters
        size = 3 + struct.calcsize("<" + "".join(_LETTERS[item][0] for item in letters))
        self._format(number, name, letters, columns, size)

    def add(self, name: str, *values: float | str) -> None:
        """Add a record: its fields in the order of their definition."""
        number, letters = self._types[name]
        packed = _HEAD + bytes([number])
        for letter, value in zip(letters, values, strict=True):
            code, scale = _LETTERS[letter]
            if isinstance(value, str):
                packed += struct.pack("<16s", value.encode())
            else:
                packed += struct.pack(f"<{code}", value if scale == 1 else round(value * scale))
        self._parts.append(packed)

    def write(self, path: Path) -> Path:
        """Write the file."""
        path.write_bytes(b"".join(self._parts))
        return path

    def _format(self, number: int, name: str, letters: str, columns: str, size: int) -> None:
        texts = name.encode(), letters.encode(), columns.encode()
        self._parts.append(
            _HEAD + bytes([_FMT]) + struct.pack("<BB4s16s64s", number, size, *texts)
        )


MAGIC = b"ULog\x01\x12\x35\x01"
_FORMATS = {"uint64_t": "Q", "int64_t": "q", "int32_t": "i", "float": "f", "double": "d"}
_FORMATS |= {"uint8_t": "B", "bool": "?", "uint32_t": "I"}


class UlogFile:
    """Collect records of topics, and write them in the order in which they were added."""

    def __init__(self, boot_us: int = 20_000_000) -> None:
        self._boot_us = boot_us
        self._formats: dict[str, str] = {}
        self._packed: dict[str, str] = {}
        self._ids: dict[tuple[str, int], int] = {}
        self._parameters: list[bytes] = []
        self._data: list[bytes] = []

    def topic(self, name: str, fields: str) -> None:
        """Define a topic: fields as ``uint64_t timestamp;float[3] gyro_rad``."""
        self._formats[name] = fields
        pairs = [field.split() for field in fields.split(";")]
        self._packed[name] = "<" + "".join(
            _FORMATS[kind.partition("[")[0]] * int(kind.partition("[")[2].rstrip("]") or 1)
            for kind, _ in pairs
        )

    def parameter(self, name: str, value: float) -> None:
        """Add a parameter."""
        key = f"float {name}".encode()
        self._parameters.append(bytes([len(key)]) + key + struct.pack("<f", value))

    def add(self, name: str, *values: float, instance: int = 0) -> None:
        """Add a record: its fields in the order of their definition."""
        if (name, instance) not in self._ids:
            number = self._ids[name, instance] = len(self._ids)
            subscribed = struct.pack("<BH", instance, number) + name.encode()
            self._data.append(_message(b"A", subscribed))
        record = struct.pack(self._packed[name], *values)
        self._data.append(_message(b"D", struct.pack("<H", self._ids[name, instance]) + record))

    def write(self, path: Path) -> Path:
        """Write the file."""
        parts = [MAGIC, struct.pack("<Q", self._boot_us), _message(b"B", bytes(40))]
        for name, fields in self._formats.items():
            parts.append(_message(b"F", f"{name}:{fields};".encode()))
        parts += [_message(b"P", item) for item in self._parameters]
        path.write_bytes(b"".join([*parts, *self._data]))
        return path


def _message(kind: bytes, payload: bytes) -> bytes:
    return struct.pack("<H", len(payload)) + kind + payload
