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
"""The shipped aircraft files: few lines, all of them parameters; none claims to be measured."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from project import PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS, AircraftConfig, DjiConfig
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.replay.node_configs import node_configs

SHIPPED = ("m600_xt2.yaml", "m300_h20t.yaml", "generic.yaml")
M600, M300, GENERIC = (PROJECT / "config" / name for name in SHIPPED)
#: A parameter's line, and one that waits behind a "#" for the owner's value; prose has a space.
LINE = re.compile(r"^    (#?)([a-z_.0-9]+): (.+)$", re.MULTILINE)
#: What a person can face, all lines of values counted.
MOST_LINES = 25
MEASURED_BY_THE_OWNER = {
    *("aircraft.gps_antenna_m", "aircraft.gimbal_pivot_m", "aircraft.camera_from_pivot_m"),
    *("boresight_rpy_deg", "video_latency_s", "camera", "geoid_undulation_m", "map"),
    *("ground_height_m", "dem", "dem_undulation_m"),
}
ANTENNAS = {"aircraft.rtk_antenna_m", "aircraft.second_antenna_m"}
OF_OTHER_SENSORS = {
    *("aircraft.imu_rpy_deg", "imu.angle_random_walk", "imu.velocity_random_walk"),
    *("rtk.delay_s", "heading.sigma_floor_deg"),
}


def lines(path):
    """Names of the parameters that a file sets, and of those that wait behind a "#"."""
    result = LINE.findall(path.read_text())
    return [name for mark, name, _ in result if not mark], [
        name for mark, name, _ in result if mark
    ]


@pytest.mark.parametrize("path", [M600, M300, GENERIC], ids=lambda path: path.stem)
def test_a_shipped_file_is_short_and_sound_with_all_its_lines(path, tmp_path):
    live, waiting = lines(path)
    assert len({*live, *waiting}) == len(live) + len(waiting) <= MOST_LINES
    whole = tmp_path / "whole.yaml"
    whole.write_text(LINE.sub(r"    \2: \3", path.read_text()))
    for file, names in ((path, live), (whole, [*live, *waiting])):
        parameters = ParameterFile(file)
        assert parameters.elsewhere() == []
        values = {name: parameters.values(name).keys() for name in NODE_CONFIGS}
        assert set().union(*values.values()) == set(names)
        for node, kind in NODE_CONFIGS.items():
            parameters.config(node, kind)


@pytest.mark.parametrize(
    ("path", "waiting"),
    [
        (M600, MEASURED_BY_THE_OWNER),
        (M300, MEASURED_BY_THE_OWNER | ANTENNAS),
        (GENERIC, MEASURED_BY_THE_OWNER - {"geoid_undulation_m"} | ANTENNAS | OF_OTHER_SENSORS),
    ],
    ids=["m600", "m300", "generic"],
)
def test_what_nobody_measured_is_not_given(path, waiting):
    """So that the checks name it: a value in the file is taken for one that somebody found."""
    assert set(lines(path)[1]) == waiting
    assert not node_configs(path).given & waiting


@pytest.mark.parametrize("node", NODE_CONFIGS)
def test_all_but_the_antennas_is_at_its_default_for_an_m600_and_but_the_source_for_an_m300(node):
    kind = NODE_CONFIGS[node]
    m600, m300 = ParameterFile(M600).config(node, kind), ParameterFile(M300).config(node, kind)
    if hasattr(m600, "aircraft"):
        m600 = replace(m600, aircraft=AircraftConfig())
    if node == "dji_node":
        assert m300.source == "psdk"
        m300 = replace(m300, source="serial")
    # repr, since NaN is not equal to itself
    assert (
        repr(m600) == repr(m300) == repr(kind()) == repr(ParameterFile(GENERIC).config(node, kind))
    )


def test_djis_antennas_stand_across():
    places = ParameterFile(M600).config("dji_node", DjiConfig).aircraft
    assert places.baseline_deg == 90.0
    assert 1.0 <= float(abs(places.baseline_b[1])) <= 1.2
    assert "MEASURE YOURS" in M600.read_text()
