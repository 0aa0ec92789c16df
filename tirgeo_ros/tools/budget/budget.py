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
"""Compute the error budget of a camera's picture, as a table and maps: ``tirgeo budget``.

There is the paper's closed form (Ren et al. 2022, section 3.5, Tables 1 and 2), and a general form
from the derivative of the ground point with respect to the whole pose, with any lens and
covariance.
"""

from __future__ import annotations

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
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import (
    PathLike,
    check_outputs,
    csv_text,
    made_folder,
    write_files,
)
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.tools.presentation.plots import figure, png
from tirgeo_ros.tools.replay.node_configs import node_configs

STEP_PX = 4
#: Titles of the maps by factor, and the names of the files.
_TITLES = {
    "height": "Error on the ground by the camera's height error of {height_error_m:.4g} m",
    "heading": "Error on the ground by the camera's heading error of {heading_error_deg:.4g} deg",
    "all": "Error on the ground by all of the pose, time, lens and ground",
}
_NAMES = ("budget.csv", *(f"{name}.png" for name in _TITLES))
_CONTOURS, _LEAST_SPAN_M = 7, 1e-6


@dataclass(frozen=True)
class Setting:
    """Hold the input of a budget. Raise CalibrationError for a view that sees no ground.

    The default errors are those of the paper: Table 1, and Table 8 for the gimbal.
    """

    camera: Camera = XT2
    height_m: float = 20.0  # of the camera above the ground
    depression_deg: float = 30.0  # angle of the optical axis below the horizon
    speed_m_s: float = 3.0  # forward
    east_error_m: float = 1.2846
    north_error_m: float = 0.9342
    height_error_m: float = 2.8017
    heading_error_deg: float = 1.7972
    roll_error_deg: float = 0.2704  # about the optical axis
    pitch_error_deg: float = 0.4839
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)

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
                f"the camera looks down by {self.depression_deg:g} deg: must be above 0, up to 90"
            )

    @property
    def errors(self) -> dict[str, float]:
        """Return the input errors by name."""
        return {name: value for name, value in vars(self).items() if "_error_" in name}

    @property
    def covariances_a(self) -> dict[str, Array]:
        """Return the covariances (6, 6) by factor, along forward, right, down: m2, phi rad2."""
        # North is taken as forward: the sum of both errors does not depend on the direction.
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

    ``closed`` and ``general`` are pictures (rows, columns) in m, one pixel per ``STEP_PX`` pixels
    of the camera, nan above the horizon. ``closed`` is the paper's form, for a pinhole camera.
    """

    setting: Setting
    closed: Mapping[str, Array]
    general: Mapping[str, Array]

    def rows(self) -> list[dict[str, object]]:
        """Return one row per factor and form: middle, mean, median, 95 % and largest error, m.

        The middle is None if above the horizon. Raise CalibrationError if no pixel sees ground.
        """
        forms = {"closed": self.closed, "general": self.general}
        rows: list[dict[str, object]] = []
        for factor in dict.fromkeys([*self.closed, *self.general]):
            for form, pictures in forms.items():
                if factor not in pictures:
                    continue
                picture = pictures[factor]
                ground = picture[np.isfinite(picture)]
                if not len(ground):
                    raise CalibrationError("the camera sees no ground: increase the tilt")
                middle = float(picture[picture.shape[0] // 2, picture.shape[1] // 2])
                figures = {
                    "middle_m": middle if math.isfinite(middle) else None,
                    "mean_m": float(ground.mean()),
                    "median_m": float(np.median(ground)),
                    "percentile_95_m": float(np.percentile(ground, 95)),
                    "largest_m": float(ground.max()),
                }
                rows.append({"factor": factor, "form": form, **figures})
        return rows


def budget(setting: Setting) -> Budget:
    """Compute Equations 15 to 21 over the picture, and the general form."""
    uv, shape = pixel_grid(setting.camera, STEP_PX)
    rotation_nc = looking(math.radians(setting.depression_deg))  # to the north
    view = GroundView.of(setting.camera, rotation_nc, setting.height_m, uv)
    on_ground = np.isfinite(view.points_n[:, 0])
    closed = {
        name: np.where(on_ground, errors_m, np.nan).reshape(shape)
        for name, errors_m in _closed(setting, uv).items()
    }
    parts = {name: view.covariance(c) for name, c in setting.covariances_a.items()}
    confidence, none = setting.confidence, np.zeros((6, 6))
    rates = np.array([setting.speed_m_s, 0, 0, 0, 0, 0])
    time_s = confidence.latency_sigma_s
    others = {
        "latency": view.covariance(none, latency_sigma_s=time_s, rates=rates),
        "lens": view.covariance(
            none, lens_sigma_px=confidence.lens_sigma_px, focal_sigma=confidence.focal_sigma
        ),
        "ground": view.covariance(none, ground_sigma_m=confidence.ground_sigma_m),
    }
    parts |= others | {"all": parts["pose"] + sum(others.values())}
    return Budget(setting, closed, {name: rms_m(c).reshape(shape) for name, c in parts.items()})


def _closed(setting: Setting, uv: Array) -> dict[str, Array]:
    """Return the paper's errors (N,), m, by factor at pixels (N, 2)."""
    camera = setting.camera
    f, alpha = (camera.fx + camera.fy) / 2, math.radians(setting.depression_deg)
    x_im, y_im = uv[:, 0] - camera.cx, uv[:, 1] - camera.cy
    level_m = paper_position_error_m(setting.east_error_m, setting.north_error_m)
    position = np.full(len(uv), level_m)
    height = paper_height_error_m(x_im, y_im, f, alpha, setting.height_error_m)
    heading_rad = math.radians(setting.heading_error_deg)
    heading = paper_heading_error_m(x_im, y_im, f, alpha, setting.height_m, heading_rad)
    position_3d = np.hypot(position, height)
    return {
        "position": position,
        "height": height,
        "position 3d": position_3d,
        "heading": heading,
        "all of these": np.hypot(position_3d, heading),
    }


def make_budget(
    values: dict[str, float],
    *,
    output: PathLike | None = None,
    params: Files = None,
    camera: PathLike | None = None,
    namespace: str = "",
) -> dict[str, object]:
    """Compute the budget from ``values``, by the names of Setting's fields.

    ``camera``, a calibration file, overrides that of the parameters. Write budget.csv and the maps
    to the folder ``output`` if it is given. Raise CameraError, ConfigError, CalibrationError.
    """
    configs = node_configs(params, namespace, camera=camera)
    if output is not None:
        outputs = [Path(output) / name for name in _NAMES]
        check_outputs((*paths_of(params), *configs.files), outputs, CalibrationError)
        needed("matplotlib", f"drawing maps into {output}", CalibrationError)
    lens = configured_camera(configs.overlay)
    inputs: dict[str, Any] = {"confidence": configs.overlay.confidence, **values}
    errors = budget(Setting(**inputs) if lens is None else Setting(camera=lens, **inputs))
    result: dict[str, object] = {
        "height_m": errors.setting.height_m,
        "depression_deg": errors.setting.depression_deg,
        "ground_share": float(np.isfinite(errors.general["pose"]).mean()),
        "errors": errors.setting.errors,
        "rows": errors.rows(),
    }
    if output is not None:
        result["output"] = _written(Path(output), errors)
    return result


def _written(folder: Path, errors: Budget) -> list[str]:
    """Write the table and the maps; return their paths."""
    rows = errors.rows()
    cells = [[f"{v:.4f}" if isinstance(v, float) else v for v in row.values()] for row in rows]
    files: dict[PathLike, str | bytes] = {folder / _NAMES[0]: csv_text([list(rows[0]), *cells])}
    for name, title in _TITLES.items():
        picture = errors.general[name] if name == "all" else errors.closed[name]
        files[folder / f"{name}.png"] = _error_map(picture, title.format(**errors.setting.errors))
    made_folder(folder, CalibrationError)
    write_files(files, CalibrationError)
    return [os.fspath(path) for path in files]


def _error_map(picture: Array, title: str) -> bytes:
    """Return a PNG of errors (rows, columns), m, over the camera's picture, as Figures 4 and 5."""
    plot, axes = figure(6.4, 4.6)
    rows, columns = picture.shape
    extent = (-0.5, columns * STEP_PX - 0.5, rows * STEP_PX - 0.5, -0.5)
    image = axes.imshow(np.ma.masked_invalid(picture), extent=extent, cmap="viridis")
    middle_u, middle_v = ((np.arange(n) + 0.5) * STEP_PX - 0.5 for n in (columns, rows))
    if np.nanmax(picture) - np.nanmin(picture) > _LEAST_SPAN_M:
        lines = axes.contour(middle_u, middle_v, picture, _CONTOURS, colors="white")
        axes.clabel(lines, fmt="%.3g m")
    axes.set(title=title, xlabel="column, px", ylabel="row, px")
    axes.grid(visible=False)
    plot.colorbar(image, ax=axes, label="error on the ground, m")
    return png(plot)
