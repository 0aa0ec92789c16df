"""Format a result for a person: a line for each key, or a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from tirgeo_ros.tools.presentation.results import summary

#: Keys of a result that are printed elsewhere, and those that report a problem.
_ELSEWHERE = ("findings", "warning", "error")
_PROBLEMS = ("refused", "not_used")
_UNITS = {"m": "m", "s": "s", "ms": "ms", "deg": "deg", "px": "px", "hz": "Hz", "ns": "ns"}


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


def not_used(refused: Mapping[str, str]) -> list[str]:
    """Return one line: how many pictures were not used, by reason, each ``reason: detail``."""
    if not refused:
        return []
    counts = Counter(why.partition(":")[0] for why in refused.values())
    counted = ", ".join(f"{number} {reason}" for reason, number in counts.most_common())
    return [f"not used: {counted}; -v names each"]


def each_not_used(refused: Mapping[str, str]) -> str:
    """Return a line for each picture that was not used."""
    return "\n".join(f"not used: {name}: {why}" for name, why in refused.items())


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
