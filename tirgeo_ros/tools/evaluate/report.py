"""Lay out an evaluation: as tables for a terminal, and as one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult
from tirgeo_ros.tools.presentation.plots import (
    COLOURS,
    arrows,
    embedded,
    figure,
    html_page,
    logarithmic,
    svg,
)

#: Width of a figure (inches): narrow enough to be readable on a telephone.
_WIDTH_IN = 4.4
#: Length of the longest error vector as a share of the survey's extent.
_VECTOR_SHARE = 0.12
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_CLUTTER = 40  # most points that are labelled with their names


class Plot(NamedTuple):
    """Hold a figure for the report: pictures that are placed side by side if there is room."""

    title: str
    caption: str
    svgs: Sequence[bytes]


def plots(found: Evaluation) -> Iterator[Plot]:
    """Yield the plots of the errors, if points were located, and of the flight."""
    methods = [method for method in found.methods if method.located]
    best = found.methods[-1]
    if methods:
        yield Plot(
            "Errors of the control points",
            "Vectors from each surveyed point (cross) to its located observations, "
            "enlarged as the titles say. Mean over the points of Equation 24 in the titles "
            "(Figures 23 to 26 of the paper).",
            [_vectors(found, method) for method in methods],
        )
        yield Plot(
            "Sigma against error",
            "Each observation's horizontal error beside the root mean square that the method "
            "predicts for it. The dotted line holds 95 % of them where the error is as likely in "
            "all directions.",
            [_sigma_against_error(methods)],
        )
    yield Plot(
        "Track", f"In {found.projection.name} (Figure 15 of the paper).", [_track(found, best)]
    )


def _control(found: Evaluation) -> tuple[Array, Array]:
    """Return the control points (P, 2) from their mean, and that mean (2,): east, north, m."""
    middle = np.round(found.places_en.mean(axis=0))
    return found.places_en - middle, middle


def _vectors(found: Evaluation, method: MethodResult) -> bytes:
    control, middle = _control(found)
    span = max(*np.ptp(control, axis=0).tolist(), 1.0)
    most = _VECTOR_SHARE * span / max(float(method.errors.distance_m.max()), 1e-6)
    times = max((times for times in _MAGNIFICATIONS if times <= most), default=1)
    made, panel = figure(_WIDTH_IN, 4.2)
    error = method.errors.error_en
    begin = np.array([one.place_en for one in method.located]) - middle - error
    arrows(panel, begin, times * error, COLOURS[1], 0.005)
    panel.plot(*control.T, "+", color=COLOURS[0], markersize=6)
    shown = f", vectors x {times}" if times > 1 else ""
    title = f"{method.method}: {method.errors.mean_point_rmse_m:.3f} m{shown}"
    panel.set(title=title, xlabel="east, m", ylabel="north, m", aspect="equal")
    panel.margins(0.12)
    if len(control) <= _CLUTTER:
        for name, place in zip(found.control, control, strict=True):
            panel.annotate(name, place, (3, 3), textcoords="offset points", fontsize=7)
    return svg(made)


def _sigma_against_error(methods: Sequence[MethodResult]) -> bytes:
    made, axes = figure(_WIDTH_IN, 4.2)
    sigmas = []
    for number, method in enumerate(methods):
        predicted = [math.sqrt(np.trace(one.covariance_en)) for one in method.located]
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(predicted, method.errors.distance_m, ".", color=colour, label=method.method)
        sigmas += predicted
    line = np.array([min(sigmas), max(sigmas)])
    axes.plot(line, math.sqrt(CHI2_95 / 2) * line, color="#888888", linestyle=":")
    axes.set(xlabel="sigma as predicted, m", ylabel="error, m")
    for which in ("x", "y"):
        logarithmic(axes, which)
    axes.legend(fontsize=8)
    return svg(made)


def _track(found: Evaluation, best: MethodResult) -> bytes:
    control, middle = _control(found)
    made, axes = figure(_WIDTH_IN, 4.2)
    for name, track, form, colour in (
        ("ordinary GPS", found.receivers.get("gps_position"), ".", COLOURS[4]),
        ("RTK", found.receivers.get("rtk_position"), ".", COLOURS[0]),
        (best.method, best.track, "-", COLOURS[2]),
    ):
        if track is not None and len(track.places):
            shown = found.projection.project(*track.places.T) - middle
            axes.plot(*shown.T, form, color=colour, label=name, markersize=2.5)
    axes.plot(*control.T, "+", color=COLOURS[6], label="control points")
    axes.set(xlabel=f"east - {middle[0]:.0f} m", ylabel=f"north - {middle[1]:.0f} m")
    axes.set(aspect="equal")
    axes.legend()
    return svg(made)


_STYLE = """
.verdict { font-size: 1.15rem; font-weight: 600; }
th, td { text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0;
  background: var(--paper); }
.wide { overflow-x: auto; }
figure img { width: 100%; height: auto; display: block; }
.side { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr));
  gap: 1rem; }
.side > img:only-child { max-width: 34rem; }
@media (max-width: 30rem) {
  th, td { padding: .15rem .2rem; font-size: .74rem; white-space: normal; }
}
"""
_WIDTH = 13  # of a table's column
_Number = Mapping[str, Any]


class Table(NamedTuple):
    """Hold a table of text; its first column is left-aligned."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(numbers: _Number) -> list[Table]:
    """Return the tables of what ``summary`` returns: Tables 6 and 7, and the aircraft's errors."""
    found = [_errors(numbers), _p_values(numbers)]
    truths = {name: one["against_truth"] for name, one in numbers["methods"].items()}
    if all(truths.values()):
        keys = next(iter(truths.values()))
        rows = [
            [key.replace("_", ", "), *(_metres(one[key]) for one in truths.values())]
            for key in keys
        ]
        title = f"rms of the aircraft's own errors later than {numbers['settled_s']:g} s"
        found.append(Table(f"{title}, by the truth", ["", *truths], rows))
    return found


def text_tables(numbers: _Number) -> str:
    """Return the verdict, the tables and the notes of what ``summary`` returns."""
    parts = [numbers["verdict"]]
    for one in tables(numbers):
        lines = [f"{row[0]:<{_WIDTH}}" + "".join(f"{cell:>{_WIDTH}}" for cell in row[1:])
                 for row in (one.head, *one.rows)]  # fmt: skip
        parts.append("\n".join([one.title, *lines]))
    words = [
        f"plane: {numbers['projection']['name']}",
        "mean: of the points' errors; rmse, CE90 (90th percentile): of all observations;",
        "in ellipse: the surveyed place lies in the predicted ellipse of 95 %",
    ]
    for method, one in numbers["methods"].items():
        words += [f"{method}: {number} x {why}" for why, number in one["refused"].items()]
    return "\n\n".join([*parts, "\n".join([*words, *numbers["notes"]])])


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.0f} %" if whole else "-"


#: Title of each row on a whole method, and its cell.
_OF_METHOD: dict[str, Callable[[_Number], str]] = {
    "mean": lambda one: _metres(one["mean_point_rmse_m"]),
    "rmse": lambda one: _metres(one["rmse_m"]),
    "CE90": lambda one: _metres(one["ce90_m"]),
    "mean east": lambda one: _metres(one["mean_error_east_m"]),
    "mean north": lambda one: _metres(one["mean_error_north_m"]),
    "located": lambda one: str(one["located"]),
    "in ellipse": lambda one: _percent(one["inside_95"], one["located"]),
    "gimbal": lambda one: str(one["composition"]),
}


def _errors(numbers: _Number) -> Table:
    methods, points = numbers["methods"], numbers["points"]
    rows = [
        [name, *(_metres(one["rmse_m"][m]) for m in methods), str(one["observations"])]
        for name, one in points.items()
    ]
    seen = {"located": f"of {sum(one['observations'] for one in points.values())}"}
    rows += [
        [title, *(cell(one) for one in methods.values()), seen.get(title, "")]
        for title, cell in _OF_METHOD.items()
    ]
    title = "horizontal error of each control point (rmse over its observations, Eq. 24), m"
    return Table(title, ["point", *methods, "seen"], rows)


def _p_values(numbers: _Number) -> Table:
    methods = list(numbers["methods"])
    cells = {}
    for test in numbers["t_tests"]:
        p_value, pair = test["p_value"], (test["first"], test["second"])
        text = "-" if p_value is None else "< 0.0001" if p_value < 1e-4 else f"{p_value:.4f}"
        cells[pair] = cells[pair[::-1]] = text
    rows = [[row, *(cells.get((row, column), "-") for column in methods)] for row in methods]
    return Table("paired t-test on these points, two-sided p-value", ["", *methods], rows)


def report_html(found: Evaluation, numbers: Mapping[str, Any]) -> str:
    """Return the page of an evaluation and of what ``summary`` returns for it."""
    lead = (
        f"survey {found.survey_path}; observations {found.observations_path}; errors in "
        f"{found.projection.name}; ground {found.methods[0].setup.ground_words}."
    )
    title = f"Ground points of {Path(found.bag).name}"
    body = "\n".join(
        [
            f"<h1>{escape(title)}</h1>",
            f'<p class="verdict">{escape(numbers["verdict"])}</p>',
            f'<p class="lead">{escape(lead)}</p>',
            f'<p class="fault">{escape(found.error)}</p>' if found.error else "",
            "<ul>",
            *(f"<li>{escape(text)}</li>" for text in found.notes),
            "</ul>",
            *(_table(one) for one in tables(numbers)),
            *(_figure(plot) for plot in plots(found)),
            "<h2>Overlay</h2>" if found.stills else "",
            '<div class="side">',
            *(_still(*one) for one in found.stills),
            "</div>",
        ]
    )
    return html_page(title, _STYLE, body)


def _table(one: Table) -> str:
    rows = "".join(_row(row, "td") for row in one.rows)
    body = f"<thead>{_row(one.head, 'th')}</thead><tbody>{rows}</tbody>"
    title = escape(one.title[:1].upper() + one.title[1:])
    return f'<h2>{title}</h2>\n<div class="wide"><table>{body}</table></div>'


def _row(cells: Sequence[str], tag: str) -> str:
    """Return a row; names in a head may break at an underscore."""
    breaks = "_<wbr>" if tag == "th" else "_"
    shown = [escape(cell).replace("_", breaks) for cell in cells]
    return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in shown) + "</tr>"


def _figure(plot: Plot) -> str:
    pictures = [embedded(svg, "image/svg+xml", plot.title) for svg in plot.svgs]
    caption = f"<figcaption>{escape(plot.caption)}</figcaption>"
    side = f'<div class="side">{"".join(pictures)}</div>'
    return f"<h2>{escape(plot.title)}</h2>\n<figure>{side}{caption}</figure>"


def _still(caption: str, jpeg: bytes) -> str:
    picture = embedded(jpeg, "image/jpeg", caption)
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"
