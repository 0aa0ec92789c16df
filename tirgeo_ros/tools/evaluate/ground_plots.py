"""Plot the ground for an evaluation: errors, their spread, the track."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import CIRCULAR_SHARE
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, logarithmic, svg

#: Width of a figure (inches): narrow enough to be readable on a telephone.
WIDTH_IN = 4.4
#: Length of the longest error vector as a share of the survey's extent.
_VECTOR_SHARE = 0.12
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_CLUTTER = 40  # most points that are labelled with their names
_GREY = "#888888"


class Plot(NamedTuple):
    """Hold a figure for the report: pictures that are placed side by side if there is room."""

    title: str
    caption: str
    svgs: Sequence[bytes]


def ground_plots(found: Evaluation) -> Iterator[Plot]:
    """Yield the plots of the errors, if points were located, and of the track."""
    methods = [method for method in found.methods if method.located]
    if methods:
        yield Plot(
            "Errors of the control points",
            "From each surveyed point (cross) to where its observations were located, the vectors "
            "lengthened as the titles say. Mean over the points of Equation 24 in the titles "
            "(Figures 23 to 26 of the paper).",
            [_vectors(found, method) for method in methods],
        )
        yield _distribution(methods)
        yield _sigma_against_error(methods)
    yield _track(found)


def _control(found: Evaluation) -> tuple[Array, Array]:
    """Return the control points (P, 2) from their mean, and that mean (2,): east, north, m."""
    places = np.array([(one.east_m, one.north_m) for one in found.control.values()])
    middle = np.round(places.mean(axis=0))
    return places - middle, middle


def _vectors(found: Evaluation, method: MethodResult) -> bytes:
    control, middle = _control(found)
    span = max(*np.ptp(control, axis=0).tolist(), 1.0)
    longest = max(one.distance_m for one in method.located)
    most = _VECTOR_SHARE * span / max(longest, 1e-6)
    times = max((times for times in _MAGNIFICATIONS if times <= most), default=1)
    made, panel = figure(WIDTH_IN, 4.2)
    error = np.array([one.error_en for one in method.located])
    begin = np.array([(one.east_m, one.north_m) for one in method.located]) - middle - error
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.005}
    panel.quiver(*begin.T, *(times * error).T, color=COLOURS[1], **arrows)
    panel.plot(*control.T, "+", color=COLOURS[0], markersize=6)
    shown = f", vectors x {times}" if times > 1 else ""
    title = f"{method.method}: {method.errors.mean_point_rmse_m:.3f} m{shown}"
    panel.set(title=title, xlabel="east, m", ylabel="north, m", aspect="equal")
    panel.margins(0.12)
    if len(control) <= _CLUTTER:
        for name, place in zip(found.control, control, strict=True):
            panel.annotate(name, place, (3, 3), textcoords="offset points", fontsize=7)
    return svg(made)


def _distribution(methods: Sequence[MethodResult]) -> Plot:
    made, axes = figure(WIDTH_IN, 3.6)
    for number, method in enumerate(methods):
        distance_m = np.sort(method.errors.distance_m)
        share = np.arange(1, len(distance_m) + 1) / len(distance_m)
        colour = COLOURS[number % len(COLOURS)]
        axes.step(distance_m, share, where="post", color=colour, label=method.method)
    axes.axhline(CIRCULAR_SHARE, color=_GREY, linestyle=":")
    axes.set(xlabel="horizontal error, m", ylabel="share of observations")
    logarithmic(axes, "x")
    axes.legend()
    return Plot(
        "How often an error is how large",
        "Share of the observations with an error up to so much; the dotted line is that of CE90.",
        [svg(made)],
    )


def _sigma_against_error(methods: Sequence[MethodResult]) -> Plot:
    made, axes = figure(WIDTH_IN, 4.2)
    sigmas = []
    for number, method in enumerate(methods):
        predicted = [math.sqrt(np.trace(one.covariance_en)) for one in method.located]
        inside = sum(one.is_inside for one in method.located)
        label = f"{method.method}: {inside} of {len(predicted)} inside"
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(predicted, method.errors.distance_m, ".", color=colour, label=label)
        sigmas += predicted
    line = np.array([min(sigmas), max(sigmas)])
    axes.plot(line, math.sqrt(CHI2_95 / 2) * line, color=_GREY, linestyle=":")
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
    control, middle = _control(found)
    made, axes = figure(WIDTH_IN, 4.2)
    sensors, best = found.sensors, found.methods[-1]
    dots = {"marker": ".", "linestyle": "", "markersize": 2.5}
    for name, place_en, colour, style in (
        ("ordinary GPS", sensors.gps.place_en, COLOURS[4], dots),
        ("RTK", sensors.rtk.place_en, COLOURS[0], dots),
        (best.method, best.body.place_en, COLOURS[2], {}),
    ):
        if len(place_en):
            shown = (place_en - middle)[thinned(len(place_en))]
            axes.plot(*shown.T, color=colour, label=name, **style)
    axes.plot(*control.T, "+", color=COLOURS[6], label="control points")
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    axes.legend()
    return Plot(
        "Track",
        f"From {middle[0]:.0f} m east, {middle[1]:.0f} m north in {found.projection.name} "
        "(Figure 15 of the paper).",
        [svg(made)],
    )


def thinned(count: int) -> slice:
    """Return evenly spaced instants of so many, fewer than 3000: a figure resolves no more."""
    return slice(None, None, max(count // 1500, 1))
