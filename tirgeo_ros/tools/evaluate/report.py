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
"""Convert an evaluation's numbers to plain values (None if absent), and write them to files."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import (
    PathLike,
    check_outputs,
    csv_text,
    made_folder,
    write_files,
)
from tirgeo_ros.tools.evaluate.result import (
    BodyErrors,
    Evaluation,
    LocatedPoint,
    MethodResult,
    RefusedPoint,
)
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, embedded, figure, html_page, svg
from tirgeo_ros.tools.presentation.results import finding_items, table

#: Settling time of the filter; errors against the truth count only after it.
SETTLED_S = 20.0
#: With a larger median error (m) under every method, the survey is of another place.
_ELSEWHERE_M = 500.0
#: Confidence of the ellipses, and the probability below which a lower share inside is no chance.
_CONFIDENCE, _CHANCE = 0.95, 0.01
_ROUNDING = 1e-9  # rounding error of a share times some thousands
#: The files of an evaluation, and the columns of the first.
_NAMES = ("observations.csv", "result.json", "report.html")
_OBSERVATION_COLUMNS = (
    *("id", "stamp_ns", "u", "v", "method", "east_m", "north_m", "height_m"),
    *("error_east_m", "error_north_m", "distance_m", "sigma_east_m", "sigma_north_m"),
    *("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg", "reason"),
)
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
#: Title of each row about a whole method -> key in the numbers.
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


def summary(evaluation: Evaluation) -> dict[str, object]:
    """Return all numbers for JSON; lengths are metres in the projected plane."""
    return {
        "verdict": verdict(evaluation.methods),
        "input": evaluation.bag,
        "survey": evaluation.survey_path,
        "observations": evaluation.observations_path,
        "projection": {"name": evaluation.experiment.projection.name},
        "smoothed": evaluation.smoothed,
        "methods": {each.method: _method(each) for each in evaluation.methods},
        "missing": dict(evaluation.missing),
        "points": _points(evaluation),
        "t_tests": [test._asdict() for test in evaluation.tests],
        "settled_s": SETTLED_S,
        "notes": list(evaluation.notes),
        "findings": finding_items(evaluation.findings),
        "error": evaluation.error,
    }


def verdict(methods: Sequence[MethodResult]) -> str:
    """Return a sentence on the last and best method: whether its errors are as predicted."""
    best = methods[-1]
    located = best.located
    if not located:
        why = best.refused[0].reason if best.refused else "no surveyed point was observed"
        return f"none of {len(best.refused)} could be located: {why} ({best.method})"
    note = place_note(methods)
    if note:
        return note
    inside, pictures = sum(point.is_inside for point in located), {p.stamp_ns for p in located}
    why, mean_en = "", best.errors.mean_error_en
    if mean_en is not None and not is_honest(inside / len(located), len(pictures)):
        why = (
            f", with a common error of {mean_en[0]:+.2f} m east and {mean_en[1]:+.2f} m north: "
            "run calibrate boresight; check that all heights are ellipsoidal, and that survey and "
            "RTK base have one datum"
        )
    mean_m = float(best.errors.distance_m.mean())
    return (
        f"{inside} of {len(located)} lie in their ellipse of 95 %, {mean_m:.2f} m off on "
        f"average{why} ({best.method})"
    )


def place_note(methods: Sequence[MethodResult]) -> str:
    """Return a note if the survey seems to be of another place, else ""."""
    errors_m = [method.errors.distance_m for method in methods if method.located]
    usual_m = min((float(np.median(errors)) for errors in errors_m), default=0.0)
    if usual_m < _ELSEWHERE_M:
        return ""
    return (
        f"the observed points lie {usual_m / 1000:.3g} km from the surveyed ones: check that "
        "survey and observations belong to this flight, and that the survey is in WGS84"
    )


def is_honest(share: float, pictures: int) -> bool:
    """Return whether the share of points inside is consistent with ellipses of 95 %.

    It is not, if such a low share occurs by chance in at most one of a hundred experiments (by the
    binomial distribution). Observations of one picture share its pose, so pictures are counted.
    """
    from scipy.special import bdtr  # noqa: PLC0415  slow to import

    inside = math.floor(share * pictures + _ROUNDING)
    return bool(bdtr(inside, pictures, _CONFIDENCE) >= _CHANCE)


def _method(result: MethodResult) -> dict[str, object]:
    errors, mean_en = result.errors, result.errors.mean_error_en
    east, north = (None, None) if mean_en is None else mean_en.tolist()
    return {
        "mean_point_rmse_m": errors.mean_point_rmse_m,
        "rmse_m": errors.rmse_m,
        "ce90_m": errors.ce90_m,
        "mean_error_east_m": east,
        "mean_error_north_m": north,
        "points": len(errors.point_rmse_m),
        "located": len(result.located),
        "inside_95": sum(point.is_inside for point in result.located),
        "refused": dict(Counter(point.reason for point in result.refused)),
        "composition": result.composition,
        "state": result.state,
        "ground": result.setup.ground_words,
        "against_truth": None if result.against_truth is None else _truth(result.against_truth),
    }


def _truth(errors: BodyErrors) -> dict[str, float | None]:
    """Return rms errors; None if the flight was too short to settle."""
    rms = {
        "roll_deg": math.degrees(errors.roll_rad),
        "pitch_deg": math.degrees(errors.pitch_rad),
        "heading_deg": math.degrees(errors.heading_rad),
        "position_m": errors.position_m,
    }
    return {name: value if math.isfinite(value) else None for name, value in rms.items()}


def _points(evaluation: Evaluation) -> dict[str, dict[str, object]]:
    """Return the observed points in the survey's order, with their error under each method."""
    experiment = evaluation.experiment
    counts = Counter(click.id for click in experiment.observations)
    points = {}
    for name, point in experiment.survey.items():
        if name in counts:
            place = experiment.projection.project(point.latitude_rad, point.longitude_rad)
            errors = {
                each.method: each.errors.point_rmse_m.get(name) for each in evaluation.methods
            }
            points[name] = {
                "observations": counts[name],
                "east_m": float(place[0]),
                "north_m": float(place[1]),
                "height_m": point.height_m,
                "rmse_m": errors,
            }
    return points


def check_folder(folder: PathLike, inputs: Iterable[PathLike | None]) -> None:
    """Raise CalibrationError if an output in the folder would overwrite one of the inputs."""
    check_outputs(inputs, [Path(folder) / name for name in _NAMES], CalibrationError)


def write_evaluation(evaluation: Evaluation, folder: PathLike) -> list[str]:
    """Write the errors by observation, all numbers and the report; return the paths.

    The folder is created; all files are written or none. Raise CalibrationError.
    """
    numbers = summary(evaluation)
    text = json.dumps(numbers, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    texts = _observations_csv(evaluation), text, report_html(evaluation, numbers)
    place = made_folder(folder, CalibrationError)
    contents = zip(_NAMES, texts, strict=True)
    write_files({place / name: content for name, content in contents}, CalibrationError)
    return [str(place / name) for name in _NAMES]


def _observations_csv(evaluation: Evaluation) -> str:
    rows: list[list[object]] = [list(_OBSERVATION_COLUMNS)]
    for each in evaluation.methods:
        points: list[LocatedPoint | RefusedPoint] = [*each.located, *each.refused]
        for point in points:
            lead = [point.id, point.stamp_ns, *(f"{px:.3f}" for px in point.uv), each.method]
            if isinstance(point, LocatedPoint):
                rows.append([*lead, *_measured(point), ""])
            else:
                rows.append([*lead, *[""] * 11, point.reason])
    return csv_text(rows)


def _measured(point: LocatedPoint) -> list[str]:
    """Return the columns from ``east_m`` to ``ellipse_azimuth_deg``."""
    east, north = point.error_en.tolist()
    sigmas = np.sqrt(np.maximum(point.covariance_en.diagonal(), 0.0)).tolist()
    metres = [*point.place_en, point.height_m, east, north, math.hypot(east, north), *sigmas]
    metres += [point.ellipse.major_m, point.ellipse.minor_m]
    azimuth_deg = math.degrees(point.ellipse.azimuth_rad)
    return [*(f"{value:.4f}" for value in metres), f"{azimuth_deg:.2f}"]


def tables(numbers: _Number) -> dict[str, Sequence[Sequence[str]]]:
    """Return Tables 6 and 7, and the aircraft's errors, by title; the first row is the head."""
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
    result: dict[str, Sequence[Sequence[str]]] = {title: rows, p_title: [["", *methods], *matrix]}
    truths = {name: method["against_truth"] for name, method in methods.items()}
    if all(truths.values()):
        keys = next(iter(truths.values()))
        body = [
            [key.replace("_", ", "), *(_text(each[key]) for each in truths.values())]
            for key in keys
        ]
        title = f"rms of the aircraft's own errors later than {numbers['settled_s']:g} s, "
        result[f"{title}by the truth"] = [["", *truths], *body]
    return result


def _text(value: float | str | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def text_tables(numbers: _Number) -> str:
    """Return the verdict, the tables and the notes from the result of ``summary``."""
    parts = [numbers["verdict"]]
    parts += [f"{title}\n{table(rows, right=True)}" for title, rows in tables(numbers).items()]
    words = [
        f"plane: {numbers['projection']['name']}",
        "mean: of the points' errors; rmse, CE90 (90th percentile): of all observations;",
        "in ellipse: the surveyed place lies in the predicted ellipse of 95 %",
    ]
    for name, method in numbers["methods"].items():
        words += [f"{name}: {number} x {why}" for why, number in method["refused"].items()]
    return "\n\n".join([*parts, "\n".join([*words, *numbers["notes"]])])


def report_html(evaluation: Evaluation, numbers: _Number) -> str:
    """Return the page of an evaluation; ``numbers`` is the result of its ``summary``."""
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
        *(_table_html(name, rows) for name, rows in tables(numbers).items()),
        f'{heading}<figure><div class="side">{pictures}</div>{caption}</figure>' if plots else "",
    ]
    return html_page(title, _STYLE, "\n".join(parts))


def _table_html(title: str, rows: Sequence[Sequence[str]]) -> str:
    head, *body = (
        "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>"
        for row, tag in zip(rows, ["th", *["td"] * len(rows)], strict=False)
    )
    content = f"<thead>{head}</thead><tbody>{''.join(body)}</tbody>"
    heading = escape(title[:1].upper() + title[1:])
    return f'<h2>{heading}</h2>\n<div class="wide"><table>{content}</table></div>'


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
    chart, panel = figure(4.4, 4.2)  # inches: readable on a telephone
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
    return svg(chart)
