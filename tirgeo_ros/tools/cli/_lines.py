"""A result as lines for a person: one a key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

#: What is told of elsewhere than among the lines of a result.
_TOLD = "findings"


def lines(result: Mapping[str, object]) -> str:
    """Return a line for each key, those of nested results with a dot; without those of None."""
    pairs = [(name, item) for name, item in _flat(result) if item is not None and name != _TOLD]
    width = max((len(name) for name, _ in pairs), default=0)
    return "\n".join(f"{name:<{width}}  {_text(item)}" for name, item in pairs)


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
