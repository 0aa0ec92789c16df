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
"""Read and write cameras' calibration files: the YAML of ROS's camera_calibration.

``camera_info_manager`` reads it, and so do most camera drivers.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CameraError, ConfigError
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.messages.pictures import camera as camera_of
from tirgeo_ros.io.messages.result_messages import calibration_of
from tirgeo_ros.io.parameters.parameter_file import load_yaml


def camera_yaml(camera: Camera, name: str = "thermal") -> str:
    """Return the text of a calibration file.

    plumb_bob has five coefficients, the rational model eight. The rectified image has the camera's
    own matrix: P is K with a column of zeros.
    """
    k, distortion, model = calibration_of(camera)
    tree = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "camera_matrix": _matrix(k),
        "distortion_model": model,
        "distortion_coefficients": _matrix(np.array([distortion])),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.pad(k, ((0, 0), (0, 1)))),
    }
    text: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=999)
    return text


def _matrix(values: Array) -> dict[str, object]:
    numbers = [float(f"{number:.10g}") for number in values.ravel().tolist()]
    return {"rows": values.shape[0], "cols": values.shape[1], "data": numbers}


def load_camera(path: PathLike) -> Camera:
    """Read a camera from a calibration file. Raises CameraError naming file and key."""
    try:
        tree = load_yaml(str(path))
    except ConfigError as error:
        raise CameraError(str(error)) from None
    if not isinstance(tree, Mapping):
        raise CameraError(
            f"{path}: not a calibration file: it needs image_width, camera_matrix, ..."
        )
    message = SimpleNamespace(
        width=_number(path, tree, "image_width"),
        height=_number(path, tree, "image_height"),
        k=_data(path, tree, "camera_matrix", 9),
        d=_data(path, tree, "distortion_coefficients"),
        distortion_model=tree.get("distortion_model", ""),
    )
    return camera_of(message, str(path))


def configured_camera(config: OverlayConfig) -> Camera | None:
    """Read the file of the parameter ``camera``; None if it is empty. Raises CameraError."""
    return load_camera(config.camera) if config.camera else None


def _number(path: PathLike, tree: Mapping[Any, Any], key: str) -> int:
    value = tree.get(key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise CameraError(f"{path}: {key} must be a whole number, is {value!r}")
    return value


def _data(path: PathLike, tree: Mapping[Any, Any], key: str, count: int | None = None) -> Any:
    matrix = tree.get(key)
    data = matrix.get("data") if isinstance(matrix, Mapping) else None
    if not isinstance(data, list) or {*map(type, data)} - {int, float}:
        raise CameraError(f"{path}: {key} needs data: a list of numbers")
    if count is not None and len(data) != count:
        raise CameraError(f"{path}: {key} needs {count} numbers in data, has {len(data)}")
    return data
