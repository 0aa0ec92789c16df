"""What to say after a name that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Collection


def nearest(name: str, known: Collection[str]) -> str:
    """The end of a message: the known name nearest to it, else all of them, if any."""
    near = difflib.get_close_matches(name, list(known), n=1)
    if near:
        return f" (did you mean {near[0]}?)"
    return f" (known: {', '.join(sorted(known))})" if known else ""
