"""Draw an outage of RTK through the filter and the smoother: ``docs/smoothing.png``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dev.flight_errors import Errors
from dev.smoothed_flights import FILTER, FOUND_S, LOST_S, SMOOTHER, outage_errors
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

_FROM_S, _TO_S = 16.0, 42.0
_SEED = 1
#: Title, unit of the axis, and error and sigma in that unit.
_PANELS: tuple[tuple[str, Callable[[Errors], Array], Callable[[Errors], Array]], ...] = (
    ("north, cm", lambda e: 100 * e.state[:, 0], lambda e: 100 * e.sigma[:, 0]),
    ("east, cm", lambda e: 100 * e.state[:, 1], lambda e: 100 * e.sigma[:, 1]),
    ("heading, deg", lambda e: np.degrees(e.rpy[:, 2]), lambda e: np.degrees(e.sigma[:, 5])),
)


def outage_png(found: dict[str, Errors]) -> bytes:
    """Return a PNG: errors as lines in bands of two sigmas, filter and smoother."""
    made, panels = figure(8.0, 6.4, len(_PANELS), 1, sharex=True)
    for panel, (title, error, sigma) in zip(panels, _PANELS, strict=True):
        panel.axvspan(LOST_S, FOUND_S, color="#f0f0f0", zorder=0)
        for name, colour in zip((FILTER, SMOOTHER), COLOURS[1::-1], strict=True):
            _draw(panel, found[name], error, sigma, name, colour)
        panel.set_ylabel(f"error {title}")
    panels[0].set_title(f"RTK and heading are missing from {LOST_S:g} to {FOUND_S:g} s (grey)")
    panels[0].legend(loc="upper left", ncols=2)
    panels[-1].set_xlabel("time, s; bands: two sigmas")
    return png(made)


def _draw(
    panel: Any,
    found: Errors,
    error: Callable[[Errors], Array],
    sigma: Callable[[Errors], Array],
    name: str,
    colour: str,
) -> None:
    inside = (found.t_s >= _FROM_S) & (found.t_s <= _TO_S)
    t_s, two = found.t_s[inside], 2 * sigma(found)[inside]
    panel.fill_between(t_s, -two, two, color=colour, alpha=0.18, linewidth=0)
    panel.plot(t_s, error(found)[inside], color=colour, label=name)


def main(argv: Sequence[str] | None = None) -> None:
    """Fly the outage and write the picture."""
    parser = argparse.ArgumentParser(prog="python -m dev.smoothing_plot")
    parser.add_argument("png", type=Path, help="the picture")
    parser.add_argument("--seed", type=int, default=_SEED, help="of the flight")
    args = parser.parse_args(argv)
    args.png.write_bytes(outage_png(outage_errors(args.seed)))


if __name__ == "__main__":
    main()
