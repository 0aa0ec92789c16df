# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Define the style of all plots and pages: plots without a display, pages without a network."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING, Any

from tirgeo_ros import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours that colour-blind people can distinguish (Okabe and Ito), in order of use.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_DPI = 110
_STYLE: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 11,
    "font.size": 9,
    "grid.color": "#dddddd",
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "svg.hashsalt": "tirgeo",
}
#: Common style of all pages. A page with a dark scheme overrides the variables of the colours.
PAGE_STYLE = """
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


def figure(
    width_in: float = 7.0, height_in: float = 4.0, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes, one or an array of them, as ``Figure.subplots`` does."""
    from matplotlib import rc_context  # noqa: PLC0415  slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415  heavy

    with rc_context(_STYLE):
        chart = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
        return chart, chart.subplots(rows, columns, **options)


def arrows(axes: Any, places: Any, moves: Any, colour: str, width: float) -> None:
    """Draw arrows from places (n, 2) by moves (n, 2), both in the units of the axes."""
    axes.quiver(
        *places.T, *moves.T, angles="xy", scale_units="xy", scale=1, color=colour, width=width
    )


def png(chart: Figure) -> bytes:
    """Return the figure as PNG bytes."""
    out = io.BytesIO()
    chart.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def svg(chart: Figure) -> bytes:
    """Return the figure as SVG bytes, for a page."""
    from matplotlib import rc_context  # noqa: PLC0415  heavy

    out = io.BytesIO()
    with rc_context(_STYLE):
        chart.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def html_page(title: str, style: str, body: str) -> str:
    """Return a page with a title (text), the common style and its own, and a body (HTML)."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>tirgeo: {escape(title)}</title>\n<style>{PAGE_STYLE}{style}</style>\n</head>\n"
        f'<body>\n{body}\n<p class="lead">tirgeo {__version__}</p>\n</body>\n</html>\n'
    )


def embedded(content: bytes, kind: str, alternative: str) -> str:
    """Return an HTML element with a picture of a type (``image/jpeg``) and alternative text."""
    data = base64.b64encode(content).decode()
    return f'<img alt="{escape(alternative, quote=True)}" src="data:{kind};base64,{data}">'
