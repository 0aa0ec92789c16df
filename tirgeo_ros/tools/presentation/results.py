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
"""Convert results and findings to lines, tables and JSON's types, and errors to one line."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict

from tirgeo_ros.core.types.finding import Finding, Severity

#: Keys of a result that are printed elsewhere, and keys that report a problem.
_ELSEWHERE = ("findings", "warning", "error")
_PROBLEMS = ("refused", "not_used")
_UNITS = {"m": "m", "s": "s", "ms": "ms", "deg": "deg", "px": "px", "hz": "Hz", "ns": "ns"}
#: Severity -> its name for a person.
_NAMES = {Severity.STOP: "fault", Severity.CAUTION: "caution", Severity.NOTE: "note"}


def summary(lines: Iterable[tuple[str, str, bool]]) -> str:
    """Return lines of a name and a text; the lines that report a problem are first and marked."""
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


def lines(result: Mapping[str, object]) -> str:
    """Return a line for each key that has a value, in words and with its unit."""
    kept = {name: item for name, item in result.items() if name not in _ELSEWHERE}
    return summary(
        (*_in_words(name, item), name in _PROBLEMS) for name, item in kept.items() if _text(item)
    )


def table(rows: Sequence[Sequence[str]], *, right: bool = False) -> str:
    """Return rows of equal length as columns, two spaces apart, flush left or ``right``."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    side = ">" if right else "<"
    return "\n".join(
        "  ".join(f"{c:{side}{w}}" for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def listed(names: Sequence[str], most: int = 5) -> str:
    """Return the first names, at most ``most``, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def not_used(refused: Mapping[str, str]) -> list[str]:
    """Return one line: how many pictures were not used, by reason, each ``reason: detail``."""
    if not refused:
        return []
    counts = Counter(why.partition(":")[0] for why in refused.values())
    counted = ", ".join(f"{number} {reason}" for reason, number in counts.most_common())
    return [f"not used: {counted}; --json names each"]


def _in_words(key: str, value: object) -> tuple[str, str]:
    parts = key.split("_") if key.isidentifier() else [key]
    unit = next((part for part in parts[1:] if part in _UNITS), "")
    name = " ".join(part for part in parts if part != unit)
    return name, f"{_text(value)} {_UNITS[unit]}" if unit else _text(value)


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        pairs = (_in_words(name, item) for name, item in value.items() if _text(item))
        return "; ".join(f"{name}: {text}" for name, text in pairs)
    if isinstance(value, list | tuple):
        return ", ".join(_text(item) for item in value)
    if value is None or isinstance(value, bool):
        return {None: "", True: "yes", False: "no"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def finding_items(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """Return findings as items for JSON."""
    return [asdict(each) | {"severity": each.severity.name.lower()} for each in findings]


def finding_lines(items: Iterable[Mapping[str, object]]) -> list[str]:
    """Return a line for each item that is worse than a note."""
    return [
        f"{str(item['severity']).upper()}: {item['evidence']}: {item['parameter']}: {item['mend']}"
        for item in items
        if item["severity"] != "note"
    ]


def tally_line(findings: Sequence[Finding]) -> str:
    """Return ``GO``, or ``NO GO`` and the numbers of faults and cautions."""
    lead = "NO GO" if any(each.severity is Severity.STOP for each in findings) else "GO"
    counts = [
        f"{number} {name}{'s' if number > 1 else ''}"
        for severity, name in _NAMES.items()
        if (number := sum(each.severity is severity for each in findings))
    ]
    return f"{lead}: {', '.join(counts)}" if counts else lead


def report(items: Sequence[Mapping[str, object]]) -> str:
    """Return three short lines for each finding: evidence, parameter, remedy."""
    blocks = [
        f"{str(item['severity']).upper():<8} {item['evidence']}\n"
        f"{'':<8} look at  {item['parameter']}\n"
        f"{'':<8} to mend  {item['mend']}"
        for item in items
    ]
    return "\n\n".join(blocks)
