"""Lay out an evaluation: as tables for a terminal, and as one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, embedded, figure, html_page, svg
from tirgeo_ros.tools.presentation.results import table

#: Length of the longest error vector as a share of the survey's extent.
_VECTOR_SHARE = 0.12
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_CLUTTER = 40  # most points that are labelled with their names
_STYLE = """
.verdict { font-size: 1.15rem; font-weight: 600; }
th, td { text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0;
  background: var(--paper); }
.wide { overflow-x: auto; }
.side { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr));
  gap: 1rem; }
.side img { width: 100%; max-width: 34rem; }
"""
_CAPTION = (
    "Vectors from each surveyed point (cross) to its located observations, enlarged as the titles "
    "say. Mean over the points of Equation 24 in the titles (Figures 23 to 26 of the paper)."
)
#: Title of each row on a whole method, and its key in the numbers.
_OF_METHOD = {
    "mean": "mean_point_rmse_m",
    "rmse": "rmse_m",
    "CE90": "ce90_m",
    "mean east": "mean_error_east_m",
    "mean north": "mean_error_north_m",
    "located": "located",
    "in ellipse": "inside_95",
    "gimbal": "composition",
}
_Number = Mapping[str, Any]


class Table(NamedTuple):
    """Hold a table of text; its first row is the head."""

    title: str
    rows: Sequence[Sequence[str]]


def tables(numbers: _Number) -> list[Table]:
    """Return the tables of what ``summary`` returns: Tables 6 and 7, and the aircraft's errors."""
    methods, points = numbers["methods"], numbers["points"]
    rows = [["point", *methods, "clicks"]]
    for name, point in points.items():
        errors = (_text(point["rmse_m"][method]) for method in methods)
        rows.append([name, *errors, str(point["observations"])])
    for title, key in _OF_METHOD.items():
        rows.append([title, *(_text(method[key]) for method in methods.values()), ""])
    title = "horizontal error of each control point (rmse over its observations, Eq. 24), m"
    p_values = {}
    for test in numbers["t_tests"]:
        p_value, pair = test["p_value"], (test["first"], test["second"])
        text = "-" if p_value is None else "< 0.0001" if p_value < 1e-4 else f"{p_value:.4f}"
        p_values[pair] = p_values[pair[::-1]] = text
    matrix = [[row, *(p_values.get((row, column), "-") for column in methods)] for row in methods]
    p_title = "paired t-test on these points, two-sided p-value"
    made = [Table(title, rows), Table(p_title, [["", *methods], *matrix])]
    truths = {name: method["against_truth"] for name, method in methods.items()}
    if all(truths.values()):
        keys = next(iter(truths.values()))
        body = [
            [key.replace("_", ", "), *(_text(each[key]) for each in truths.values())]
            for key in keys
        ]
        title = f"rms of the aircraft's own errors later than {numbers['settled_s']:g} s, "
        made.append(Table(f"{title}by the truth", [["", *truths], *body]))
    return made


def _text(value: float | str | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def text_tables(numbers: _Number) -> str:
    """Return the verdict, the tables and the notes of what ``summary`` returns."""
    parts = [numbers["verdict"]]
    parts += [f"{each.title}\n{table(each.rows, right=True)}" for each in tables(numbers)]
    words = [
        f"plane: {numbers['projection']['name']}",
        "mean: of the points' errors; rmse, CE90 (90th percentile): of all observations;",
        "in ellipse: the surveyed place lies in the predicted ellipse of 95 %",
    ]
    for name, method in numbers["methods"].items():
        words += [f"{name}: {number} x {why}" for why, number in method["refused"].items()]
    return "\n\n".join([*parts, "\n".join([*words, *numbers["notes"]])])


def report_html(evaluation: Evaluation, numbers: _Number) -> str:
    """Return the page of an evaluation and of what ``summary`` returns for it."""
    lead = (
        f"survey {evaluation.survey_path}; observations {evaluation.observations_path}; errors in "
        f"{numbers['projection']['name']}; ground {evaluation.methods[0].setup.ground_words}."
    )
    title = f"Ground points of {Path(evaluation.bag).name}"
    plots = [_vectors(evaluation, method) for method in evaluation.methods if method.located]
    pictures = "".join(embedded(plot, "image/svg+xml", "error vectors") for plot in plots)
    heading = "<h2>Errors of the control points</h2>\n"
    caption = f"<figcaption>{escape(_CAPTION)}</figcaption>"
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="verdict">{escape(numbers["verdict"])}</p>',
        f'<p class="lead">{escape(lead)}</p>',
        f'<p class="fault">{escape(evaluation.error)}</p>' if evaluation.error else "",
        "<ul>",
        *(f"<li>{escape(text)}</li>" for text in evaluation.notes),
        "</ul>",
        *(_table_html(each) for each in tables(numbers)),
        f'{heading}<figure><div class="side">{pictures}</div>{caption}</figure>' if plots else "",
    ]
    return html_page(title, _STYLE, "\n".join(parts))


def _table_html(each: Table) -> str:
    head, *body = (
        "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>"
        for row, tag in zip(each.rows, ["th", *["td"] * len(each.rows)], strict=False)
    )
    content = f"<thead>{head}</thead><tbody>{''.join(body)}</tbody>"
    title = escape(each.title[:1].upper() + each.title[1:])
    return f'<h2>{title}</h2>\n<div class="wide"><table>{content}</table></div>'


def _vectors(evaluation: Evaluation, method: MethodResult) -> bytes:
    """Return a plot (SVG) of the errors as vectors from the surveyed points."""
    survey = evaluation.experiment.survey
    geodetic = np.array([(point.latitude_rad, point.longitude_rad) for point in survey.values()])
    places = evaluation.experiment.projection.project(*geodetic.T)
    middle = np.round(places.mean(axis=0))
    places -= middle
    span = max(*np.ptp(places, axis=0).tolist(), 1.0)
    most = _VECTOR_SHARE * span / max(float(method.errors.distance_m.max()), 1e-6)
    times = max((times for times in _MAGNIFICATIONS if times <= most), default=1)
    made, panel = figure(4.4, 4.2)  # inches: readable on a telephone
    error = method.errors.error_en
    begin = np.array([point.place_en for point in method.located]) - middle - error
    arrows(panel, begin, times * error, COLOURS[1], 0.005)
    panel.plot(*places.T, "+", color=COLOURS[0], markersize=6)
    enlarged = f", vectors x {times}" if times > 1 else ""
    title = f"{method.method}: {method.errors.mean_point_rmse_m:.3f} m{enlarged}"
    panel.set(title=title, xlabel="east, m", ylabel="north, m", aspect="equal")
    panel.margins(0.12)
    if len(places) <= _CLUTTER:
        for name, place in zip(survey, places, strict=True):
            panel.annotate(name, place, (3, 3), textcoords="offset points", fontsize=7)
    return svg(made)
