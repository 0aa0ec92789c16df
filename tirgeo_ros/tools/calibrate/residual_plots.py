"""Plot the residuals of calibrations: lens, boresight, orthophoto and aircraft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.aircraft_fit import AircraftFit
from tirgeo_ros.core.calibration.boresight_fit import BoresightFit
from tirgeo_ros.core.calibration.boresight_model import PointSighting
from tirgeo_ros.core.calibration.checkerboard import BoardSighting
from tirgeo_ros.core.calibration.lens_fit import LensFit
from tirgeo_ros.core.calibration.polynomial_transform import (
    PolynomialTransform,
    Residuals,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.io.surveys.survey import ControlPoints
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png

#: Length of a usual arrow of the lens, and of the longest of an orthophoto, as shares of the
#: picture's width; of the longest of a boresight, px.
_LENS_SHARE, _ORTHOPHOTO_SHARE = 0.02, 0.12
_LONGEST_PX = 60.0
_MOST_NAMES = 40
_FAR = 15.0  # times the rms of innovations
#: Panels of innovations: topic, and what makes its unit.
_INNOVATIONS = {
    Source.RTK_POSITION: ("rtk/fix", 100.0, "cm"),
    Source.RTK_VELOCITY: ("rtk/vel", 100.0, "cm/s"),
    Source.RTK_HEADING: ("rtk/heading", float(np.degrees(1.0)), "deg"),
}


def lens_png(fit: LensFit, views: Mapping[str, BoardSighting]) -> bytes:
    """Return a PNG: all corners on the frame with errors enlarged, and the error of every view."""
    made, (frame, bars) = figure(8.0, 9.0, rows=2, height_ratios=[2.2, 1])
    width, height = fit.camera.width, fit.camera.height
    scale = _LENS_SHARE * width / max(fit.rms_px, 1e-3)
    for number, (name, errors) in enumerate(fit.errors_px.items()):
        colour = COLOURS[number % len(COLOURS)]
        corners = views[name].corners_px
        frame.plot(*corners.T, ".", color=colour, markersize=3)
        arrows(frame, corners, scale * errors, colour, 0.0012)
    frame.plot(fit.camera.cx, fit.camera.cy, "k+", markersize=12, label="principal point")
    frame.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    frame.set(xlabel="column, px", ylabel="row, px")
    frame.set_title(f"Corners of {len(fit.errors_px)} views, errors enlarged {scale:.0f} times")
    frame.legend(loc="lower right", frameon=True)
    rms_px = fit.view_rms_px
    bars.bar(range(len(rms_px)), [*rms_px.values()], color=COLOURS[0])
    bars.axhline(fit.rms_px, color=COLOURS[1], label=f"all: {fit.rms_px:.3f} px")
    bars.set(ylabel="reprojection error, px", title="Root mean square error of every view")
    if len(rms_px) <= _MOST_NAMES:
        bars.set_xticks(range(len(rms_px)), [*rms_px], rotation=90, fontsize=6)
    bars.grid(visible=False, axis="x")
    bars.legend(loc="upper right")
    return png(made)


def boresight_png(
    camera: Camera, sightings: Sequence[PointSighting], found: BoresightFit
) -> bytes:
    """Return a PNG: an arrow from each observation to its point's expected pixel, outliers too."""
    uv = np.array([one.uv for one in sightings])
    made, axes = figure(10.0, 5.2, 1, 2, sharex=True, sharey=True)
    for panel, title, residuals in zip(
        axes, ("before", "after"), (found.before, found.after), strict=True
    ):
        _boresight_panel(panel, uv, residuals, found.used)
        rms = float(np.sqrt(np.nanmean((residuals[found.used] ** 2).sum(1))))
        panel.set(title=f"{title}: {rms:.2f} px rms", xlabel="column, px", aspect="equal")
    axes[0].set(xlim=(0, camera.width), ylim=(camera.height, 0), ylabel="row, px")
    axes[1].legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=2)  # under the picture
    return png(made)


def _boresight_panel(panel: Any, uv: Array, residuals: Array, used: BoolArray) -> None:
    longest = float(np.nanmax(np.hypot(*residuals[used].T), initial=1e-3))
    seen = np.isfinite(residuals[:, 0])
    for shown, colour, what in (
        (used & seen, COLOURS[0], "used"),
        (~used & seen, COLOURS[1], "left out"),
    ):
        # An outlier may be hundreds of pixels off: its arrow is cut.
        cut = np.minimum(1.0, longest / np.maximum(np.hypot(*residuals[shown].T), 1e-9))
        moves = -residuals[shown] * cut[:, None] * _LONGEST_PX / longest
        panel.plot(*uv[shown].T, ".", color=colour, markersize=4, label=what)
        arrows(panel, uv[shown], moves, colour, 0.003)
    panel.text(0.01, 0.03, f"longest arrow {longest:.1f} px", transform=panel.transAxes)


def orthophoto_png(
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
    width = float(np.ptp(control.pixels[:, 0]))
    scale = _ORTHOPHOTO_SHARE * width / longest if longest > 0 else 1.0
    arrows(axis, control.pixels, residuals.pixels * scale, COLOURS[2], 0.004)
    for name, place in zip(control.names, control.pixels.tolist(), strict=True):
        axis.annotate(name, place, textcoords="offset points", xytext=(5, 5))
    axis.set_title(
        f"Residuals, {scale:.3g} times enlarged: mean {residuals.lengths_px.mean():.2f} px, "
        f"{100 * residuals.lengths_m.mean():.1f} cm; the longest {longest:.2f} px"
    )
    axis.set(xlabel="column [px]", ylabel="row [px]", aspect="equal")
    axis.invert_yaxis()
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=8)
    return png(made)


def innovations_png(found: AircraftFit) -> bytes:
    """Return a PNG: innovations over time by source.

    Beyond three times their rms after the axis is logarithmic if some are far outside.
    """
    before, after = found.before.nis(), found.after.nis()
    sources = [source for source in _INNOVATIONS if source in after]
    made, axes = figure(10.0, 2.3 * len(sources), len(sources), 1, sharex=True)
    panels = np.atleast_1d(axes)
    for panel, source in zip(panels, sources, strict=True):
        name, scale, unit = _INNOVATIONS[source]
        for run, colour, what in (
            (found.before, COLOURS[1], "before"),
            (found.after, COLOURS[0], "after"),
        ):
            white = [one for one in run.white if one.source is source]
            times_s = (
                np.array([one.stamp_ns - found.before.attitude_ns[0] for one in white]) * 1e-9
            )
            values = scale * np.array([one.innovation for one in white])
            for column in values.T:
                panel.plot(times_s, column, ".", color=colour, markersize=1.5)
            panel.plot([], [], ".", color=colour, label=what)
        usual = float(np.sqrt(np.mean(values**2)))
        if max(map(abs, panel.get_ylim())) > _FAR * usual > 0:
            panel.set_yscale("symlog", linthresh=3 * usual)
        title = f"{name}: NIS {before[source]:.3g} before, {after[source]:.2f} after"
        panel.set_title(title, loc="left")
        panel.set_ylabel(f"innovation, {unit}")
    panels[-1].set_xlabel("time, s")
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return png(made)
