"""Convert results to lines and to JSON's types, and errors to the one line that a person gets."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping


def summary(lines: Iterable[tuple[str, str, bool]]) -> str:
    """Return lines of a name and a text; those that report a problem first, with a mark."""
    ordered = sorted(lines, key=lambda line: not line[2])  # stable
    width = max((len(name) for name, _, _ in ordered), default=0)
    return "\n".join(
        f"{'!' if is_problem else ' '} {name:<{width}}  {text}"
        for name, text, is_problem in ordered
    )


def plain(value: object) -> object:
    """Return the value in JSON's types: NaN and infinities as None, arrays as lists, else text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars, without importing NumPy
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def error_line(error: Exception) -> str:
    """Return the line of a TirgeoError, or of an OSError with its file in front."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{os.fsdecode(error.filename)}: {error.strerror}"
    return str(error)
