"""Write times, and texts that people typed, so that every reader takes them."""

from __future__ import annotations

from datetime import datetime, timedelta

#: Line end, zero-width non-joiner, zero-width joiner.
_KEPT = "\n\u200c\u200d"
_BEGIN = datetime(1970, 1, 1)  # noqa: DTZ001  UTC, without its words


def legible(text: str) -> str:
    """Return a text without control characters; each tab or other space is a plain one."""
    spaced = (" " if c.isspace() and c != "\n" else c for c in text)
    return "".join(c for c in spaced if c.isprintable() or c in _KEPT)


def utc(stamp_ns: int) -> str:
    """Return ISO 8601, UTC with Z, to a millisecond, rounded down."""
    moment = _BEGIN + timedelta(milliseconds=stamp_ns // 1_000_000)
    return moment.isoformat(timespec="milliseconds") + "Z"
