"""Plot the ground for an evaluation: errors, their spread, the track."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import CIRCULAR_SHARE
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.plot import WIDTH_IN, Plot, places_of, thinned
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, logarithmic, svg

#: Length of the longest error vector as a share of the survey's extent.
_VECTOR_SHARE = 0.12
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_CLUTTER = 40  # most points that are labelled with their names


def ground_plots(found: Evaluation) -> Iterator[Plot]:
    """Yield the plots of the errors, if points were located, and of the track."""
    if any(method.located for method in found.methods):
        yield _vectors(found)
        yield _distribution(found)
        yield _sigma_against_error(found)
    yield _track(found)


def _vectors(found: Evaluation) -> Plot:
    """Return Figures 23 to 26."""
    return Plot(
        "Errors of the control points",
        "From each surveyed point (cross) to where its observations were located, the vectors "
        "lengthened as the titles say. Mean over the points of Equation 24 in the titles (Figures "
        "23 to 26 of the paper).",
        [_method_vectors(found, method) for method in found.methods if method.located],
    )


def _method_vectors(found: Evaluation, method: MethodResult) -> bytes:
    made, panel = figure(WIDTH_IN, 4.2)
    east, north, middle = places_of(found)
    span = max(float(np.ptp(east)), float(np.ptp(north)), 1.0)
    longest = max(one.distance_m for one in method.located)
    times = _magnification(_VECTOR_SHARE * span / max(longest, 1e-6))
    _error_vectors(panel, method, middle, times)
    panel.plot(east, north, "+", color=COLOURS[0], markersize=6)
    rmse = method.errors.mean_point_rmse_m
    shown = f", vectors x {times}" if times > 1 else ""
    title = f"{method.method}: {rmse:.3f} m{shown}"
    panel.set(title=title, xlabel="east, m", ylabel="north, m", aspect="equal")
    panel.margins(0.12)
    if len(east) <= _CLUTTER:
        for name, x, y in zip(found.control, east, north, strict=True):
            panel.annotate(name, (x, y), (3, 3), textcoords="offset points", fontsize=7)
    return svg(made)


def _error_vectors(panel: Any, method: MethodResult, middle: Array, times: float) -> None:
    located = method.located
    error = np.array([one.error_en for one in located])
    begin = np.array([(one.east_m, one.north_m) for one in located]) - middle - error
    panel.quiver(
        *begin.T,
        *(times * error).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        color=COLOURS[1],
        width=0.005,
    )


def _magnification(most: float) -> int:
    """Return the largest round magnification that is not above ``most``."""
    return max((times for times in _MAGNIFICATIONS if times <= most), default=1)


def _distribution(found: Evaluation) -> Plot:
    made, axes = figure(WIDTH_IN, 3.6)
    for number, method in enumerate(found.methods):
        distance_m = np.sort(method.errors.distance_m)
        if len(distance_m):
            share = np.arange(1, len(distance_m) + 1) / len(distance_m)
            colour = COLOURS[number % len(COLOURS)]
            axes.step(distance_m, share, where="post", color=colour, label=method.method)
    axes.axhline(CIRCULAR_SHARE, color="#888888", linestyle=":")
    axes.set(xlabel="horizontal error, m", ylabel="share of observations")
    logarithmic(axes, "x")
    axes.legend()
    return Plot(
        "How often an error is how large",
        "Share of the observations with an error up to so much; the dotted line is that of CE90.",
        [svg(made)],
    )


def _sigma_against_error(found: Evaluation) -> Plot:
    methods = [method for method in found.methods if method.located]
    made, axes = figure(WIDTH_IN, 4.2)
    for number, method in enumerate(methods):
        predicted = [math.sqrt(np.trace(one.covariance_en)) for one in method.located]
        true = [one.distance_m for one in method.located]
        inside = sum(one.is_inside for one in method.located)
        label = f"{method.method}: {inside} of {len(true)} inside"
        axes.plot(predicted, true, ".", color=COLOURS[number % len(COLOURS)], label=label)
    sigmas = [math.sqrt(np.trace(one.covariance_en)) for m in methods for one in m.located]
    line = np.array([min(sigmas), max(sigmas)])
    axes.plot(line, math.sqrt(CHI2_95 / 2) * line, color="#888888", linestyle=":")
    axes.set(xlabel="sigma as predicted, m", ylabel="error, m")
    for which in ("x", "y"):
        logarithmic(axes, which)
    axes.legend(fontsize=8)
    return Plot(
        "Sigma against error",
        "Each observation's horizontal error beside the root mean square that the method predicts "
        "for it. The dotted line holds 95 % of them where the error is as likely in all "
        "directions; in the legend, how many lie within their own ellipse of 95 %.",
        [svg(made)],
    )


def _track(found: Evaluation) -> Plot:
    east, north, middle = places_of(found)
    made, axes = figure(WIDTH_IN, 4.2)
    sensors = found.sensors
    tracks = (("ordinary GPS", sensors.gps, COLOURS[4]), ("RTK", sensors.rtk, COLOURS[0]))
    for name, fixes, colour in tracks:
        if len(fixes.stamp_ns):
            keep = thinned(fixes.stamp_ns)
            x, y = fixes.east_m[keep] - middle[0], fixes.north_m[keep] - middle[1]
            axes.plot(x, y, ".", markersize=2.5, color=colour, label=name)
    best = found.methods[-1] if found.methods else None
    if best is not None and len(best.body):
        keep = thinned(best.body.stamp_ns)
        x, y = best.body.east_m[keep] - middle[0], best.body.north_m[keep] - middle[1]
        axes.plot(x, y, color=COLOURS[2], label=best.method)
    axes.plot(east, north, "+", color=COLOURS[6], label="control points")
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    axes.legend()
    origin = f"{middle[0]:.0f} m east, {middle[1]:.0f} m north"
    return Plot(
        "Track",
        f"From {origin} in {found.projection.name} (Figure 15 of the paper).",
        [svg(made)],
    )
