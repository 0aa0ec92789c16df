"""Tables and numbers in Markdown."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

_WIDTH = 98


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose source is in columns too; all but the first to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join(_row(cells, widths) for cells in (head, rule, *rows))


def _row(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return f"| {' | '.join(padded)} |"


def words(text: str) -> str:
    """Paragraphs and lists, folded; paragraphs are apart by an empty line, items begin with -."""
    parts = textwrap.dedent(text).strip().split("\n\n")
    return "\n\n".join(map(_paragraph, parts))


def _paragraph(text: str) -> str:
    items = [" ".join(item.split()) for item in f"\n{text}".split("\n- ")]
    lines = [] if items[0] == "" else [_folded(items[0], "", "")]
    lines += [_folded(item, "- ", "  ") for item in items[1:]]
    return "\n".join(lines)


def _folded(text: str, first: str, others: str) -> str:
    return textwrap.fill(
        text,
        _WIDTH,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )


def fixed(value: float, digits: int, unit: str = "") -> str:
    """A number with so many decimals, and its unit; no zero has a sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}{' ' if unit else ''}{unit}"


def ratio(here: float, paper: float) -> str:
    """Here over paper."""
    return f"{here / paper:.2f}"


def spread(values: Sequence[float], digits: int) -> str:
    """Mean and sample standard deviation; of one value alone that value."""
    mean = math.fsum(values) / len(values)
    if len(values) == 1:
        return fixed(mean, digits)
    square = math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1)
    return f"{fixed(mean, digits)} ± {fixed(math.sqrt(square), digits)}"


def p_value(value: float | None) -> str:
    """As the paper prints them."""
    if value is None:
        return "-"
    return "< 0.0001" if value < 0.0001 else fixed(value, 4)
