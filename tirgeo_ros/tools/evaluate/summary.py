"""Convert an evaluation's numbers to plain values (None where absent), and to files."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import (
    PathLike,
    check_outputs,
    csv_text,
    made_folder,
    write_files,
)
from tirgeo_ros.tools.evaluate.report import report_html
from tirgeo_ros.tools.evaluate.result import Evaluation, LocatedPoint, MethodResult, RefusedPoint
from tirgeo_ros.tools.evaluate.series import SETTLED_S, BodyErrors
from tirgeo_ros.tools.evaluate.verdict import verdict
from tirgeo_ros.tools.presentation.results import finding_items

_NAMES = ("points.csv", "observations.csv", "result.json", "report.html")
_OBSERVATION_COLUMNS = (
    *("id", "stamp_ns", "u", "v", "method", "east_m", "north_m", "height_m"),
    *("error_east_m", "error_north_m", "distance_m", "sigma_east_m", "sigma_north_m"),
    *("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg", "reason"),
)


def summary(found: Evaluation) -> dict[str, object]:
    """Return all numbers, for JSON: lengths in m, in the projected plane."""
    return {
        "verdict": verdict(found.methods),
        "input": found.bag,
        "survey": found.survey_path,
        "observations": found.observations_path,
        "projection": asdict(found.projection),
        "smoothed": found.smoothed,
        "methods": {one.method: _method(one) for one in found.methods},
        "missing": dict(found.missing),
        "points": _points(found),
        "t_tests": [one._asdict() for one in found.tests],
        "settled_s": SETTLED_S,
        "notes": list(found.notes),
        "findings": finding_items(found.findings),
        "error": found.error,
    }


def _method(one: MethodResult) -> dict[str, object]:
    errors, mean_en = one.errors, one.errors.mean_error_en
    east, north = (None, None) if mean_en is None else mean_en.tolist()
    return {
        "mean_point_rmse_m": errors.mean_point_rmse_m,
        "rmse_m": errors.rmse_m,
        "ce90_m": errors.ce90_m,
        "mean_error_east_m": east,
        "mean_error_north_m": north,
        "points": len(errors.point_rmse_m),
        "located": len(one.located),
        "inside_95": sum(point.is_inside for point in one.located),
        "refused": dict(Counter(point.reason for point in one.refused)),
        "composition": one.composition,
        "state": one.state,
        "ground": one.setup.ground_words,
        "against_truth": None if one.against_truth is None else _truth(one.against_truth),
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


def _points(found: Evaluation) -> dict[str, dict[str, object]]:
    """Return the observed points in the survey's order, with their error under each method."""
    places, first = found.places_en.tolist(), found.methods[0]  # all have the same observations
    seen = Counter([one.id for one in first.located] + [one.id for one in first.refused])
    return {
        name: {
            "observations": seen[name],
            "east_m": east_m,
            "north_m": north_m,
            "height_m": point.height_m,
            "rmse_m": {one.method: one.errors.point_rmse_m.get(name) for one in found.methods},
        }
        for (name, point), (east_m, north_m) in zip(found.control.items(), places, strict=True)
        if name in seen
    }


def check_folder(folder: PathLike, inputs: Iterable[PathLike | None]) -> None:
    """Raise CalibrationError if an output in the folder would overwrite one of the inputs."""
    check_outputs(inputs, [Path(folder) / name for name in _NAMES], CalibrationError)


def write_evaluation(found: Evaluation, folder: PathLike) -> list[str]:
    """Write the errors by point and by observation, all numbers, the report; return the paths.

    The folder is created; all files are written or none. Raise CalibrationError.
    """
    numbers = summary(found)
    text = json.dumps(numbers, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    texts = _points_csv(found), _observations_csv(found), text, report_html(found, numbers)
    place = made_folder(folder, CalibrationError)
    contents = zip(_NAMES, texts, strict=True)
    write_files({place / name: content for name, content in contents}, CalibrationError)
    return [str(place / name) for name in _NAMES]


def _points_csv(found: Evaluation) -> str:
    methods = [one.method for one in found.methods]
    rows: list[list[object]] = [["id", *(f"{name}_rmse_m" for name in methods), "observations"]]
    for name, point in _points(found).items():
        errors = (one.errors.point_rmse_m.get(name) for one in found.methods)
        cells = ["" if error is None else f"{error:.4f}" for error in errors]
        rows.append([name, *cells, point["observations"]])
    return csv_text(rows)


def _observations_csv(found: Evaluation) -> str:
    rows: list[list[object]] = [list(_OBSERVATION_COLUMNS)]
    for one in found.methods:
        points: list[LocatedPoint | RefusedPoint] = [*one.located, *one.refused]
        for point in points:
            lead = [point.id, point.stamp_ns, *(f"{px:.3f}" for px in point.uv), one.method]
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
