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
"""tirgeo calibrate boresight over simulated flights: planted errors are found, or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from project import PROJECT

from tirgeo_ros.core.adjustment.tied_views import PARAMETERS as TIED
from tirgeo_ros.core.calibration.boresight_model import PARAMETERS
from tirgeo_ros.core.config import GimbalConfig, OverlayConfig
from tirgeo_ros.core.types.errors import CalibrationError, ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.calibrate.aircraft import HOLDS
from tirgeo_ros.tools.calibrate.boresight import (
    IF_DETERMINED,
    USUAL,
    calibrate_boresight,
)
from tirgeo_ros.tools.cli.calibrate import aircraft, boresight
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.simulate.files import simulate

SCENARIO = PROJECT / "config" / "scenarios" / "paper_flight.yaml"
PLANTED = {"roll": 1.0, "pitch": -0.8, "yaw": 1.5, "latency": 70.0}
OVERLAY = "/**/overlay_node:\n  ros__parameters: "
GIMBAL = "/**/gimbal_node:\n  ros__parameters: "


class Flown:
    """A flight whose truth is known, and its calibration from parameters that are wrong."""

    def __init__(self, folder, source, now, truth):
        (folder / "now.yaml").write_text(now)
        self.folder, self.source, self.truth = folder, source, truth

    def calibrate(self, observations=None, *params, out="found.yaml", **options):
        files = [self.source / "params.yaml", self.folder / "now.yaml"]
        return calibrate_boresight(
            self.source / "flight.mcap",
            self.source / "survey.geojson",
            observations or self.source / "observations.csv",
            self.folder / out,
            params=[*files, *(self.folder / name for name in params)],
            **options,
        )

    def rows(self):
        head, *rows = (self.source / "observations.csv").read_text().splitlines()
        return head, rows

    def halves(self):
        """Two files of observations, each of every other point."""
        head, rows = self.rows()
        ids = sorted({row.partition(",")[0] for row in rows})
        for k in (0, 1):
            part = [row for row in rows if ids.index(row.partition(",")[0]) % 2 == k]
            path = self.folder / f"half{k}.csv"
            path.write_text("\n".join([head, *part]) + "\n")
            yield path

    def errors(self, result):
        """By parameter: found less true, and sigma."""
        return {
            name: (item["found"] - self.truth[name], item["sigma"])
            for name, item in result["parameters"].items()
        }


def planted(folder, seed, now, **changes):
    """A simulated flight with the errors that the requirement names."""
    tree = yaml.safe_load(SCENARIO.read_text())
    given = {"gimbal.boresight_rpy_deg": [1.0, -0.8, 1.5], "video.latency_s": 0.07}
    for name, value in {**given, **changes}.items():
        group, key = name.split(".")
        tree[group][key] = value
    (folder / "scenario.yaml").write_text(yaml.safe_dump(tree))
    simulate(folder / "scenario.yaml", folder, seed=seed, images=False)
    late = f"{OVERLAY}{{video_latency_s: 0.05}}\n"
    truth = PLANTED | {"gimbal_north": 0.0}
    return Flown(folder, folder, late + GIMBAL + now, truth)


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flown(tmp_path_factory, sample):
    """The sample flight, whose camera has no error, read with parameters that have one."""
    now = f"{OVERLAY}{{video_latency_s: 0.07}}\n{GIMBAL}{{boresight_rpy_deg: [1.0, -0.8, 1.5]}}\n"
    truth = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, "latency": 50.0}
    return Flown(tmp_path_factory.mktemp("sample"), sample, now, truth)


def test_the_error_of_the_parameters_is_found(flown):
    result = flown.calibrate(click_sigma_px=0.5)
    errors = flown.errors(result)
    assert set(errors) == {"roll", "pitch", "yaw", "latency"}
    assert all(abs(error) <= 4 * sigma for error, sigma in errors.values())
    assert errors["latency"][1] < 5  # ms
    assert all(sigma < 0.15 for name, (_, sigma) in errors.items() if name != "latency")
    assert result["ground_rmse_m"]["before"] > 1.0
    assert result["ground_rmse_m"]["leave_one_point_out"] < 0.25
    assert result["residual_rms_px"]["after"] < 0.2 * result["residual_rms_px"]["before"]
    assert any("gimbal_north (gimbal_node yaw_zero_deg) held" in note for note in result["notes"])


@pytest.fixture(scope="module")
def held(flown):
    """The sample flight's calibration but for the gimbal's north, in ``held.yaml``."""
    return flown.calibrate(out="held.yaml", hold=["gimbal_north"])


def test_poses_with_the_estimates_have_no_more_error(flown, held):
    again = flown.calibrate(None, "held.yaml", out="again.yaml", hold=["gimbal_north"])
    # the model of the fit against the flight read anew with its result: float32 messages apart,
    # they differ by the picture of a moment's interpolation
    assert again["ground_rmse_m"]["before"] == pytest.approx(
        held["ground_rmse_m"]["after"], abs=2e-3
    )
    for item in again["parameters"].values():
        assert abs(item["found"] - item["before"]) < 0.02 * item["sigma"]


def test_nodes_accept_the_file_and_its_head_has_the_sigmas(flown, held):
    path = flown.folder / "held.yaml"
    outcome = held["parameters"]
    gimbal = ParameterFile(path).config("gimbal_node", GimbalConfig)
    rpy = [outcome[name]["found"] for name in ("roll", "pitch", "yaw")]
    np.testing.assert_allclose(gimbal.boresight_rpy_deg, rpy, rtol=1e-8)
    overlay = ParameterFile(path).config("overlay_node", OverlayConfig)
    assert overlay.video_latency_s == pytest.approx(outcome["latency"]["found"] / 1e3, rel=1e-8)
    assert set(yaml.safe_load(path.read_text())) == {"/**/gimbal_node", "/**/overlay_node"}
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    assert any("13 points" in line for line in head)
    yaw = next(line for line in head if line.startswith("# yaw "))
    assert float(yaw.split()[2]) == 1.5
    assert yaw.endswith(" deg   gimbal_node boresight_rpy_deg")
    assert any("by the others alone (rmse)" in line for line in head)


def test_wrong_and_unknown_observations_are_named(flown):
    head, rows = flown.rows()
    name, stamp, u, v = rows[10].split(",")
    rows[10] = f"{name},{stamp},{float(u) + 60:.1f},{v}"
    rows += [f"X9,{stamp},300,300", f"{name},{int(stamp) + 10**12},300,300"]
    path = flown.folder / "wrong.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    result = flown.calibrate(path, hold=["gimbal_north"])
    (wrong,) = result["outliers"]
    assert (wrong["id"], wrong["stamp_ns"]) == (name, int(stamp))
    assert wrong["off_px"] == pytest.approx(60, abs=10)
    # one of the sample's own pictures comes before the filter's first pose
    assert (result["unknown_ids"], result["without_pose"]) == (1, 2)
    text = "\n".join(result["notes"])
    assert f"left out {name} at {stamp}" in text
    assert "1 observations of points that the survey does not have" in text
    assert all(
        abs(e) <= (10 if n == "latency" else 0.1) for n, (e, _) in flown.errors(result).items()
    )


def test_inseparable_parameters_are_refused_and_nothing_is_written(flown):
    wanted = ["roll", "pitch", "yaw", "latency", "gimbal_north"]
    with pytest.raises(CalibrationError, match=r"flight.mcap: .*yaw and gimbal_north cannot be"):
        flown.calibrate(estimate=wanted, out="refused.yaml")
    assert not (flown.folder / "refused.yaml").exists()


def test_the_verbs_have_the_same_names():
    """The verbs repeat them, so that they start without the heavy modules."""
    assert boresight._POINTS == PARAMETERS
    assert boresight._POINTS[:5] == (*USUAL, IF_DETERMINED)
    assert {*boresight._NAMES} == {*TIED}
    assert tuple(HOLDS) == aircraft._NAMES


def test_the_verb_prints_a_table_or_json(flown, capsys):
    folder, source = flown.folder, flown.source
    args = ["calibrate", "boresight", source / "flight.mcap"]
    args += ["--survey", source / "survey.geojson"]
    args += ["--observations", source / "observations.csv", "-o", folder / "v.yaml"]
    args += ["--params", source / "params.yaml", "--params", folder / "now.yaml"]
    args += ["--hold", "gimbal_north"]
    assert main([*map(str, args)]) == 0
    out = capsys.readouterr().out
    assert "parameter" in out
    assert "each point by the others alone" in out
    assert main([*map(str, args), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["parameters"]["yaw"]["unit"] == "deg"
    assert np.array(result["correlation"]).shape == (4, 4)


def test_a_ground_of_an_elevation_model_has_no_height_to_find(tmp_path, sample):
    params = tmp_path / "dem.yaml"
    params.write_text(f"{OVERLAY}{{dem: hills.tif}}\n")
    inputs = (sample / "flight.mcap", sample / "survey.geojson", sample / "observations.csv")
    with pytest.raises(CalibrationError, match="ground_height: overlay_node takes the ground"):
        calibrate_boresight(
            *inputs, tmp_path / "y.yaml", params=params, estimate=["yaw", "ground_height"]
        )
    params.write_text(f"{OVERLAY}{{video_latency: 0.1}}\n")
    with pytest.raises(ConfigError, match="unknown parameter video_latency"):
        calibrate_boresight(*inputs, tmp_path / "y.yaml", params=params)


def test_half_of_the_points_calibrates_the_other_half_by_encoders(tmp_path):
    """Within 0.1 deg, 10 ms and 0.25 m on the ground."""
    flown = planted(tmp_path, 1, "{composition: encoders}\n")
    used, unused = flown.halves()
    result = flown.calibrate(used, click_sigma_px=0.5)
    for name, (error, sigma) in flown.errors(result).items():
        assert abs(error) <= (10.0 if name == "latency" else 0.1)
        assert abs(error) <= 4 * sigma
    assert result["ground_rmse_m"]["before"] > 1.0
    there = flown.calibrate(unused, "found.yaml", out="again.yaml")
    assert there["ground_rmse_m"]["before"] <= 0.25
    # leave-one-out foretold it: rms of 30 and of 30 observations differ by some tenths
    foretold = result["ground_rmse_m"]["leave_one_point_out"]
    assert 0.5 < there["ground_rmse_m"]["before"] / foretold < 2.0


@pytest.mark.long
def test_by_the_reported_attitude(tmp_path):
    """What the gimbal does not report limits it: 0.48 deg of pitch that lasts 2.5 s.

    Over 87 s of clicks its mean is 0.48 sqrt(2 2.5 / 87) = 0.115 deg, whatever the clicks' number:
    the sigmas must say so.
    """
    flown = planted(tmp_path, 1, "{composition: paper}\n")
    result = flown.calibrate(click_sigma_px=0.5)
    for name, (error, sigma) in flown.errors(result).items():
        assert abs(error) <= 3.5 * sigma
        assert name == "latency" or sigma < 0.3
    assert result["parameters"]["pitch"]["sigma"] > 0.1
    assert result["ground_rmse_m"]["after"] < 0.5 * result["ground_rmse_m"]["before"]


@pytest.mark.long
def test_a_ground_height_is_found_if_asked_for(tmp_path):
    flown = planted(tmp_path, 5, "{composition: encoders}\n")
    survey = json.loads((tmp_path / "survey.geojson").read_text())
    for feature in survey["features"]:
        feature["geometry"]["coordinates"][2] += 1.5  # a survey in another datum
    (tmp_path / "survey.geojson").write_text(json.dumps(survey))
    names = ["roll", "pitch", "yaw", "latency", "ground_height"]
    result = flown.calibrate(estimate=names, click_sigma_px=0.5)
    item = result["parameters"]["ground_height"]
    assert item["before"] == pytest.approx(13.0, abs=0.03)  # 11.5 m and 1.5, surveyed to 2 cm
    assert abs(item["found"] - 11.5) <= 4 * item["sigma"]
    assert item["sigma"] < 0.2


def test_a_wrong_held_parameter_shows_in_the_residuals(flown):
    with pytest.raises(
        CalibrationError, match=r"yaw, latency: .* residuals are \d+.\d times .* the held param"
    ):
        flown.calibrate(estimate=["yaw", "latency"], out="refused.yaml")
