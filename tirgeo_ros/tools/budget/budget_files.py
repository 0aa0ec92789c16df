"""Compute a budget from options or a flight, and write its table and the maps of Fig. 4-5."""

from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import (
    PathLike,
    check_outputs,
    csv_text,
    made_folder,
    write_files,
)
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.budget.budget import ERRORS, STEP_PX, Budget, Setting, budget
from tirgeo_ros.tools.budget.sensor_errors import MeasuredFlight, measured_flight
from tirgeo_ros.tools.presentation.plots import figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

_TITLES = {
    "height": "Error on the ground by the camera's height error of {height_error_m:.4g} m",
    "heading": "Error on the ground by the camera's heading error of {heading_error_deg:.4g} deg",
    "all": "Error on the ground by all of the pose, time, lens and ground",
}
_NAMES = ("budget.csv", *(f"{name}.png" for name in _TITLES))
_CONTOURS, _LEAST_SPAN_M = 7, 1e-6


def make_budget(
    given: dict[str, float],
    *,
    bag: PathLike | None = None,
    output: PathLike | None = None,
    params: Files = None,
    camera: PathLike | None = None,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Compute the budget; with a bag, from the flight's own errors, view and camera.

    ``given``, values by the names of the fields of Setting, and ``camera``, a calibration file,
    override the bag's values. Write budget.csv and the maps to the folder ``output`` if it is
    given. Raise BagError, CameraError, ConfigError, CalibrationError.
    """
    configs = node_configs(params, namespace, camera=camera)
    ekf, gimbal, overlay, _ = configs
    if output is not None:
        outputs = [Path(output) / name for name in _NAMES]
        check_outputs((bag, *paths_of(params), *configs.files), outputs, CalibrationError)
    values: dict[str, Any] = {"confidence": overlay.confidence}
    known, flight = given_camera(overlay), None
    if bag is not None:
        flight = measured_flight(bag, ekf, gimbal, namespace, progress, camera=known)
        if math.isnan(overlay.ground_height_m) and "height_m" not in given:
            why = "height of the ground not known: give --height, or ground_height_m in --params"
            raise CalibrationError(f"{os.fspath(bag)}: {why}")
        values |= _of_flight(flight, overlay.ground_height_m)
    if known is not None:
        values["camera"] = known
    made = budget(Setting(**values | given))
    result = _summary(made, flight)
    if output is not None:
        result["output"] = _written(Path(output), made)
    return result


def _summary(made: Budget, flight: MeasuredFlight | None) -> dict[str, object]:
    """Return the budget, and with a flight that by the filter's covariance."""
    setting = made.setting
    result: dict[str, object] = {
        "height_m": setting.height_m,
        "depression_deg": setting.depression_deg,
        "ground_share": made.ground_share,
        "errors": setting.errors,
        "rows": made.rows(),
    }
    if flight is not None:
        filtered = dataclasses.replace(setting, pose_covariance_a=flight.track.covariance_a)
        rows = [row for row in budget(filtered).rows() if row["form"] == "general"]
        result |= {"flight": flight.errors, "rows_of_the_filter": rows, "warning": flight.warning}
    return result


def _of_flight(flight: MeasuredFlight, ground_m: float) -> dict[str, Any]:
    """Return the flight's camera, view and errors, as far as it gives them."""
    errors = {name: flight.errors[name] for name in ERRORS if name in flight.errors}
    view = {"depression_deg": flight.track.depression_deg, "speed_m_s": flight.track.speed_m_s}
    if math.isfinite(ground_m):
        view["height_m"] = flight.track.height_m - ground_m
    known = {name: value for name, value in errors.items() if math.isfinite(value)}
    return {"camera": flight.camera} | view | known


def _written(folder: Path, made: Budget) -> list[str]:
    """Write the table and the maps; return their paths."""
    rows = made.rows()
    cells = [[f"{v:.4f}" if isinstance(v, float) else v for v in row.values()] for row in rows]
    files: dict[PathLike, str | bytes] = {folder / _NAMES[0]: csv_text([list(rows[0]), *cells])}
    for name, title in _TITLES.items():
        picture = made.general[name] if name == "all" else made.closed[name]
        files[folder / f"{name}.png"] = _error_map(picture, title.format(**made.setting.errors))
    made_folder(folder, CalibrationError)
    write_files(files, CalibrationError)
    return [os.fspath(path) for path in files]


def _error_map(picture: Array, title: str) -> bytes:
    """Return a PNG of errors (rows, columns), m, over the camera's picture, as Figures 4, 5."""
    made, axes = figure(6.4, 4.6)
    rows, columns = picture.shape
    extent = (-0.5, columns * STEP_PX - 0.5, rows * STEP_PX - 0.5, -0.5)
    shown = axes.imshow(np.ma.masked_invalid(picture), extent=extent, cmap="viridis")
    middle_u, middle_v = ((np.arange(n) + 0.5) * STEP_PX - 0.5 for n in (columns, rows))
    if np.nanmax(picture) - np.nanmin(picture) > _LEAST_SPAN_M:
        lines = axes.contour(middle_u, middle_v, picture, _CONTOURS, colors="white")
        axes.clabel(lines, fmt="%.3g m")
    axes.set(title=title, xlabel="column, px", ylabel="row, px")
    axes.grid(visible=False)
    made.colorbar(shown, ax=axes, label="error on the ground, m")
    return png(made)
