"""Plot the residuals at the control points of an orthophoto."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.calibration.orthophoto.polynomial_transform import (
    PolynomialTransform,
    Residuals,
)
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.io.surveys.control_points import ControlPoints
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png

_LONGEST = 0.12  # length of the longest residual, as a share of the picture's width


def residuals_png(
    control: ControlPoints,
    found: PolynomialTransform,
    residuals: Residuals,
    vertices: Array,
    outside: BoolArray,
) -> bytes:
    """Return a PNG: control points, residuals enlarged, hull, features' vertices (n, 2)."""
    made, axis = figure(8.0, 6.5)
    rim = np.vstack([found.hull_px, found.hull_px[:1]])
    axis.plot(*rim.T, color="#777777", lw=1.0, label="hull of the control points")
    for chosen, colour, name in (
        (~outside, COLOURS[5], "inside"),
        (outside, COLOURS[1], "outside"),
    ):
        if chosen.any():
            axis.plot(*vertices[chosen].T, ".", color=colour, ms=3, label=f"vertices {name}")
    axis.plot(*control.pixels.T, "+", color=COLOURS[0], ms=8, label="control points")
    longest = float(residuals.lengths_px.max())
    scale = _LONGEST * float(np.ptp(control.pixels[:, 0])) / longest if longest > 0 else 1.0
    arrows(axis, control.pixels, residuals.pixels * scale, COLOURS[2], 0.004)
    for name, (column, row) in zip(control.names, control.pixels.tolist(), strict=True):
        axis.annotate(name, (column, row), textcoords="offset points", xytext=(5, 5))
    axis.set_title(
        f"Residuals, {scale:.3g} times enlarged: mean {residuals.lengths_px.mean():.2f} px, "
        f"{100 * residuals.lengths_m.mean():.1f} cm; the longest {longest:.2f} px"
    )
    axis.set_xlabel("column [px]")
    axis.set_ylabel("row [px]")
    axis.set_aspect("equal")
    axis.invert_yaxis()
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=8)
    return png(made)
