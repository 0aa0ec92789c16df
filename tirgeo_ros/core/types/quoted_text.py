"""Make text from outside safe to show or log: one printable line of limited length."""

from __future__ import annotations

MOST = 2000  # characters in one line (a reason, a name or a path)


def cut(text: str, most: int = MOST) -> str:
    """Return the text; if it is too long, its beginning and an ellipsis, ``most`` characters."""
    return text if len(text) <= most else text[: most - 1] + "\u2026"


def shown(text: object, most: int = MOST) -> str:
    """Return a text cut to ``most`` characters, each unprintable one escaped as in ``repr``.

    Line breaks, terminal escape sequences and lone surrogates from outside then do no harm in a
    log. The escapes may make the line longer than ``most``.
    """
    short = cut(str(text), most)
    if short.isprintable():
        return short
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in short)
