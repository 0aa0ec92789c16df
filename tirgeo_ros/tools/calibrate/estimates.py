"""Format estimated parameters for people: on the screen, and as the head of a parameter file.

An estimate is a mapping with ``key`` (node and name of the parameter that holds it), ``unit``
(deg, ms or m) and, in this unit, ``before``, ``found``, ``sigma``, and perhaps ``left_out``, the
rms change without a sixth of the flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

#: Unit -> how many of it make one rad, s or m.
PER_UNIT = {"deg": math.degrees(1.0), "ms": 1e3, "m": 1.0}
_DIGITS = {"deg": 3, "ms": 1, "m": 3}
_COLUMNS = ("before", "found", "sigma", "left_out")

Estimates = Mapping[str, Mapping[str, Any]]


def estimate(key: str, unit: str, *numbers: float) -> dict[str, Any]:
    """Return an estimate of numbers in rad, s or m, in the order of the columns."""
    columns = zip(_COLUMNS, numbers, strict=False)
    return {"key": key, "unit": unit} | {c: float(x) * PER_UNIT[unit] for c, x in columns}


def table(estimates: Estimates) -> list[str]:
    """Return the lines of a table: a parameter each, with the numbers that there are."""
    columns = [name for name in _COLUMNS if all(name in one for one in estimates.values())]
    titles = "".join(f"{name.replace('_', ' '):>10}" for name in columns)
    lines = [f"{'parameter':<18}{titles}       key"]
    for name, one in estimates.items():
        numbers = "".join(f"{one[key]:>10.{_DIGITS[one['unit']]}f}" for key in columns)
        lines.append(f"{name:<18}{numbers} {one['unit']:<5} {one['key']}")
    return lines


def head(command: str, bag: object, lines: Sequence[str], notes: Sequence[str]) -> str:
    """Return the head of a parameter file."""
    first = f"Written by 'tirgeo calibrate {command}' from {bag}."
    return "\n".join([first, *lines, *(f"note: {note}" for note in notes)])


def described(lines: Sequence[str], result: Mapping[str, Any]) -> str:
    """Return the text for the screen: lines, notes and the files written."""
    notes = [f"note: {note}" for note in result["notes"]]
    return "\n".join([*lines, *notes, *(f"wrote {path}" for path in result["output"])])
