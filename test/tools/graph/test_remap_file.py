"""Files of inputs that have other names in a user's graph."""

from __future__ import annotations

import pytest
from project import PROJECT

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.tools.graph.remap_file import read_remaps
from tirgeo_ros.tools.replay.flight_topics import INPUTS


def test_the_file_for_mavros():
    pairs = read_remaps(PROJECT / "config" / "mavros.yaml")
    assert ("imu/data", "mavros/imu/data") in pairs
    assert {own for own, _ in pairs} <= {*INPUTS}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no lines as imu/data: mavros/imu/data"),
        ("- imu/data", "no lines as imu/data"),
        ("/imu/data: a", "/imu/data: no input of tirgeo: use imu/data, rtk/fix"),
        ("tirgeo/odometry: a", "tirgeo/odometry: no input"),
        ("imu/data: 7", "imu/data: 7 is no topic's name"),
        ("imu/data: a b", "imu/data: 'a b' is no topic's name"),
        ("imu/data: mavros/", "imu/data: 'mavros/' is no topic's name"),
        ("imu/data: a: b", "line 1"),
    ],
)
def test_what_is_no_remap_is_named(tmp_path, text, told):
    path = tmp_path / "remap.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as raised:
        read_remaps(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert told in str(raised.value)
