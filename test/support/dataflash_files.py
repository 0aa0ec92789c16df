"""Write binary DataFlash logs as ArduPilot does: each message's format, then its records."""

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
        size = 3 + struct.calcsize("<" + "".join(_LETTERS[one][0] for one in letters))
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
