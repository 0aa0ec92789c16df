"""Compute the error budget over a camera's picture, its table and maps: ``tirgeo budget``.

It gives the paper's closed form (Ren et al. 2022, section 3.5, Tables 1 and 2), and a general form
from the derivative of the ground point with respect to the whole pose, with any lens and
covariance.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import (
    GroundView,
    looking,
    paper_heading_error_m,
    paper_height_error_m,
    paper_position_error_m,
    pixel_grid,
    rms_m,
)
from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
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
from tirgeo_ros.tools.budget.sensor_errors import MeasuredFlight, measured_flight
from tirgeo_ros.tools.presentation.plots import figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

STEP_PX = 4
#: Input errors of a budget.
ERRORS = (
    *("east_error_m", "north_error_m", "height_error_m"),
    *("heading_error_deg", "roll_error_deg", "pitch_error_deg"),
)
#: Factor -> indices of the pose covariance: ahead, right, down and the rotations about them.
_PARTS = {
    "position": [0, 1],
    "height": [2],
    "position 3d": [0, 1, 2],
    "heading": [5],
    "tilt": [3, 4],
    "pose": [0, 1, 2, 3, 4, 5],
}


@dataclass(frozen=True)
class Setting:
    """Hold the input of a budget. Raise CalibrationError for a view that sees no ground.

    The errors are Table 1 of the paper, and Table 8 for the gimbal.
    """

    camera: Camera = XT2
    height_m: float = 20.0  # of the camera above the ground
    depression_deg: float = 30.0  # angle of the optical axis below the horizon
    speed_m_s: float = 3.0  # ahead
    east_error_m: float = 1.2846
    north_error_m: float = 0.9342
    height_error_m: float = 2.8017
    heading_error_deg: float = 1.7972
    roll_error_deg: float = 0.2704  # about the optical axis
    pitch_error_deg: float = 0.4839
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    #: (6, 6) covariance of a filter's poses, along ahead, right, down; None: use the errors.
    pose_covariance_a: Array | None = None

    def __post_init__(self) -> None:
        """Check that the camera sees ground, and that the errors are valid."""
        if not 0 < self.height_m < math.inf:
            raise CalibrationError(
                f"the camera is {self.height_m:g} m above the ground: give a height above 0"
            )
        for name, value in self.errors.items():
            if not 0 <= value < math.inf:
                raise CalibrationError(f"{name} is {value:g}: must be 0 or more")
        if not 0 < self.depression_deg <= 90:
            raise CalibrationError(
                f"the camera looks down by {self.depression_deg:g} deg: give above 0 to 90"
            )

    @property
    def errors(self) -> dict[str, float]:
        """Return the input errors by name."""
        return {name: getattr(self, name) for name in ERRORS}

    @property
    def covariances_a(self) -> dict[str, Array]:
        """Return the covariances (6, 6) by factor, along ahead, right, down: m2, phi rad2."""
        if self.pose_covariance_a is not None:
            inside = {name: np.isin(range(6), which) for name, which in _PARTS.items()}
            return {n: self.pose_covariance_a * np.outer(k, k) for n, k in inside.items()}
        # North is taken as ahead: the sum of both errors does not depend on it.
        sigmas = {
            "position": [self.north_error_m, self.east_error_m, 0, 0, 0, 0],
            "height": [0, 0, self.height_error_m, 0, 0, 0],
            "heading": [0, 0, 0, 0, 0, math.radians(self.heading_error_deg)],
            "tilt": [0, 0, 0, 0, math.radians(self.pitch_error_deg), 0],
        }
        parts = {name: np.diag(np.square(row)) for name, row in sigmas.items()}
        depression = math.radians(self.depression_deg)
        axis_a = np.array([math.cos(depression), 0.0, math.sin(depression)])
        parts["tilt"][3:, 3:] += math.radians(self.roll_error_deg) ** 2 * np.outer(axis_a, axis_a)
        parts["position 3d"] = parts["position"] + parts["height"]
        return parts | {"pose": parts["position 3d"] + parts["heading"] + parts["tilt"]}


@dataclass(frozen=True)
class Budget:
    """Hold root mean square errors on the ground by factor, over the picture.

    ``closed`` and ``general`` are pictures (rows, columns) in m, one pixel for ``STEP_PX`` pixels
    of the camera, nan above the horizon. ``closed`` is the paper's form, with a pinhole camera.
    """

    setting: Setting
    closed: Mapping[str, Array]
    general: Mapping[str, Array]

    @property
    def ground_share(self) -> float:
        """Return the share of the picture below the horizon; ``rows`` covers only that part."""
        return float(np.isfinite(self.general["pose"]).mean())

    def rows(self) -> list[dict[str, object]]:
        """Return one row per factor and form: middle, mean, median, 95 % and largest error, m.

        The middle is None if it is above the horizon.
        """
        forms = {"closed": self.closed, "general": self.general}
        return [
            {"factor": factor, "form": form} | _statistics(pictures[factor])
            for factor in dict.fromkeys([*self.closed, *self.general])
            for form, pictures in forms.items()
            if factor in pictures
        ]


def _statistics(picture: Array) -> dict[str, object]:
    ground = picture[np.isfinite(picture)]
    if not len(ground):
        raise CalibrationError("the camera sees no ground: look further down")
    rows, columns = picture.shape
    at_middle = float(picture[rows // 2, columns // 2])
    return {
        "middle_m": at_middle if math.isfinite(at_middle) else None,
        "mean_m": float(ground.mean()),
        "median_m": float(np.median(ground)),
        "percentile_95_m": float(np.percentile(ground, 95)),
        "largest_m": float(ground.max()),
    }


def budget(setting: Setting) -> Budget:
    """Compute Equations 15 to 21 over the picture, and the general form."""
    uv, shape = pixel_grid(setting.camera, STEP_PX)
    rotation_nc = looking(math.radians(setting.depression_deg))  # to the north
    view = GroundView.of(setting.camera, rotation_nc, setting.height_m, uv)
    on_ground = np.isfinite(view.points_n[:, 0])
    closed = {
        name: np.where(on_ground, picture, np.nan).reshape(shape)
        for name, picture in _closed(setting, uv).items()
    }
    general = {name: rms_m(c).reshape(shape) for name, c in _general(setting, view).items()}
    return Budget(setting, closed, general)


def _closed(setting: Setting, uv: Array) -> dict[str, Array]:
    camera = setting.camera
    f, alpha = (camera.fx + camera.fy) / 2, math.radians(setting.depression_deg)
    x_im, y_im = uv[:, 0] - camera.cx, uv[:, 1] - camera.cy
    level_m = paper_position_error_m(setting.east_error_m, setting.north_error_m)
    position = np.full(len(uv), level_m)
    height = paper_height_error_m(x_im, y_im, f, alpha, setting.height_error_m)
    heading_rad = math.radians(setting.heading_error_deg)
    heading = paper_heading_error_m(x_im, y_im, f, alpha, setting.height_m, heading_rad)
    whole = np.hypot(position, height)
    return {
        "position": position,
        "height": height,
        "position 3d": whole,
        "heading": heading,
        "all of these": np.hypot(whole, heading),
    }


def _general(setting: Setting, view: GroundView) -> dict[str, Array]:
    """Return covariances (N, 2, 2), m2, by factor."""
    parts = {name: view.covariance(c) for name, c in setting.covariances_a.items()}
    confidence, none = setting.confidence, np.zeros((6, 6))
    rates = np.array([setting.speed_m_s, 0, 0, 0, 0, 0])
    time_s = confidence.latency_sigma_s
    others = {
        "latency": view.covariance(none, latency_sigma_s=time_s, rates=rates),
        "lens": view.covariance(none, lens_sigma_px=confidence.lens_sigma_px),
        "ground": view.covariance(none, ground_sigma_m=confidence.ground_sigma_m),
    }
    return parts | others | {"all": parts["pose"] + sum(others.values())}


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
    camera_given, flight = given_camera(overlay), None
    if bag is not None:
        flight = measured_flight(bag, ekf, gimbal, namespace, progress, camera=camera_given)
        if math.isnan(overlay.ground_height_m) and "height_m" not in given:
            why = "height of the ground not known: give --height, or ground_height_m in --params"
            raise CalibrationError(f"{os.fspath(bag)}: {why}")
        values |= _of_flight(flight, overlay.ground_height_m)
    if camera_given is not None:
        values["camera"] = camera_given
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
    finite = {name: value for name, value in errors.items() if math.isfinite(value)}
    return {"camera": flight.camera} | view | finite


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
