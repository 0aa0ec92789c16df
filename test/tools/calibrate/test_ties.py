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
"""Calibration and adjustment by what a flight's pictures show twice."""

from __future__ import annotations

import json

import pytest
import yaml
from process_bags import rewritten

from tirgeo_ros.tools.cli.main import main

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")

TRUTH = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, "latency": 50.0, "focal": 803.5593}
PLANTED = """
/**/gimbal_node: {ros__parameters: {boresight_rpy_deg: [1.0, -0.8, 1.5]}}
/**/overlay_node: {ros__parameters: {video_latency_s: 0.07}}
"""


def run(capsys, *words):
    """The exit code, what was printed and the errors of a verb."""
    code = main([*map(str, words)])
    return code, *capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ties", "--survey", "x.csv"], "--observations is needed too"),
        (["--ties", "--observations", "x.csv"], "--survey is needed too"),
        (["--ties", "--estimate", "roll"], "--estimate is not for --ties"),
        (["--survey", "x.csv"], "--observations is needed, or --ties"),
    ],
)
def test_points_or_ties(capsys, words, message):
    with pytest.raises(SystemExit, match="2"):
        main(["calibrate", "boresight", "flight.mcap", "-o", "b.yaml", *words])
    assert message in capsys.readouterr().err


@pytest.fixture(scope="module")
def brief(sample, tmp_path_factory):
    """The sample's first two seconds, in one of which there are poses."""
    path = tmp_path_factory.mktemp("brief") / "flight.mcap"
    return rewritten(sample / "flight.mcap", path, seconds=2)


def test_too_few_ties_make_no_result(brief, params, tmp_path, capsys):
    output = tmp_path / "boresight.yaml"
    where = ["--ties", "--params", params, "-o", output]
    code, _, err = run(capsys, "calibrate", "boresight", brief, *where)
    assert code == 1
    assert "15 pairs are needed: fly strips that overlap by two thirds" in err
    assert not output.exists()


def test_a_flight_with_too_few_ties_is_not_adjusted(brief, params, tmp_path, capsys):
    made = []
    for words in ([], ["--adjust"]):
        output = tmp_path / f"out{len(words)}.mcap"
        where = ["--params", params, "--no-images", "-o", output, "--json"]
        code, out, _ = run(capsys, "process", brief, *where, *words)
        assert code == 0
        made.append(output.read_bytes())
    assert any(note.startswith("not adjusted: ") for note in json.loads(out)["notes"])
    assert made[0] == made[1]


@pytest.mark.slow
@pytest.mark.long  # as below
def test_surveyed_points_join_the_ties(sample, params, tmp_path, capsys):
    """The truth is as below; mounting, latency and one click are wrong."""
    clicks, planted = tmp_path / "clicks.csv", tmp_path / "planted.yaml"
    text = (sample / "observations.csv").read_text()
    clicks.write_text(text.replace("P10,1634731242938888889,54.", "P10,1634731242938888889,94."))
    planted.write_text(PLANTED)
    points = ["--survey", sample / "survey.geojson", "--observations", clicks]
    where = ["--params", params, "--params", planted, "-o", tmp_path / "b.yaml", "--json"]
    words = ["boresight", sample / "flight.mcap", "--ties", *points, *where]
    code, out, _ = run(capsys, "calibrate", *words)
    assert code == 0
    result = json.loads(out)
    for name, value in TRUTH.items():
        row = result["parameters"][name]
        assert abs(row["found"] - value) < 4 * row["sigma"]
    assert result["notes"][-1].startswith("left out P10 at 1634731242938888889: ")
    surveyed = result["surveyed"]
    assert (surveyed["points"], surveyed["observations"]) == (12, 23)  # P10 has this click
    # What the gimbal does not report remains: the poses' own corrections are not in it.
    assert surveyed["ground_rmse_m"]["after"] < 0.15 * surveyed["ground_rmse_m"]["before"]


@pytest.mark.slow
@pytest.mark.long  # the ties and the fit of 99 pictures
def test_the_sample_calibrates_itself(sample, params, tmp_path, capsys):
    """Truth: no mounting error, 50 ms, 803.6 px. The bounds are four of its own sigmas."""
    output = tmp_path / "boresight.yaml"
    where = ["--ties", "--params", params, "-o", output, "--json"]
    code, out, _ = run(capsys, "calibrate", "boresight", sample / "flight.mcap", *where)
    assert code == 0
    result = json.loads(out)
    for name, value in TRUTH.items():
        row = result["parameters"][name]
        assert abs(row["found"] - value) < 4 * row["sigma"]
        assert row["sigma"] < row["prior_sigma"] / 10
    apart = result["disagreement_m"]["all"]
    assert apart["at_own_heights"]["median"] < 0.15
    written = yaml.safe_load(output.read_text())
    assert written["/**/overlay_node"]["ros__parameters"]["camera"].endswith(
        "boresight_camera.yaml"
    )
    assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
