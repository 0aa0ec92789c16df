"""Convert an evaluation's numbers to plain values (None where absent), and to files."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tirgeo_ros.core.config import METHODS
from tirgeo_ros.core.config.schema import Value
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import (
    PathLike,
    check_outputs,
    csv_text,
    made_folder,
    write_files,
)
from tirgeo_ros.io.parameters.parameter_output import parameters_yaml
from tirgeo_ros.tools.evaluate.methods import CALIBRATED
from tirgeo_ros.tools.evaluate.result import Evaluation, LocatedPoint, MethodResult, RefusedPoint
from tirgeo_ros.tools.evaluate.series import SETTLED_S
from tirgeo_ros.tools.evaluate.verdict import verdict
from tirgeo_ros.tools.replay.finding_lines import finding_items
from tirgeo_ros.tools.replay.recorded_flight import BodyErrors

#: Meanings of the measures, written beside them in every output.
DEFINITIONS = {
    "point_rmse_m": "root mean square of a point's horizontal errors (Eq. 24)",
    "mean_point_rmse_m": "mean of that over the points, as in the last row of Table 6",
    "rmse_m": "root mean square of all horizontal errors",
    "ce90_m": "90th percentile of all horizontal errors, linear between the two nearest",
    "inside_95": "located points whose surveyed place lies in their predicted ellipse of 95 %",
    "against_truth": f"rms of the aircraft's own errors later than {SETTLED_S:g} s, by the truth",
    "p_value": "two-sided, of the paired t-test on point_rmse_m of the points that both have",
}
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
        "methods": {one.method: _method(one) for one in found.methods},
        "missing": dict(found.missing),
        "points": _points(found),
        "t_tests": [asdict(one) for one in found.tests],
        "checks": asdict(found.checks),
        "definitions": DEFINITIONS,
        "notes": list(found.notes),
        "findings": finding_items(found.findings),
        "warning": "; ".join(f"{one} is missing: {why}" for one, why in found.faults.items())
        or None,
        "error": found.error,
    }


def _method(one: MethodResult) -> dict[str, object]:
    errors = one.errors
    mean_en = errors.mean_error_en
    return {
        "mean_point_rmse_m": errors.mean_point_rmse_m,
        "rmse_m": errors.rmse_m,
        "ce90_m": errors.ce90_m,
        "mean_error_east_m": None if mean_en is None else float(mean_en[0]),
        "mean_error_north_m": None if mean_en is None else float(mean_en[1]),
        "points": len(errors.point_rmse_m),
        "located": len(one.located),
        "inside_95": sum(point.is_inside for point in one.located),
        "refused": dict(Counter(point.reason for point in one.refused)),
        "composition": one.composition,
        "state": one.state,
        "ground": one.setup.ground_words,
        "verdicts": dict(one.verdicts),
        "against_truth": None if one.against_truth is None else _truth(one.against_truth),
    }


def _truth(errors: BodyErrors) -> dict[str, object]:
    """Return rms errors; None if the flight was too short."""
    angles = {"roll": errors.roll_rad, "pitch": errors.pitch_rad, "heading": errors.heading_rad}
    rms = {f"{name}_deg": math.degrees(angle) for name, angle in angles.items()}
    rms["position_m"] = errors.position_m
    return {name: value if math.isfinite(value) else None for name, value in rms.items()}


def _points(found: Evaluation) -> dict[str, dict[str, object]]:
    """Return the observed points in the survey's order, with their error under each method."""
    first = found.methods[0]  # all have the same observations
    seen = Counter([one.id for one in first.located] + [one.id for one in first.refused])
    return {
        name: {
            "observations": seen[name],
            "east_m": point.east_m,
            "north_m": point.north_m,
            "height_m": point.height_m,
            "rmse_m": {one.method: one.errors.point_rmse_m.get(name) for one in found.methods},
        }
        for name, point in found.control.items()
        if name in seen
    }


def check_folder(folder: PathLike, inputs: Iterable[PathLike | None]) -> None:
    """Raise CalibrationError if an output in the folder would overwrite one of the inputs."""
    methods = (*METHODS, CALIBRATED)
    names = ("points.csv", "observations.csv", "result.json", "report.html")
    outputs = [Path(folder) / name for name in (*names, *map(_parameters_name, methods))]
    check_outputs(inputs, outputs, CalibrationError)


def _parameters_name(method: str) -> str:
    return f"params_{method}.yaml"


def write_evaluation(
    found: Evaluation, folder: PathLike, more: Mapping[str, str | bytes] | None = None
) -> list[str]:
    """Write the numbers, and ``more`` files by name, to a folder; return the paths, in order.

    The files are ``points.csv``, ``observations.csv``, ``result.json``, and for each method the
    parameters that it ran with. The folder is created; all files are written or none. Raise
    CalibrationError.
    """
    place = Path(folder)
    numbers = json.dumps(summary(found), indent=1, allow_nan=False, ensure_ascii=False)
    contents: dict[PathLike, str | bytes] = {
        place / "points.csv": _points_csv(found),
        place / "observations.csv": _observations_csv(found),
        place / "result.json": numbers + "\n",
    }
    for one in found.methods:
        contents[place / _parameters_name(one.method)] = _parameters(found, one)
    contents |= {place / name: content for name, content in (more or {}).items()}
    made_folder(place, CalibrationError)
    write_files(contents, CalibrationError)
    return [str(path) for path in contents]


def _parameters(found: Evaluation, one: MethodResult) -> str:
    """Return the parameters that are set: NaN and empty lists or strings are unset."""
    nodes = {
        node: {name: value for name, value in values.items() if _is_set(value)}
        for node, values in one.setup.parameters.items()
    }
    return parameters_yaml(nodes, f"With what the method {one.method} ran over {found.bag}.")


def _is_set(value: Value) -> bool:
    return not (isinstance(value, float) and math.isnan(value)) and value not in ("", (), [])


def _points_csv(found: Evaluation) -> str:
    methods = [one.method for one in found.methods]
    rows: list[list[object]] = [["id", *(f"{name}_rmse_m" for name in methods), "observations"]]
    for name, point in _points(found).items():
        errors = (one.errors.point_rmse_m.get(name) for one in found.methods)
        rows.append([name, *map(_metres, errors), point["observations"]])
    return csv_text(rows)


def _observations_csv(found: Evaluation) -> str:
    rows: list[list[object]] = [list(_OBSERVATION_COLUMNS)]
    for one in found.methods:
        points: list[LocatedPoint | RefusedPoint] = [*one.located, *one.refused]
        for point in points:
            if isinstance(point, RefusedPoint):
                measured = [*[""] * 11, point.reason]
            else:
                measured = [*_measured(point), ""]
            pixel = [f"{pixels:.3f}" for pixels in point.uv]
            rows.append([point.id, point.stamp_ns, *pixel, one.method, *measured])
    return csv_text(rows)


def _measured(point: LocatedPoint) -> list[str]:
    """Return the columns from ``east_m`` to ``ellipse_azimuth_deg``."""
    sigmas = np.sqrt(np.maximum(point.covariance_en.diagonal(), 0.0)).tolist()
    metres = [
        *(point.east_m, point.north_m, point.height_m),
        *(*point.error_en.tolist(), point.distance_m),
        *(*sigmas, point.ellipse.major_m, point.ellipse.minor_m),
    ]
    return [*map(_metres, metres), f"{math.degrees(point.ellipse.azimuth_rad):.2f}"]


def _metres(value: float | None) -> str:
    """Format to a tenth of a millimetre; empty for None."""
    return "" if value is None else f"{value:.4f}"
