"""Define the style of all plots and write them to files: without a display, reproducibly."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours that colour-blind people can distinguish too (Okabe and Ito), in order of use.
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


def figure(
    width_in: float = 7.0, height_in: float = 4.0, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes, one or an array of them, as ``Figure.subplots`` does."""
    from matplotlib import rc_context  # noqa: PLC0415  slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    with rc_context(_STYLE):
        made = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
        return made, made.subplots(rows, columns, **options)


def arrows(axes: Any, places: Any, moves: Any, colour: str, width: float) -> None:
    """Draw arrows from places (n, 2) by moves (n, 2), both in the units of the axes."""
    axes.quiver(
        *places.T, *moves.T, angles="xy", scale_units="xy", scale=1, color=colour, width=width
    )


def logarithmic(axes: Any, which: str) -> None:
    """Make an axis (``x`` or ``y``) logarithmic, with plain numbers that do not overlap.

    Call it once everything is drawn: the number of ticks depends on the range.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter  # noqa: PLC0415

    axes.set(**{f"{which}scale": "log"})
    axis = getattr(axes, f"{which}axis")
    low, high = axis.get_view_interval()
    decades = math.log10(high / low)
    if decades < 0.5:
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    else:
        axis.set_major_locator(
            LogLocator(subs=(1, 2, 5)) if decades < 2 else LogLocator(numticks=5)
        )
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def png(made: Figure) -> bytes:
    """Return the figure as PNG bytes."""
    out = io.BytesIO()
    made.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def svg(made: Figure) -> bytes:
    """Return the figure as SVG bytes, for a page."""
    from matplotlib import rc_context  # noqa: PLC0415

    out = io.BytesIO()
    with rc_context(_STYLE):
        made.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()
