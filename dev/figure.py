"""Define a line of the table of ``make bench``."""

from __future__ import annotations

from typing import NamedTuple


class Figure(NamedTuple):
    """Hold one line of the table."""

    what: str
    value: float
    unit: str
    wanted: str = ""


def line(figure: Figure) -> str:
    """Return one line of the table."""
    digits = 2 if figure.value >= 1 else 3
    return f"{figure.what:<44}{figure.value:>9.{digits}f}  {figure.unit:<12}{figure.wanted}"
