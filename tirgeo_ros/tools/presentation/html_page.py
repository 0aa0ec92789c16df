"""Make pages that need no network: everything is in the one file."""

from __future__ import annotations

import base64
from html import escape

from tirgeo_ros import __version__

#: The colours are variables, which a page with a dark form sets again.
STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --paper: #fff; --soft: #555; --line: #ddd;
  --fine: #eee; --fault: #fdeaea; --fault-edge: #c0392b; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; }
h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid var(--line); }
.lead, figcaption { color: var(--soft); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .7rem; border-bottom: 1px solid var(--fine); }
figure { margin: 0; }
figcaption { font-size: .9rem; }
.fault { background: var(--fault); border-left: 4px solid var(--fault-edge);
  padding: .4rem .8rem; }
"""


def html_page(title: str, style: str, body: str) -> str:
    """Return a page: its title as text, its own style after the common one, its body as HTML."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>tirgeo: {escape(title)}</title>\n<style>{STYLE}{style}</style>\n</head>\n"
        f'<body>\n{body}\n<p class="lead">tirgeo {__version__}</p>\n</body>\n</html>\n'
    )


def embedded(content: bytes, kind: str, words: str) -> str:
    """Return a picture of a type (``image/jpeg``) as an element, with words in its place."""
    data = base64.b64encode(content).decode()
    return f'<img alt="{escape(words, quote=True)}" src="data:{kind};base64,{data}">'
