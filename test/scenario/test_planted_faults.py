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
"""Faults of set-up and sensors that a new user makes, each named; none on good flights.

``make planted-faults`` prints what is said of each.
"""

from __future__ import annotations

import pytest

from dev.planted_faults.__main__ import found_in, naming
from dev.planted_faults.faults import FAULTS, FlightFiles
from tirgeo_ros.io.parameters.parameter_file import parameters_yaml
from tirgeo_ros.tools.replay.check import check
from tirgeo_ros.tools.replay.locate import locate_pixels
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.simulate.files import simulate

pytestmark = pytest.mark.slow

#: Other routes and sites, in the scenario's keys, with a seed; and from when on.
CLEAN = {
    "figure_eight": (11, 20.0, "route: {shape: figure_eight, heading_deg: 140.0}"),
    "hover": (12, 0.0, "route: {shape: hover, height_above_ground_m: 35.0}"),
    "low_and_fast": (13, 10.0, "route: {height_above_ground_m: 12.0, speed_m_s: 6.0}"),
    "steep_camera": (14, 30.0, "gimbal: {pitch_deg: -60.0}\nwind: {gust_m_s: 2.0}"),
}
#: What no check can see in this flight.
NOT_YET = ("boresight 2 deg", "map 10 m off")


def worse_than_notes(result):
    """Evidence and parameter of what a clean flight must not have."""
    return [
        (one["parameter"], one["evidence"])
        for one in result["findings"]
        if one["severity"] != "note"
    ]


@pytest.mark.parametrize(
    "fault", [one for one in FAULTS if one.name not in NOT_YET], ids=lambda fault: fault.name
)
def test_a_planted_fault_is_named(fault, sample, tmp_path):
    if fault.name.startswith("DEM"):
        pytest.importorskip("rasterio", reason="elevation models need rasterio")
    items = found_in(fault, FlightFiles.in_folder(sample), tmp_path)
    assert naming(fault, items), items


#: One of gimbal, lens, pictures, map and receiver each, and whether it is a STOP.
ELSEWHERE = {
    "joints in degrees": True,
    "wrong K": True,
    "latency": True,
    "UTM zone": True,
    "no camera_info": False,
    "RTK 0.6 s late": True,
}


@pytest.mark.parametrize(
    ("verb", "name"),
    [("process", name) for name in ELSEWHERE]
    + [("locate", name) for name in ("joints in degrees", "wrong K", "latency")],
)
def test_process_and_locate_say_the_same_although_nothing_is_drawn(verb, name, sample, tmp_path):
    fault = next(one for one in FAULTS if one.name == name)
    planted = fault.plant(FlightFiles.in_folder(sample), tmp_path)
    out = tmp_path / {"process": "out.mcap", "locate": "points.geojson"}[verb]
    if verb == "process":
        given = {"params": planted.params, "map": planted.map, "images": False}
        result = process(planted.bag, out, **given)
    else:
        pixels = sample / "observations.csv"
        result = locate_pixels(planted.bag, pixels, out, params=planted.params)
    assert naming(fault, result["findings"])
    assert (result["error"] or "").startswith("NO GO: ") == ELSEWHERE[name]
    assert out.exists()


def test_nothing_is_wrong_with_the_sample(sample):
    result = check(**FlightFiles.in_folder(sample).arguments)
    assert worse_than_notes(result) == []
    assert result["verdict"].startswith("GO")


@pytest.mark.parametrize("name", CLEAN)
def test_nothing_is_wrong_with_other_simulated_flights(name, tmp_path):
    seed, start_s, text = CLEAN[name]
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(text + "\n")
    folder = tmp_path / "flight"
    simulate(scenario, folder, seed=seed, start_s=start_s, duration_s=25.0)
    assert worse_than_notes(check(**FlightFiles.in_folder(folder).arguments)) == []


def test_pictures_of_two_headings_tell_a_boresight_of_2_deg(tmp_path):
    scenario, folder = tmp_path / "scenario.yaml", tmp_path / "flight"
    scenario.write_text("route: {legs: 4, leg_length_m: 20.0, leg_spacing_m: 10.0}\n")
    simulate(scenario, folder, seed=15, start_s=15.0, duration_s=40.0)
    good = FlightFiles.in_folder(folder)
    right = check(**good.arguments)
    assert worse_than_notes(right) == []
    turned = right["checked"]["disagreement"]["other_headings"]
    assert turned["pairs"] >= 3
    assert turned["apart_m"] < 0.3  # 20 m above ground
    planted = next(one for one in FAULTS if one.name == "boresight 2 deg").plant(good, tmp_path)
    (found,) = check(**planted.arguments)["findings"]
    assert found["check"] == "pictures_disagree"
    assert "calibrate boresight --ties" in found["mend"]


def test_a_right_boresight_is_no_fault(sample, tmp_path):
    """What is planted is not the parameter as such: the same one at its true value is right."""
    (tmp_path / "true.yaml").write_text(
        parameters_yaml({"gimbal_node": {"boresight_rpy_deg": [0.0, 0.0, 0.0]}}, "")
    )
    good = FlightFiles.in_folder(sample)
    params = [*good.params, tmp_path / "true.yaml"]
    assert worse_than_notes(check(**good.arguments | {"params": params})) == []
