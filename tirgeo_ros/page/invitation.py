"""Invite to the page: its URL as a code to scan, on a terminal."""

from __future__ import annotations

import io

import segno

_QUIET = 2  # modules of light around the code; terminals add their own


def invitation(url: str) -> str:
    """Return a URL as a QR code of half-block characters, light on dark, and as text below it."""
    out = io.StringIO()
    segno.make(url, error="l", micro=False).terminal(out, border=_QUIET, compact=True)
    return f"{out.getvalue().rstrip()}\n{url}"
