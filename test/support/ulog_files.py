"""Write ULog files as PX4's logger does (ULog format, version 1), of tables of records."""

from __future__ import annotations

import struct
from pathlib import Path

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

    def dropout(self, milliseconds: int) -> None:
        """Add the mark of lost data."""
        self._data.append(_message(b"O", struct.pack("<H", milliseconds)))

    def write(self, path: Path) -> Path:
        """Write the file."""
        parts = [MAGIC, struct.pack("<Q", self._boot_us), _message(b"B", bytes(40))]
        for name, fields in self._formats.items():
            parts.append(_message(b"F", f"{name}:{fields};".encode()))
        parts += [_message(b"P", one) for one in self._parameters]
        path.write_bytes(b"".join([*parts, *self._data]))
        return path


def _message(kind: bytes, payload: bytes) -> bytes:
    return struct.pack("<H", len(payload)) + kind + payload
