"""Compute a budget from options or a flight, and write its table and the maps of Fig. 4-5."""

from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.budget.budget import STEP_PX, Budget, Setting, Sigmas, budget, budget_csv
from tirgeo_ros.tools.budget.sensor_errors import MeasuredFlight, measured_flight
from tirgeo_ros.tools.presentation.plots import figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

#: Values by the names of the fields of Setting and Sigmas.
Given = dict[str, float]

_TITLES = {
    "height": "Error on the ground by the camera's height error of {:.4g} m",
    "heading": "Error on the ground by the camera's heading error of {:.4g} deg",
    "all": "Error on the ground by all of the pose, time, lens and ground",
}
_ERRORS = {one.name for one in dataclasses.fields(Sigmas)}
_CONTOURS, _LEAST_SPAN_M = 7, 1e-6


_NAMES = ("budget.csv", *(f"{name}.png" for name in _TITLES))


def make_budget(
    given: Given,
    *,
    bag: PathLike | None = None,
    output: PathLike | None = None,
    params: Files = None,
    camera: PathLike | None = None,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Compute the budget; with a bag, from the flight's own errors, view and camera.

    ``given`` and ``camera``, a calibration file, override the bag's values. Write budget.csv and
    the maps to the folder ``output`` if it is given. Raise BagError, CameraError, ConfigError,
    CalibrationError.
    """
    configs = node_configs(params, namespace, camera=camera)
    if output is not None:
        outputs = [Path(output) / name for name in _NAMES]
        check_outputs((bag, *paths_of(params), *configs.files), outputs, CalibrationError)
    ekf, gimbal, overlay, _ = configs
    setting = Setting(confidence=overlay.confidence)
    known, flight = given_camera(overlay), None
    if bag is not None:
        flight = measured_flight(bag, ekf, gimbal, namespace, progress, camera=known)
        setting = _of_flight(setting, flight, overlay.ground_height_m, given, bag)
    if known is not None:
        setting = dataclasses.replace(setting, camera=known)
    setting = _with(setting, given)
    made = budget(setting)
    result: dict[str, object] = {
        "height_m": setting.height_m,
        "depression_deg": setting.depression_deg,
        "ground_share": made.ground_share,
        "errors": dataclasses.asdict(setting.sigmas),
        "rows": made.rows(),
    }
    if flight is not None:
        filtered = dataclasses.replace(setting, pose_covariance_a=flight.track.covariance_a)
        rows = [row for row in budget(filtered).rows() if row["form"] == "general"]
        result |= {"flight": _table_1(flight), "rows_of_the_filter": rows}
    if output is not None:
        result["output"] = _written(Path(output), made)
    return result


def _of_flight(
    setting: Setting, flight: MeasuredFlight, ground_m: float, given: Given, bag: PathLike
) -> Setting:
    """Return the setting with the flight's camera, view and errors, as far as it gives them.

    Raise CalibrationError if the height of the ground is not known.
    """
    if math.isnan(ground_m) and "height_m" not in given:
        raise CalibrationError(
            f"{os.fspath(bag)}: height of the ground not known: give --height, or "
            "ground_height_m in --params"
        )
    measured = {name: value for name, value in _table_1(flight).items() if name in _ERRORS}
    view = {
        "depression_deg": math.degrees(flight.track.depression_rad),
        "speed_m_s": flight.track.speed_m_s,
    }
    if "height_m" not in given:
        view["height_m"] = flight.track.height_m - ground_m
    known = {name: value for name, value in measured.items() if math.isfinite(value)}
    return _with(dataclasses.replace(setting, camera=flight.camera), known | view)


def _table_1(flight: MeasuredFlight) -> Given:
    """Return Table 1 of a flight, with the numbers of samples."""
    errors = flight.errors
    return {
        "east_error_m": errors.east_m,
        "north_error_m": errors.north_m,
        "height_error_m": errors.height_m,
        "heading_error_deg": math.degrees(errors.heading_rad),
        "positions": errors.positions,
        "headings": errors.headings,
    }


def _with(setting: Setting, values: Given) -> Setting:
    sigmas = {name: value for name, value in values.items() if name in _ERRORS}
    rest = {name: value for name, value in values.items() if name not in _ERRORS}
    changed = dataclasses.replace(setting.sigmas, **sigmas)
    return dataclasses.replace(setting, sigmas=changed, **rest)  # type: ignore[arg-type]


def _written(folder: Path, made: Budget) -> list[str]:
    """Write the table and the maps; return their paths."""
    sigmas = made.setting.sigmas
    maps = {
        "height": (made.closed["height"], sigmas.height_error_m),
        "heading": (made.closed["heading"], sigmas.heading_error_deg),
        "all": (made.general["all"], math.nan),
    }
    files: dict[PathLike, str | bytes] = {folder / "budget.csv": budget_csv(made)}
    for name, (picture, error) in maps.items():
        files[folder / f"{name}.png"] = error_map(picture, _TITLES[name].format(error))
    made_folder(folder, CalibrationError)
    write_files(files, CalibrationError)
    return [os.fspath(path) for path in files]


def error_map(picture: Array, title: str) -> bytes:
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
