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
"""tirgeo locate over the sample flight: as evaluate finds, as the survey says, or refused."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.errors import BagError, ConfigError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.surveys.survey import (
    Observation,
    load_observations,
    load_survey,
    save_observations,
)
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.evaluate.evaluate import evaluate
from tirgeo_ros.tools.replay.locate import locate_pixels


def locate(sample, out, pixels=None, **options):
    """Locate pixels of the sample flight, by default the observations."""
    pixels, options = pixels or sample / "observations.csv", {"params": "params.yaml"} | options
    params = options["params"]
    options["params"] = sample / params if isinstance(params, str) else params
    return locate_pixels(sample / "flight.mcap", pixels, out, **options)


@pytest.fixture(scope="module")
def located(sample, tmp_path_factory):
    path = tmp_path_factory.mktemp("located") / "points.geojson"
    locate(sample, path)
    return path


def points_of(path):
    features = json.loads(path.read_text())["features"]
    return [f for f in features if f["properties"]["kind"] == "point"]


def errors_of(path, sample):
    """(id, (north, east) in m, properties) of the located points against the survey."""
    truth = {point.id: point for point in load_survey(sample / "survey.geojson")}
    for feature in points_of(path):
        if feature["geometry"] is None:
            continue
        name = feature["properties"]["id"]
        longitude, latitude, _ = feature["geometry"]["coordinates"]
        point = truth[name]
        around = TangentPlane(point.latitude_rad, point.longitude_rad, point.height_m)
        error_n = around.ned_from_geodetic(*np.radians([latitude, longitude]), point.height_m)
        yield name, error_n[:2], feature["properties"]


@pytest.mark.slow
def test_the_errors_are_those_that_evaluate_finds(sample, tmp_path):
    # by itself the composition begins with the reported attitude, until it trusts the joints
    chosen = tmp_path / "chosen.yaml"
    chosen.write_text("/**/gimbal_node:\n  ros__parameters: {composition: encoders}\n")
    params = [sample / "params.yaml", chosen]
    summary = locate(sample, tmp_path / "points.geojson", params=params)
    evaluation = evaluate(
        sample / "flight.mcap",
        sample / "survey.geojson",
        sample / "observations.csv",
        params=params,
    )
    expected = evaluation.method("ekf_heading")
    result = list(errors_of(tmp_path / "points.geojson", sample))
    assert len(result) == len(expected.located) == summary["located"] == 24
    assert summary["refused"] == {expected.refused[0].reason: len(expected.refused)}
    turn = evaluation.experiment.projection.local_axes(*np.radians([39.85, 116.7]))
    for (name, error_n, _), other in zip(result, expected.located, strict=True):
        assert name == other.id
        # nine decimals of a degree are 0.1 mm
        np.testing.assert_allclose(turn @ error_n, other.error_en, atol=2e-4)
    rms_m = math.sqrt(np.mean([np.sum(error_n**2) for _, error_n, _ in result]))
    assert rms_m == pytest.approx(expected.errors.rmse_m, abs=2e-4)


def test_the_survey_lies_within_the_ellipses(sample, located):
    """The filter's covariance, carried to the ground: 24 points, few of them outside of 95 %."""
    inside = []
    for _, (north, east), said in errors_of(located, sample):
        azimuth = math.radians(said["ellipse_azimuth_deg"])
        along = (north * math.cos(azimuth) + east * math.sin(azimuth)) / said["ellipse_major_m"]
        across = (east * math.cos(azimuth) - north * math.sin(azimuth)) / said["ellipse_minor_m"]
        inside.append(math.hypot(along, across) <= 1)
    # of 24 draws at 95 %, fewer than 20 happen once in a hundred times
    assert sum(inside) >= 20


def test_the_command_and_its_json(sample, tmp_path, capsys):
    out = tmp_path / "p.xml"
    argv = ["locate", sample / "flight.mcap", "--pixels", sample / "observations.csv"]
    argv += ["-o", out, "--params", sample / "params.yaml", "--json"]
    assert main([str(word) for word in argv]) == 0
    said, complaint = capsys.readouterr()
    summary = json.loads(said)
    assert (summary["pixels"], summary["located"], summary["error"]) == (25, 24, None)
    assert summary["output"] == str(out)
    assert "1 of 25 pixels refused: 1 x no trusted pose" in complaint
    assert list(tmp_path.iterdir()) == [out]
    assert out.read_text().count("<event ") == 24


@pytest.mark.slow
def test_each_refusal_is_written_with_its_reason(sample, tmp_path):
    observed = load_observations(sample / "observations.csv")[-1]
    asked = [
        dataclasses.replace(observed, id="there"),
        dataclasses.replace(observed, id="beside", u=640.2),
        dataclasses.replace(observed, id="early", stamp_ns=observed.stamp_ns - 10**12),
        Observation("negative", -1, 3.0, 4.0),
    ]
    save_observations(tmp_path / "asked.csv", asked)
    summary = locate(sample, tmp_path / "out.geojson", tmp_path / "asked.csv")
    reasons = [f["properties"]["reason"] for f in points_of(tmp_path / "out.geojson")]
    nothing = "no trusted pose at that picture"
    assert reasons == [None, "the pixel is outside the picture", nothing, nothing]
    assert summary["error"] is None
    assert (summary["located"], summary["pixels"]) == (1, 4)


@pytest.mark.slow
def test_nothing_located_is_a_failure_with_an_output(sample, tmp_path, capsys):
    save_observations(tmp_path / "asked.csv", [Observation("x", 5, 3.0, 4.0)])
    words = ["locate", sample / "flight.mcap", "--pixels", tmp_path / "asked.csv"]
    words += ["-o", tmp_path / "o.geojson", "--ground-height", "11.5"]
    assert main([str(word) for word in words]) == 1
    said = capsys.readouterr().err
    assert "none of 1 pixels could be located: no trusted pose" in said
    first_ns, last_ns = BagReader(sample / "flight.mcap").span_ns
    assert f"stamps are 5 to 5 ns, and the bag was recorded from {first_ns} to {last_ns}" in said
    assert points_of(tmp_path / "o.geojson")[0]["geometry"] is None


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"params": None}, ConfigError, "give --ground-height or --dem"),
        ({"namespace": "uav7"}, BagError, "needed topic absent: /uav7/imu/data"),
    ],
)
def test_a_refused_call_leaves_no_output(sample, tmp_path, monkeypatch, options, error, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=said):
        locate(sample, "out.geojson", **options)
    assert list(tmp_path.iterdir()) == []
