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
"""The parameter tree: types, ranges, messages, the trees of the nodes, the names of frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.config import (
    NODE_CONFIGS,
    EkfConfig,
    FramesConfig,
    GimbalConfig,
    OverlayConfig,
)
from tirgeo_ros.core.config.schema import config_from, group, param, parameters_of, values_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.replay.node_configs import node_configs

nodes = pytest.mark.parametrize("kind", NODE_CONFIGS.values(), ids=list(NODE_CONFIGS))


@dataclass(frozen=True, slots=True)
class Leaf:
    length_m: float = param(1.5, "a length", ("m", -2, 3))
    unset_m: float = param(math.nan, "unset unless given", ("m", 0, 10))
    arms_m: tuple[float, ...] = param((1.0, 2.0, 3.0), "three numbers", ("m", 0, 9))
    place: tuple[float, ...] = param((), "none or three", sizes=(0, 3))


@dataclass(frozen=True, slots=True)
class Tree:
    mode: str = param("a", "a mode", choices=("a", "b"))
    title: str = param("", "any text")
    count: int = param(2, "a count", ("", 1, 5))
    quick: bool = param(False, "a switch")
    leaf: Leaf = group(Leaf)


def test_nan_is_a_value_only_where_it_is_the_default():
    assert math.isnan(config_from(Tree, {"leaf.unset_m": math.nan}).leaf.unset_m)
    with pytest.raises(ConfigError, match=r"leaf\.length_m: nan m is outside -2 to 3$"):
        config_from(Tree, {"leaf.length_m": math.nan})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("leaf.length_m", 3.5, "parameter leaf.length_m: 3.5 m is outside -2 to 3"),
        ("leaf.length_m", "1.5", "parameter leaf.length_m: '1.5' is not of type double"),
        ("leaf.length_m", True, "parameter leaf.length_m: True is not of type double"),
        ("leaf.length_m", None, "parameter leaf.length_m: None is not of type double"),
        ("leaf.length_m", math.inf, "parameter leaf.length_m: inf is not finite"),
        ("leaf.unset_m", 11.0, "parameter leaf.unset_m: 11 m is outside 0 to 10"),
        ("leaf.unset_m", -math.inf, "parameter leaf.unset_m: -inf is not finite"),
        ("count", 0, "parameter count: 0 is outside 1 to 5"),
        ("count", 2.0, "parameter count: 2.0 is not of type int"),
        ("count", True, "parameter count: True is not of type int"),
        ("quick", 1, "parameter quick: 1 is not of type bool"),
        ("quick", "true", "parameter quick: 'true' is not of type bool"),
        ("mode", "c", "parameter mode: 'c' is not one of a, b"),
        ("mode", 1, "parameter mode: 1 is not of type string"),
        ("title", [], "parameter title: [] is not of type string"),
        ("leaf.arms_m", 1.0, "parameter leaf.arms_m: 1.0 is not a list of numbers"),
        ("leaf.arms_m", "1, 2, 3", "parameter leaf.arms_m: '1, 2, 3' is not a list of numbers"),
        ("leaf.arms_m", b"123", "parameter leaf.arms_m: b'123' is not a list of numbers"),
        ("leaf.arms_m", [1, 2], "parameter leaf.arms_m: needs 3 numbers, has 2"),
        ("leaf.arms_m", [1, 2, 10], "parameter leaf.arms_m: 10 m is outside 0 to 9"),
        ("leaf.arms_m", [1, 2, "3"], "parameter leaf.arms_m: '3' is not of type double"),
        ("leaf.arms_m", [1, math.nan, 3], "parameter leaf.arms_m: nan m is outside 0 to 9"),
        ("leaf.place", [1, 2], "parameter leaf.place: needs 0 or 3 numbers, has 2"),
        ("leaf.place", [1, 2, math.inf], "parameter leaf.place: inf is not finite"),
        ("leaf.place", [1, 2, math.nan], "parameter leaf.place: nan is outside -inf to inf"),
    ],
)
def test_messages(name, value, message):
    with pytest.raises(ConfigError) as caught:
        config_from(Tree, {name: value})
    assert str(caught.value) == message
    with pytest.raises(ConfigError) as caught:
        config_from(Tree, {name: value}, "aircraft.yaml")
    assert str(caught.value) == f"aircraft.yaml: {message}"


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("leaf.lenght_m", r"did you mean leaf\.length_m\?\)$"),
        ("xyz", r"known: mode, title, count, quick, leaf\.length_m, "),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_known_or_all(name, answer):
    with pytest.raises(ConfigError, match=rf"^a\.yaml: unknown parameter {name} \({answer}"):
        config_from(Tree, {name: 1.0}, "a.yaml")


@given(
    st.floats(-2, 3) | st.integers(-2, 3),
    st.floats(0, 10) | st.just(math.nan),
    st.lists(st.floats(0, 9) | st.integers(0, 9), min_size=3, max_size=3),
    st.sampled_from(["a", "b"]),
    st.text(),
    st.integers(1, 5),
)
def test_values_come_back(length, unset, arms, mode, title, count):
    given_values = {
        "leaf.length_m": length,
        "leaf.unset_m": unset,
        "leaf.arms_m": arms,
        "mode": mode,
        "title": title,
        "count": count,
    }
    config = config_from(Tree, given_values)
    again = config_from(Tree, values_of(config))
    assert repr(again) == repr(config)  # nan is not equal to itself
    read = given_values | {"leaf.length_m": float(length), "leaf.arms_m": tuple(map(float, arms))}
    assert repr({name: values_of(config)[name] for name in read}) == repr(read)


# The nodes' own trees


@nodes
def test_defaults_of_a_node_come_back(kind):
    values = values_of(kind())
    assert list(values) == [p.name for p in parameters_of(kind)]
    assert repr(config_from(kind, values)) == repr(kind())


@nodes
def test_every_parameter_of_a_node_is_described_and_allows_its_default(kind):
    for parameter in parameters_of(kind):
        assert parameter.description, parameter.name
        assert repr(parameter.checked(parameter.default)) == repr(parameter.default)
        assert parameter.low <= parameter.high
        if parameter.name.endswith(("_m", "_s", "_deg", "_hz")):
            assert parameter.unit in {"m", "s", "deg", "Hz", "m/s"}, parameter.name
        if isinstance(parameter.default, float | int) and type(parameter.default) is not bool:
            # Without a range, nothing refuses a value that makes no sense.
            assert np.isfinite([parameter.low, parameter.high]).all(), parameter.name


def test_imu_defaults_are_the_paper_s():
    """Table 5 of Ren et al. 2022, x, y, z."""
    imu = EkfConfig().imu
    assert imu.angle_random_walk == (1.6828e-4, 1.9601e-4, 1.6542e-4)
    assert imu.velocity_random_walk == (1.2917e-2, 1.2996e-2, 1.2921e-2)
    assert imu.gyro_bias_instability == (1.5289e-6, 3.7010e-5, 2.2793e-6)
    assert imu.gyro_bias_time_s == (7000, 100, 9000)
    assert imu.accel_bias_instability == (6.0546e-3, 2.8561e-3, 7.9284e-3)
    assert imu.accel_bias_time_s == (20, 600, 10000)


def test_contract_s_names_are_there():
    known = {name: {p.name for p in parameters_of(kind)} for name, kind in NODE_CONFIGS.items()}
    assert known["ekf_node"] >= {
        "method", "position_update", "publish_rate_hz", "max_delay_s", "max_imu_gap_s",
        "imu.angle_random_walk", "imu.velocity_random_walk", "imu.gyro_bias_instability",
        "imu.gyro_bias_time_s", "imu.accel_bias_instability", "imu.accel_bias_time_s",
        "rtk.median_window", "rtk.delay_s", "heading.sigma_floor_deg", "origin_lat_lon_h",
    }  # fmt: skip
    assert known["gimbal_node"] >= {"composition", "boresight_rpy_deg"}
    aircraft = {f"aircraft.{name}" for name in (
        "rtk_antenna_m", "second_antenna_m", "gps_antenna_m", "gimbal_pivot_m",
        "camera_from_pivot_m", "imu_m", "imu_rpy_deg",
    )}  # fmt: skip
    for node in ("dji_node", "ekf_node", "gimbal_node", "bag_player"):
        assert known[node] >= aircraft
    wanted = {"map", "ground_height_m", "video_latency_s", "max_pose_wait_s"}
    assert known["overlay_node"] >= wanted
    assert OverlayConfig().video_latency_s == 0.05
    assert EkfConfig().method == "ekf_heading"


def test_a_boresight_is_written_forward_left_up_and_used_forward_right_down():
    gimbal = config_from(GimbalConfig, {"boresight_rpy_deg": [180, 90, -90]})
    np.testing.assert_allclose(gimbal.boresight_rpy_rad, [np.pi, -np.pi / 2, np.pi / 2])


def test_the_prefix_is_put_before_every_name():
    plain = FramesConfig().frame_ids
    assert plain[:3] == ("map", "base_link", "tir_optical_frame")
    prefixed = FramesConfig(frame_prefix="uav1/").frame_ids
    assert prefixed == tuple(f"uav1/{name}" for name in plain)
    assert len({*plain}) == len(plain)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("map_frame", "/map", "'/map' begins with a slash, which tf2 refuses: write 'map'"),
        ("base_link_frame", "base link", "'base link' has a space"),
        ("camera_frame", "", "'' is empty: a frame needs a name"),
        ("frame_prefix", "/uav1/", "'/uav1/' begins with a slash, which tf2 refuses"),
        ("frame_prefix", "uav 1/", "'uav 1/' has a space"),
        ("map_frame", 3, "3 is not of type string"),
    ],
)
def test_names_that_tf2_refuses_are_refused(name, value, message, tmp_path):
    path = tmp_path / "frames.yaml"
    path.write_text(f"/**: {{ros__parameters: {{{name}: {value!r}}}}}\n")
    with pytest.raises(ConfigError) as caught:
        ParameterFile(path).config("ekf_node", EkfConfig)
    assert f"parameter {name}: {message}" in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["base_link", "gimbal_pivot"])
def test_two_frames_of_one_name_are_refused(name):
    config = config_from(OverlayConfig, {"map_frame": name})
    with pytest.raises(ConfigError, match=rf"two frames are named {name}: give each its own"):
        _ = config.frame_ids


def test_a_command_refuses_nodes_that_name_their_frames_differently(tmp_path):
    path = tmp_path / "frames.yaml"
    path.write_text("/**: {ros__parameters: {map_frame: field}}\n")
    assert {item.map_frame for item in node_configs(path)[:3]} == {"field"}
    path.write_text("/**/ekf_node: {ros__parameters: {map_frame: field}}\n")
    with pytest.raises(
        ConfigError, match=r"different names of frames: set map_frame.* once, under /\*\*"
    ):
        node_configs(path)
