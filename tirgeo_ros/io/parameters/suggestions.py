"""Suggest a known name for one that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Collection


def nearest(name: str, known: Collection[str]) -> str:
    """Return the end of a message: the nearest known name, else all of them, if any."""
    near = difflib.get_close_matches(name, list(known), n=1)
    if near:
        return f" (did you mean {near[0]}?)"
    return f" (known: {', '.join(sorted(known))})" if known else ""
