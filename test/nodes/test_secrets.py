# ruff: noqa: E402 what follows imports ROS, which may be absent
"""Secrets of viewer_node: settable, from a file too, and read by nobody."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from rclpy.context import Context
from rclpy.parameter import Parameter

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.viewer_node import with_secrets

SECRETS = {
    "token": "an-operators-secret",
    "viewer_token": "a-viewers-secret",
    "cot_password": "a key's secret",
}


@pytest.fixture
def node():
    context = Context()
    rclpy.init(context=context, args=[], domain_id=99)
    given = [Parameter(name, value=value) for name, value in SECRETS.items()]
    made = GraphNode(
        "viewer_node", context=context, parameter_overrides=given, enable_rosout=False
    )
    yield made
    made.destroy_node()
    context.try_shutdown()


def test_a_secret_is_used_and_read_back_as_stars(node):
    config = node.configured(ViewerConfig)
    assert {name: getattr(config, name) for name in SECRETS} == SECRETS
    assert [one.value for one in node.get_parameters([*SECRETS])] == ["***"] * 3


def test_what_a_dump_has_instead_of_a_secret_changes_nothing(node):
    node.configured(ViewerConfig)
    stars = [Parameter(name, value="***") for name in SECRETS]
    assert node.set_parameters_atomically(stars).successful
    assert node.set_parameters_atomically([Parameter("token", value=SECRETS["token"])]).successful
    refused = node.set_parameters_atomically([Parameter("token", value="another-secret")])
    assert "token is read at start alone" in refused.reason
    assert [one.value for one in node.get_parameters([*SECRETS])] == ["***"] * 3


@pytest.mark.parametrize("name", [*SECRETS])
def test_a_secret_comes_from_a_file(name, tmp_path):
    file = tmp_path / "secret"
    file.write_text(f"{SECRETS[name]}\n")
    config = with_secrets(replace(ViewerConfig(), **{f"{name}_file": str(file)}))
    assert getattr(config, name) == SECRETS[name]
    both = replace(config, **{name: SECRETS[name]})
    with pytest.raises(ConfigError, match=f"^parameter {name}_file: {name} is given too"):
        with_secrets(both)


@pytest.mark.parametrize("held", [None, b"", b"\n", b"two\nlines\n", b"\xff\xfe"])
def test_a_file_without_a_secret_is_named(held, tmp_path):
    file = tmp_path / "secret"
    if held is not None:
        file.write_bytes(held)
    for name in SECRETS:
        with pytest.raises(ConfigError, match=re.escape(str(file))):
            with_secrets(replace(ViewerConfig(), **{f"{name}_file": str(file)}))


def test_a_wrong_token_in_a_file_is_refused_and_not_shown(tmp_path):
    file = tmp_path / "secret"
    file.write_text("too short")
    with pytest.raises(ConfigError, match=r"^parameter token: \*\*\* is no token"):
        with_secrets(replace(ViewerConfig(), token_file=str(file)))
