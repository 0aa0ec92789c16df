"""Format estimated parameters for people, as a table and as the head of a parameter file.

An estimate is a mapping with ``unit`` (deg, ms or m) and, in this unit, ``before``, ``found``,
``sigma``, and perhaps ``left_out``, the rms change without a sixth of the flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

#: Unit -> how many of it make one rad, s or m.
PER_UNIT = {"deg": math.degrees(1.0), "ms": 1e3, "m": 1.0}
_DIGITS = {"deg": 3, "ms": 1, "m": 3}
_COLUMNS = ("before", "found", "sigma", "left_out")

Estimates = Mapping[str, Mapping[str, Any]]


def table(estimates: Estimates) -> list[str]:
    """Return the lines of a table: a parameter each, with the numbers that there are."""
    columns = [name for name in _COLUMNS if all(name in one for one in estimates.values())]
    titles = "".join(f"{name.replace('_', ' '):>10}" for name in columns)
    lines = [f"{'parameter':<20}{titles}"]
    for name, one in estimates.items():
        numbers = "".join(f"{one[key]:>10.{_DIGITS[one['unit']]}f}" for key in columns)
        lines.append(f"{name:<20}{numbers} {one['unit']}")
    return lines


def head_lines(estimates: Estimates) -> list[str]:
    """Return a line each for the head of a parameter file."""
    lines = []
    for name, one in estimates.items():
        text = {key: f"{one[key]:.{_DIGITS[one['unit']]}f}" for key in _COLUMNS if key in one}
        apart = "; without a sixth of the flight {left_out} off" if "left_out" in one else ""
        form = "{found} +- {sigma} {unit} (before {before}" + apart + ")"
        lines.append(f"{name}: {form.format(unit=one['unit'], **text)}")
    return lines


def closing_lines(result: Mapping[str, Any]) -> list[str]:
    """Return what every calibration says last: its notes and the files written."""
    return [
        *(f"note: {note}" for note in result["notes"]),
        *(f"wrote {path}" for path in result["output"]),
    ]


def by_reason(reasons: Iterable[tuple[str, str]]) -> str:
    """Return pairs of name and reason as one text, each reason once."""
    names: dict[str, list[str]] = {}
    for name, reason in reasons:
        names.setdefault(reason, []).append(name)
    return "; ".join(f"{', '.join(some)}: {reason}" for reason, some in names.items())
