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
"""A calibration file replaces the bag's, in every command and in the parameters."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from process_bags import located_or_evaluated

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.parameters.parameter_file import parameters_yaml
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.graph_outputs import read_pictures
from tirgeo_ros.tools.replay.locate import locate_pixels
from tirgeo_ros.tools.replay.process import process

#: Twice as long a lens sees half as far to the side.
LONG = replace(XT2, fx=2 * XT2.fx, fy=2 * XT2.fy)
INFO = "/thermal/camera_info"


@pytest.fixture(scope="module")
def flight(sample, tmp_path_factory):
    """The sample's bag up to 9 s, without its calibration, with half a second of pictures."""
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    reader = BagReader(sample / "flight.mcap")
    start_ns = reader.span_ns[0]
    with BagWriter(path) as writer:
        for item in reader.messages():
            age_s = (item.log_time_ns - start_ns) * 1e-9
            wanted = age_s > 8.5 if "image" in item.topic else item.topic != INFO
            if wanted and age_s < 9:
                writer.write(item.topic, item.typename, item.data, item.log_time_ns)
    return path


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    path = tmp_path_factory.mktemp("lens") / "lens.yaml"
    path.write_text(camera_yaml(LONG), encoding="utf-8")
    return path


def test_process_draws_with_the_given_camera(flight, lens, sample, tmp_path):
    given = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    (tmp_path / "xt2.yaml").write_text(camera_yaml(XT2), encoding="utf-8")
    drawn = []
    for name in (lens, tmp_path / "xt2.yaml"):
        process(flight, tmp_path / "out.mcap", **given, camera=name)
        pictures = [image.astype(int) for _, image in read_pictures(tmp_path / "out.mcap")]
        yellow = [np.minimum(p[..., 1], p[..., 2]) - p[..., 0] > 100 for p in pictures]
        drawn.append(np.mean([each.sum() for each in yellow]))
    assert 0 < drawn[0] < 0.8 * drawn[1]  # a quarter of the ground, each line twice as long


def test_locate_takes_the_camera_from_the_parameters(flight, lens, sample, tmp_path):
    """The middle of the picture is where it was; beside it the ground is half as far away."""
    begun_ns = BagReader(flight).span_ns[0]
    rows = [f"{k},{begun_ns + 8_700_000_000},{u},{XT2.cy}" for k, u in enumerate((XT2.cx, 500))]
    (tmp_path / "pixels.csv").write_text("\n".join(["id,stamp_ns,u,v", *rows]))
    (tmp_path / "xt2.yaml").write_text(camera_yaml(XT2), encoding="utf-8")
    places = []
    for camera in (lens, tmp_path / "xt2.yaml"):
        (tmp_path / "more.yaml").write_text(
            parameters_yaml({"overlay_node": {"camera": str(camera)}}, "")
        )
        params = [sample / "params.yaml", tmp_path / "more.yaml"]
        out = tmp_path / "out.geojson"
        result = locate_pixels(flight, tmp_path / "pixels.csv", out, params=params)
        assert result["located"] == 2
        features = json.loads(out.read_text())["features"]
        points = [
            f["geometry"]["coordinates"] for f in features if f["geometry"]["type"] == "Point"
        ]
        places.append(np.array(points)[:, :2])
    (middle, side), (middle_xt2, side_xt2) = places
    np.testing.assert_allclose(middle, middle_xt2, atol=1e-9)
    share = np.linalg.norm(side - middle) / np.linalg.norm(side_xt2 - middle_xt2)
    assert share == pytest.approx(0.5, abs=0.02)  # the lens bends the far one a little more


@pytest.mark.parametrize("verb", ["locate", pytest.param("evaluate", marks=pytest.mark.slow)])
def test_a_calibration_of_another_size_is_refused(verb, sample, tmp_path, capsys):
    """It would locate each pixel wrongly, with a small ellipse."""
    half = replace(XT2, width=320, height=256)
    (tmp_path / "half.yaml").write_text(camera_yaml(half), encoding="utf-8")
    given = ["--camera", tmp_path / "half.yaml", "--params", sample / "params.yaml"]
    arguments = [*located_or_evaluated(verb, sample, tmp_path), *given]
    assert main([str(entry) for entry in arguments]) == 1
    assert capsys.readouterr().err.endswith(
        "the calibration is of 320x256 pixels and the pictures have 640x512: give the "
        "calibration of these pictures (--camera, or thermal/camera_info)\n"
    )
    assert not (tmp_path / "points.geojson").exists()
