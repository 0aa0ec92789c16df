"""Lay out numbers and tables in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

#: Results of the commands by name.
Results: TypeAlias = Mapping[str, Mapping[str, Any]]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose source is in columns too; all but the first to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    lines = []
    for cells in (head, rule, *rows):
        first, *others = zip(cells, widths, strict=True)
        padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
        lines.append(f"| {' | '.join(padded)} |")
    return "\n".join(lines)


def fixed(value: float | None, digits: int) -> str:
    """Return a number with so many decimals, - for None; no zero has a sign."""
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def plus_minus(value: float, sigma: float) -> str:
    """Return a value and its sigma."""
    return f"{value:.3e} ± {sigma:.1e}"


def p_value(value: float | None) -> str:
    """Return a p-value as the paper prints them."""
    return "< 0.0001" if value is not None and value < 0.0001 else fixed(value, 4)
