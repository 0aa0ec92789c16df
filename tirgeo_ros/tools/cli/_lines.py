"""Format a result as lines for a person: one per key, or as a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

#: Key of a result that is printed elsewhere.
_TOLD = "findings"


def lines(result: Mapping[str, object]) -> str:
    """Return a line for each key, those of nested results with a dot; without those of None."""
    pairs = [(name, item) for name, item in _flat(result) if item is not None and name != _TOLD]
    width = max((len(name) for name, _ in pairs), default=0)
    return "\n".join(f"{name:<{width}}  {_text(item)}" for name, item in pairs)


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


def _flat(result: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, item in result.items():
        if isinstance(item, Mapping):
            yield from _flat(item, f"{prefix}{name}.")
        else:
            yield prefix + name, item


def _text(value: object) -> str:
    if isinstance(value, list):
        return "; ".join(_text(item) for item in value) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
