"""The names of frames: their prefix, and what is refused."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.config import EkfConfig, FramesConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import load_config
from tirgeo_ros.tools.replay.node_configs import node_configs


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
        load_config(path, "ekf_node", EkfConfig)
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
    assert {one.map_frame for one in node_configs(path)[:3]} == {"field"}
    path.write_text("/**/ekf_node: {ros__parameters: {map_frame: field}}\n")
    with pytest.raises(ConfigError, match=r"differently: set map_frame.* once, under /\*\*"):
        node_configs(path)
