"""Plot the views and errors of a lens calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.checkerboard.lens_fit import LensFit
from tirgeo_ros.core.calibration.checkerboard.sighting import BoardSighting
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png

_ARROW_SHARE = 0.06  # length of a typical arrow as a share of the picture's width
_MOST_NAMES = 40


def coverage_png(fit: LensFit, views: Mapping[str, BoardSighting]) -> bytes:
    """Return a PNG: all corners on the frame with errors enlarged, and the error of every view."""
    made, (frame, bars) = figure(8.0, 9.0, rows=2, height_ratios=[2.2, 1])
    _draw_corners(frame, fit, views)
    _draw_errors(bars, fit)
    return png(made)


def _draw_corners(axes: Any, fit: LensFit, views: Mapping[str, BoardSighting]) -> None:
    width, height = fit.camera.width, fit.camera.height
    scale = _round(_ARROW_SHARE * width / max(fit.rms_px, 1e-3) / 3)
    for number, (name, view) in enumerate(fit.views.items()):
        u, v = views[name].corners_px.T
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(u, v, ".", color=colour, markersize=3)
        arrows(axes, views[name].corners_px, scale * view.errors_px, colour, 0.0012)
    axes.plot(fit.camera.cx, fit.camera.cy, "k+", markersize=12, label="principal point")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="column, px", ylabel="row, px")
    axes.set_title(f"Corners of {len(fit.views)} views, errors enlarged {scale:g} times")
    axes.legend(loc="lower right", frameon=True)


def _round(number: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... that is not above the number."""
    power = 10 ** np.floor(np.log10(number))
    return float(max(step for step in (1, 2, 5) if step * power <= number * (1 + 1e-9)) * power)


def _draw_errors(axes: Any, fit: LensFit) -> None:
    names = list(fit.views)
    errors = [view.rms_px for view in fit.views.values()]
    axes.bar(range(len(names)), errors, color=COLOURS[0])
    axes.axhline(fit.rms_px, color=COLOURS[1], label=f"all: {fit.rms_px:.3f} px")
    axes.set(ylabel="reprojection error, px", xlim=(-0.7, len(names) - 0.3))
    if len(names) <= _MOST_NAMES:
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=6)
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper right")
    axes.set_title("Root mean square error of every view")
