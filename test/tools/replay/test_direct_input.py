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
"""The verbs on a folder of stills: imported first, with its parameters below the user's."""

from __future__ import annotations

import csv
import json
import tempfile

import pytest
import yaml
from stills import PLACE_DEG, START_NS, STEP_NS, StandIn, folder_of

from tirgeo_ros.core.types.errors import BagError, SurveyError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.surveys.survey import load_observations
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.direct_input import is_direct
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.replay.node_configs import open_flight

SIGMA = "confidence.lens_sigma_px"
GROUND = ["--ground-height", "11.5"]


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return StandIn({SIGMA: 15.0, "method": "raw"}).put(monkeypatch)


@pytest.fixture
def folder(stand_in, tmp_path):
    return folder_of(tmp_path / "DCIM")


def located(capsys, folder, tmp_path, rows, *words):
    pixels, output = tmp_path / "pixels.csv", tmp_path / "points.csv"
    pixels.write_text(rows)
    code = main(["locate", str(folder), "--pixels", str(pixels), "-o", str(output), *words])
    said = capsys.readouterr()
    rows = [*csv.DictReader(output.read_text("utf-8-sig").splitlines())] if not code else []
    return code, said.err, rows


def test_a_pixel_is_named_by_its_still(folder, tmp_path, capsys):
    rows = "id,picture,u,v\na,DJI_0001_T.JPG,349.3,251.8\nb,DJI_0002_T.JPG,349.3,251.8\n"
    code, _, points = located(capsys, folder, tmp_path, rows, *GROUND)
    assert code == 0
    assert [int(row["stamp_ns"]) for row in points] == [START_NS + STEP_NS, START_NS + 2 * STEP_NS]
    # The middle of a picture that looks down is below the camera: 1 and 2 m north of the first.
    for number, row in enumerate(points, 1):
        north_m = (float(row["latitude_deg"]) - PLACE_DEG[0]) * 111_195
        assert north_m == pytest.approx(number, abs=0.5)
        assert float(row["longitude_deg"]) == pytest.approx(PLACE_DEG[1], abs=1e-5)


def test_an_unknown_still_is_an_error_that_names_row_and_file(folder, tmp_path, capsys):
    rows = "id,picture,u,v\na,DJI_0001_T.JPG,1,2\nb,DJI_0009_T.JPG,1,2\n"
    code, said, _ = located(capsys, folder, tmp_path, rows, *GROUND)
    assert code == 1
    assert "pixels.csv: row 2: no still DJI_0009_T.JPG in the flight (did you mean" in said
    with pytest.raises(SurveyError, match=r"pixels\.csv: row 1: .*it has none: use stamp_ns"):
        load_observations(tmp_path / "pixels.csv")


def test_parameters_of_the_import_count_as_given_below_the_users(folder, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {confidence: {map_sigma_m: 2.0}}}")
    opened = open_flight(folder, [], params, "", {})
    assert opened.configs.given >= {SIGMA, "method", "confidence.map_sigma_m"}
    assert opened.configs.ekf.method == "raw"
    assert opened.configs.overlay.confidence.lens_sigma_px == 15.0
    assert opened.configs.overlay.video_latency_s == 0.0  # the stamp is that of the exposure
    params.write_text(f"/**: {{ros__parameters: {{{SIGMA}: 3.0}}}}")
    opened = open_flight(folder, [], params, "", {"method": "rtk"})
    assert opened.configs.overlay.confidence.lens_sigma_px == 3.0
    assert opened.configs.ekf.method == "rtk"
    assert "a stand-in read them" in opened.notes


def test_the_temporary_bag_goes_with_its_reader(folder, tmp_path):
    opened = open_flight(folder, [], None, "", {})
    assert len([*(tmp_path / "temporary").iterdir()]) == 1
    assert opened.reader.path == folder
    del opened
    assert not [*(tmp_path / "temporary").iterdir()]


def test_an_import_that_fails_leaves_nothing(folder, tmp_path):
    for file in folder.iterdir():
        file.unlink()
    with pytest.raises(Exception, match="DCIM: nothing in it can be used"):
        open_flight(folder, [], None, "", {})
    assert not [*(tmp_path / "temporary").iterdir()]


def test_options_of_the_import_reach_the_reader(folder, stand_in, tmp_path):
    words = "--height sea --geoid-undulation 43.2 --utc-offset=+02:00 --every 2 --no-images"
    output = tmp_path / "out.mcap"
    assert main(["process", str(folder), "-o", str(output), *words.split()]) == 0
    options = stand_in.options
    assert (options.height, options.geoid_undulation_m) == ("sea", 43.2)
    assert (options.utc_offset_s, options.every_s) == (7200, 2.0)
    assert "/tirgeo/camera_pose" in BagReader(output).topics()


@pytest.mark.parametrize(
    "option",
    ["--height=sea", "--geoid-undulation=1", "--utc-offset=Z", "--takeoff-height=1", "--every=1"],
)
def test_for_a_bag_they_are_refused(sample, tmp_path, capsys, option):
    words = ["process", str(sample / "flight.mcap"), "-o", str(tmp_path / "out.mcap"), option]
    assert main(words) == 1
    name = option.partition("=")[0]
    assert f"flight.mcap: a bag: {name} is for stills, MP4 and MISB" in capsys.readouterr().err


def test_what_is_direct(folder, sample, tmp_path):
    assert is_direct(folder)
    assert not is_direct(sample / "flight.mcap")
    assert not is_direct(tmp_path / "absent")
    (folder / "flight_0.mcap").touch()  # a recorder that was killed leaves no metadata.yaml
    assert not is_direct(folder)


def test_an_import_writes_its_parameters_beside_the_bag(folder, tmp_path, capsys):
    output = tmp_path / "flight.mcap"
    assert main(["import", str(folder), "-o", str(output)]) == 0
    assert "use it with --params" in capsys.readouterr().out
    tree = yaml.safe_load((tmp_path / "flight.yaml").read_text())
    values = tree["/**"]["ros__parameters"]
    assert values == {SIGMA: 15.0, "method": "raw"}
    assert BagReader(output).stills()["DJI_0002_T.JPG"] == START_NS + 2 * STEP_NS
    with pytest.raises(BagError, match=r"flight\.yaml: would overwrite the input"):
        import_flight(folder, tmp_path / "flight.mcap", params=tmp_path / "flight.yaml")


def test_check_evaluate_and_export_take_them_too(folder, tmp_path, capsys):
    main(["check", str(folder), *GROUND, "--json"])
    assert json.loads(capsys.readouterr().out)["input"] == str(folder)
    survey = tmp_path / "survey.csv"
    latitude, longitude = PLACE_DEG
    survey.write_text(f"id,lat,lon,h\na,{latitude},{longitude},11.5\n")
    clicks = tmp_path / "clicks.csv"
    clicks.write_text("id,picture,u,v\na,DJI_0000_T.JPG,349.3,251.8\n")
    words = ["--survey", str(survey), "--observations", str(clicks), "-o", str(tmp_path / "ev")]
    assert main(["evaluate", str(folder), *words, "--json"]) == 0
    raw = json.loads(capsys.readouterr().out)["methods"]
    assert raw
    assert main(["export", str(folder), "-o", str(tmp_path / "ex"), "--every", "0", *GROUND]) == 0
    assert len([*(tmp_path / "ex" / "stills").iterdir()]) == 3
