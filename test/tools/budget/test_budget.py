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
"""The budget's numbers, its files and its command."""

from __future__ import annotations

import csv
import json
import math

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.budget.budget import Setting, budget, make_budget
from tirgeo_ros.tools.cli import main as command


def row(rows, factor, form="general"):
    return next(r for r in rows if (r["factor"], r["form"]) == (factor, form))


def test_the_forms_agree_for_a_pinhole_camera_and_factors_add_up_in_squares():
    errors = budget(Setting(Camera(640, 512, 800.0, 800.0, 319.5, 255.5)))
    for factor in ("position", "height", "position 3d", "heading"):
        np.testing.assert_allclose(errors.general[factor], errors.closed[factor], rtol=1e-9)
    squares = {name: picture**2 for name, picture in errors.general.items()}
    parts = sum(squares[name] for name in ("position", "height", "heading", "tilt"))
    np.testing.assert_allclose(squares["pose"], parts, rtol=1e-9)
    others = sum(squares[name] for name in ("latency", "lens", "ground"))
    np.testing.assert_allclose(squares["all"] - squares["pose"], others, rtol=1e-9)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"height_m": 0.0}, "the camera is 0 m above the ground"),
        ({"depression_deg": -5.0}, "the camera looks down by -5 deg: must be above 0, up to 90"),
        ({"roll_error_deg": -1.0}, "roll_error_deg is -1: must be 0 or more"),
        ({"east_error_m": math.nan}, "east_error_m is nan: must be 0 or more"),
    ],
)
def test_invalid_values_are_refused(values, reason):
    with pytest.raises(CalibrationError, match=reason):
        make_budget(values)
    camera = Camera(640, 200, 800.0, 800.0, 319.5, 900.0)  # sees only what is over its axis
    with pytest.raises(CalibrationError, match="sees no ground: increase the tilt"):
        budget(Setting(camera, depression_deg=1.0)).rows()


def test_files(tmp_path, capsys):
    out = tmp_path / "budget"
    assert command.main(["budget", "--height", "60", "--tilt", "45", "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "camera 60 m above the ground, 45 deg down" in shown
    with (out / "budget.csv").open() as file:
        height = row(list(csv.DictReader(file)), "height")
    assert f"{float(height['mean_m']):.3f}" in shown
    for name in ("height", "heading", "all"):
        assert cv2.imread(str(out / f"{name}.png")).shape[2] == 3


def test_a_middle_over_the_horizon_has_no_number(capsys, tmp_path):
    (tmp_path / "camera.yaml").write_text(
        camera_yaml(Camera(640, 512, 800.0, 800.0, 319.5, 300.0)), encoding="utf-8"
    )
    arguments = ["budget", "--tilt", "1", "--camera", str(tmp_path / "camera.yaml")]
    assert command.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    # 800 px * tan(1 deg) = 13.96 px above row 300 is the horizon: of rows 0, 4 ... 284 of 508.
    assert any(line.startswith("56% of the picture lies above the horizon") for line in lines)
    assert next(line for line in lines if line.startswith("all  ")).split()[2] == "-"
    table = [line for line in lines if " general " in line or " closed " in line]
    assert {len(line.split()) for line in table} == {7, 8, 9}  # no two numbers run together
    assert command.main([*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert row(result["rows"], "all")["middle_m"] is None
    assert result["ground_share"] == pytest.approx(56 / 128)
