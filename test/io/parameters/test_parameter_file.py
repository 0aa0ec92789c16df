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
"""ROS 2 parameter files: what fits a node, what wins, what is refused, what is written."""

from __future__ import annotations

import math

import pytest

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.io.parameters.parameter_file import ParameterFile, parameters_yaml

WALK = (1.6828e-4, 1.9601e-4, 1.6542e-4)


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "params.yaml"
        path.write_text(text)
        return path

    return write


def load_parameters(path, node, namespace=""):
    return ParameterFile(path).values(node, namespace)


def ekf(section, body="publish_rate_hz: 50.0"):
    return f"{section}:\n  ros__parameters:\n    {body}\n"


def test_nested_and_dotted_names_are_the_same(write):
    nested = ekf("ekf_node", "imu: {gyro_turn_on_bias: 0.25}")
    dotted = ekf("ekf_node", "imu.gyro_turn_on_bias: 0.25")
    wanted = {"imu.gyro_turn_on_bias": 0.25}
    assert load_parameters(write(nested), "ekf_node") == wanted
    assert load_parameters(write(dotted), "ekf_node") == wanted
    assert ParameterFile(write(nested)).config("ekf_node", EkfConfig).imu.gyro_turn_on_bias == 0.25


@pytest.mark.parametrize(
    ("section", "namespace", "fits"),
    [
        ("ekf_node", "", True),
        ("/ekf_node", "", True),
        ("/ekf_node", "uav1", False),
        ("/**", "", True),
        ("/**", "/uav1", True),
        ("/**/ekf_node", "", True),
        ("/**/ekf_node", "fleet/uav1", True),
        ("/*/ekf_node", "uav1", True),
        ("/*/ekf_node", "", False),
        ("/*/ekf_node", "fleet/uav1", False),
        ("/uav1/ekf_node", "/uav1/", True),
        ("/uav1/ekf_node", "", False),
        ("/uav1/*", "uav1", True),
        ("/uav1/**", "uav2", False),
        ("gimbal_node", "", False),
    ],
)
def test_sections_and_nodes(write, section, namespace, fits):
    body = "max_wait_s: 1.0" if section == "gimbal_node" else "publish_rate_hz: 50.0"
    result = load_parameters(write(ekf(section, body)), "ekf_node", namespace)
    assert result == ({"publish_rate_hz": 50.0} if fits else {})


def test_the_later_section_wins(write):
    general = ekf("/**", "publish_rate_hz: 10.0")
    special = ekf("/**/ekf_node", "publish_rate_hz: 20.0")
    assert load_parameters(write(general + special), "ekf_node") == {"publish_rate_hz": 20.0}
    assert load_parameters(write(special + general), "ekf_node") == {"publish_rate_hz": 10.0}


def test_one_file_for_all_nodes(write):
    path = write(
        """
/**:
  ros__parameters:
    use_sim_time: true
    video_latency_s: 0.2     # overlay_node's
    method: rtk              # ekf_node's
    qos_overrides: {/imu/data: {subscription: {depth: 3}}}
    aircraft: {gimbal_pivot_m: [0.1, 0, -0.2]}     # of all that need it
"""
    )
    assert ParameterFile(path).config("ekf_node", EkfConfig).method == "rtk"
    assert ParameterFile(path).config("overlay_node", OverlayConfig).video_latency_s == 0.2
    assert ParameterFile(path).config("gimbal_node", GimbalConfig).aircraft.gimbal_pivot_m == (
        0.1,
        0,
        -0.2,
    )
    assert load_parameters(path, "gimbal_node") == {
        "use_sim_time": True,
        "qos_overrides./imu/data.subscription.depth": 3,
        "aircraft.gimbal_pivot_m": [0.1, 0, -0.2],
    }


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-1", 0.1), ("2.0E+1", 20.0), (".5", 0.5), ("5.", 5.0), ("3", 3.0), ("0x10", 16.0)],
)
def test_numbers_as_rcl_reads_them(write, text, value):
    path = write(ekf("ekf_node", f"publish_rate_hz: {text}"))
    assert ParameterFile(path).config("ekf_node", EkfConfig).publish_rate_hz == value


def test_texts_that_look_like_something_else(write):
    body = "label_field: 2020-01-01\n    map: 12:30:00\n    ground_height_m: .NaN"
    config = ParameterFile(write(ekf("overlay_node", body))).config("overlay_node", OverlayConfig)
    assert math.isnan(config.ground_height_m)
    assert (config.label_field, config.map) == ("2020-01-01", "12:30:00")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (ekf("ekf_node", "publish_rate: 50.0"), r"\(did you mean publish_rate_hz\?\)"),
        (
            ekf("/**", "qos_overrides: {/imu/data: {subscription: {depht: 3}}}"),
            r"parameter qos\S+depht \(did you mean qos_overrides./imu/data.subscription.depth\?\)",
        ),
        (ekf("/**/overlay_node", 'map: "a\\0b"'), r"parameter map: 'a\\x00b' has a NUL character"),
        (ekf("ekf_nod"), "unknown node /ekf_nod; known: dji_node, ekf_node, gimbal_node"),
        (
            ekf("ekf_node", "rtk: {lever_arm_m: [0, 0, 0]}"),
            "rtk.lever_arm_m is now aircraft.rtk_ant",
        ),
        (
            "ekf_node:\n  publish_rate_hz: 3.0\n",
            "ekf_node/publish_rate_hz is not under ros__param",
        ),
        ("ekf_node:\n  ros__parameters: 3\n", "ros__parameters holds no parameters"),
        ("- 1\n", "not a parameter file: it needs NODE: ros__parameters: NAME: VALUE"),
        ("a: [1, 2\n", "line 2: not YAML"),
        ("a: !!python/object:os.system {}\n", "line 1: not YAML: could not determine a constr"),
        (ekf("ekf_node") + ekf("ekf_node"), "line 4: not YAML: key ekf_node appears twice"),
        ("a: &a {b: *a}\n", "line 1: not YAML: aliases are not supported"),
        (
            ekf("ekf_node", f"publish_rate_hz: {'9' * 5000}"),
            "line 3: not YAML: '9{59} is not a valid int",
        ),
        (ekf("ekf_node", 'method: "\\ud800"'), r"line 3: not YAML: '\\ud800' is not a valid str"),
        (f"a: {'[' * 5000}", "not YAML: nested too deeply"),
    ],
)
def test_what_is_refused_names_file_and_key(write, text, reason):
    path = write(text)
    with pytest.raises(ConfigError, match=rf"^{path}: .*{reason}"):
        load_parameters(path, "ekf_node")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.yaml: cannot be read: No such file"):
        ParameterFile(tmp_path / "none.yaml").config("ekf_node", EkfConfig)
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        ParameterFile(tmp_path).config("ekf_node", EkfConfig)
    (tmp_path / "bytes.yaml").write_bytes(b"a: \xff\xfe")
    with pytest.raises(ConfigError, match="not a text file in UTF-8"):
        ParameterFile(tmp_path / "bytes.yaml").config("ekf_node", EkfConfig)


def test_sections_for_a_node_that_has_none_here(write):
    text = "/uav1/ekf_node:\n  ros__parameters: {publish_rate_hz: 50.0}\n"
    file = ParameterFile(write(text))
    assert file.elsewhere("uav1") == []
    assert file.elsewhere() == file.elsewhere("uav2") == ["/uav1/ekf_node"]
    both = ParameterFile(write(text + text.replace("uav1", "uav2")))  # a file for a fleet
    assert both.elsewhere("uav2") == []


def test_round_trip_also_of_what_is_for_all_nodes(tmp_path):
    path = tmp_path / "found.yaml"
    values = {"imu.angle_random_walk": WALK, "method": "ekf", "rtk.delay_s": 1 / 3}
    antenna_m = {"aircraft.rtk_antenna_m": (0.1, 0.2, 0.3)}
    text = "Found by a test.\n\nOn two lines."
    path.write_text(parameters_yaml({"ekf_node": values, "": antenna_m}, text))
    config = ParameterFile(path).config("ekf_node", EkfConfig)
    assert config.imu.angle_random_walk == WALK
    assert config.method == "ekf"
    assert config.rtk.delay_s == pytest.approx(1 / 3, rel=1e-8)  # nine digits
    assert path.read_text().startswith("# Found by a test.\n#\n# On two lines.\n/**/ekf_node")
    assert "\n/**:" in path.read_text()  # an empty name is all nodes
    for node, kind in (("ekf_node", EkfConfig), ("gimbal_node", GimbalConfig)):
        assert ParameterFile(path).config(node, kind).aircraft.rtk_antenna_m == (0.1, 0.2, 0.3)


def test_the_later_file_stands_before_the_earlier(tmp_path):
    first, second = tmp_path / "aircraft.yaml", tmp_path / "boresight.yaml"
    arms = (0.1, 0.0, 0.2)
    values = {"aircraft.gimbal_pivot_m": arms, "boresight_rpy_deg": (9.0, 9.0, 9.0)}
    first.write_text(parameters_yaml({"gimbal_node": values}, ""))
    second.write_text(
        parameters_yaml({"gimbal_node": {"boresight_rpy_deg": (1.0, -0.8, 1.5)}}, "")
    )
    config = ParameterFile([first, second]).config("gimbal_node", GimbalConfig)
    assert config.aircraft.gimbal_pivot_m == arms
    assert config.boresight_rpy_deg == (1.0, -0.8, 1.5)


def test_all_files_are_written_or_none(tmp_path):
    (tmp_path / "old").write_text("old")
    with pytest.raises(ConfigError, match=r"absent/b: cannot be written: No such file"):
        write_files({tmp_path / "old": "new", tmp_path / "absent" / "b": "b"}, ConfigError)
    assert (tmp_path / "old").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    write_files({tmp_path / "old": "néw", str(tmp_path / "b"): b"bytes"}, ConfigError)
    assert (tmp_path / "old").read_text(encoding="utf-8") == "néw"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "old"]
