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
import math
import tempfile
from datetime import datetime, timezone

import pytest
import yaml
from stills import GROUND_M, PLANE, POINTS, name_of, strip, write_folder, write_ground

from tirgeo_ros.core.types.errors import BagError, LogError, SurveyError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.surveys.survey import load_observations
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.direct_input import direct_form
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.replay.node_configs import open_flight

SIGMA = "confidence.focal_sigma"
STILLS = strip()[:3]
GROUND = ["--ground-height", str(GROUND_M)]


@pytest.fixture
def folder(monkeypatch, tmp_path):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    write_ground(tmp_path, STILLS)
    return write_folder(tmp_path / "DCIM", STILLS)


def located(capsys, folder, tmp_path, rows, *words):
    pixels, output = tmp_path / "pixels.csv", tmp_path / "points.csv"
    pixels.write_text(rows)
    code = main(["locate", str(folder), "--pixels", str(pixels), "-o", str(output), *words])
    said = capsys.readouterr()
    rows = [*csv.DictReader(output.read_text("utf-8-sig").splitlines())] if not code else []
    return code, said.err, rows


def test_a_pixel_is_named_by_its_still(folder, tmp_path, capsys):
    rows = (tmp_path / "observations.csv").read_text()
    code, _, points = located(capsys, folder, tmp_path, rows, *GROUND)
    assert code == 0
    stamps = {name_of(number): still.stamp_ns for number, still in enumerate(STILLS)}
    for row, point in zip(csv.DictReader(rows.splitlines()), points, strict=True):
        assert int(point["stamp_ns"]) == stamps[row["picture"]]
        place = (float(point[axis]) for axis in ("latitude_deg", "longitude_deg"))
        ned = PLANE.ned_from_geodetic(*map(math.radians, place), float(point["height_m"]))
        # 1e-5 rad between the tangent planes, at up to 200 m
        assert ned[:2] == pytest.approx(POINTS[row["id"]][::-1], abs=5e-3)
        assert 0.1 < float(point["ellipse_minor_m"]) <= float(point["ellipse_major_m"]) < 15


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
    assert opened.configs.given >= {SIGMA, "north.sigma_deg", "confidence.map_sigma_m"}
    assert opened.configs.overlay.confidence.focal_sigma == 0.02
    assert opened.configs.overlay.video_latency_s == 0.0  # the stamp is that of the exposure
    assert any("the lens is not calibrated" in note for note in opened.notes)
    params.write_text(f"/**: {{ros__parameters: {{{SIGMA}: 0.005}}}}")
    opened = open_flight(folder, [], params, "", {"method": "raw"})
    assert opened.configs.overlay.confidence.focal_sigma == 0.005
    assert opened.configs.ekf.method == "raw"


def test_the_temporary_bag_goes_with_its_reader(folder, tmp_path):
    opened = open_flight(folder, [], None, "", {})
    assert len([*(tmp_path / "temporary").iterdir()]) == 1
    assert opened.reader.path == folder
    del opened
    assert not [*(tmp_path / "temporary").iterdir()]


def test_an_import_that_fails_leaves_nothing(folder, tmp_path):
    for file in folder.iterdir():
        file.unlink()
    (folder / name_of(0)).write_bytes(b"")
    with pytest.raises(LogError, match=r"DCIM: .*it is empty"):
        open_flight(folder, [], None, "", {})
    assert not [*(tmp_path / "temporary").iterdir()]


def test_options_of_the_import_reach_the_reader(folder, tmp_path):
    """None of a still's time, datum and sea level is in it; the zone shows in the stamps."""
    local = {"UTCAtExposure": None, "tags": {"DateTimeOriginal": "2024:05:10 10:30:00"}}
    for number, still in enumerate(STILLS):
        (folder / name_of(number)).write_bytes(still.jpeg(**local, AltitudeType="PressureAlt"))
    words = "--height sea --geoid-undulation 43.2 --utc-offset=+02:00 --no-images"
    output = tmp_path / "out.mcap"
    assert main(["process", str(folder), "-o", str(output), *words.split()]) == 0
    pose = next(BagReader(output).messages(["/tirgeo/camera_pose"]))
    utc = datetime(2024, 5, 10, 8, 30, tzinfo=timezone.utc)
    assert pose.log_time_ns == utc.timestamp() * 10**9


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
    assert direct_form(folder).name == "stills"
    assert direct_form(sample / "flight.mcap") is None
    assert direct_form(tmp_path / "absent") is None
    (folder / "flight_0.mcap").touch()  # a recorder that was killed leaves no metadata.yaml
    assert direct_form(folder) is None


def test_an_import_writes_its_parameters_beside_the_bag(folder, tmp_path, capsys):
    output = tmp_path / "flight.mcap"
    assert main(["import", str(folder), "-o", str(output)]) == 0
    assert "use it with --params" in capsys.readouterr().out
    tree = yaml.safe_load((tmp_path / "flight.yaml").read_text())
    assert tree["/**"]["ros__parameters"] == {SIGMA: 0.02, "north.sigma_deg": 3.0}
    assert BagReader(output).stills()[name_of(2)] == STILLS[2].stamp_ns
    with pytest.raises(BagError, match=r"flight\.yaml: would overwrite the input"):
        import_flight(folder, tmp_path / "flight.mcap", params=tmp_path / "flight.yaml")
