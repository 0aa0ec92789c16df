"""Text from outside, before it is shown or logged: of a bounded length, in one line."""

from __future__ import annotations

MOST = 2000  # characters of one line: a reason, a name, a path


def cut(text: str, most: int = MOST) -> str:
    """Return the text, or its beginning and an ellipsis: ``most`` characters in all."""
    return text if len(text) <= most else text[: most - 1] + "\u2026"


def shown(text: object, most: int = MOST) -> str:
    """Return a text as one line: cut, and what cannot be printed written as ``repr`` writes it.

    So a line break, a terminal's escape or half a character from outside does no harm in a log.
    """
    short = cut(str(text), most)
    if short.isprintable():
        return short
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in short)
