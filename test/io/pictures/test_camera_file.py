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
"""Calibration files as ROS writes and reads them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.types.errors import CameraError
from tirgeo_ros.io.pictures.camera_file import camera_yaml, load_camera

TEXT = """\
image_width: 640
image_height: 512
camera_name: thermal
camera_matrix:
  rows: 3
  cols: 3
  data: [803.5593, 0, 349.3325, 0, 797.627, 251.8215, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.054, 0.3462, -0.0037, 0.0076, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [803.5593, 0, 349.3325, 0, 0, 797.627, 251.8215, 0, 0, 0, 1, 0]
"""
RATIONAL = replace(XT2, distortion=(0.1, 0.02, 0.001, 0.002, 0.01, 0.05, 0.03, 0.004))
K3 = replace(XT2, distortion=(-0.3, 0.2, 0.001, -0.002, -0.15))


def test_the_text_is_as_ros_writes_it():
    assert yaml.safe_load(camera_yaml(XT2)) == yaml.safe_load(TEXT)


@pytest.mark.parametrize("camera", [RATIONAL, K3, replace(XT2, fx=803.1234567891)])
def test_a_written_camera_is_read_back(tmp_path, camera):
    path = tmp_path / "camera.yaml"
    path.write_text(camera_yaml(camera), encoding="utf-8")
    result = load_camera(path)
    five = camera.distortion + (0.0,) * (len(camera.distortion) == 4)
    assert result.distortion == five
    assert result.fx == pytest.approx(camera.fx, rel=1e-9)
    assert (result.width, result.height, result.cy) == (640, 512, camera.cy)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("image_width: 640", "image_width: wide", "image_width must be a whole number, is 'wide'"),
        ("image_height: 512\n", "", "image_height must be a whole number, is None"),
        ("0, 0, 1]\ndist", "0, 0]\ndist", "camera_matrix needs 9 numbers in data, has 8"),
        ("[0.054,", "[far,", "distortion_coefficients needs data: a list of numbers"),
        ("plumb_bob", "equidistant", "distortion model 'equidistant' is not known"),
        ("803.5593, 0, 349", "0, 0, 349", "K is zero"),
        (TEXT, "[]", "not a calibration file"),
        (TEXT, "a: [", "not YAML"),
    ],
)
def test_wrong_files_are_refused_with_file_and_key(tmp_path, old, new, message):
    path = tmp_path / "camera.yaml"
    assert old in TEXT
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(CameraError, match=message) as refused:
        load_camera(path)
    assert str(path) in str(refused.value)
