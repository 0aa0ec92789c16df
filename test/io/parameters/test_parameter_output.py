"""What a calibration writes comes back as the nodes read it."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.io.parameters.parameter_output import write_parameters

WALK = (1.6828e-4, 1.9601e-4, 1.6542e-4)


def test_round_trip(tmp_path):
    path = tmp_path / "found.yaml"
    values = {"imu.angle_random_walk": WALK, "method": "ekf", "rtk.delay_s": 1 / 3}
    write_parameters(path, {"ekf_node": values}, "Found by a test.\n\nOn two lines.")
    config = ParameterFile(path).config("ekf_node", EkfConfig)
    assert config.imu.angle_random_walk == WALK
    assert config.method == "ekf"
    assert config.rtk.delay_s == pytest.approx(1 / 3, rel=1e-8)  # nine digits
    assert path.read_text().startswith("# Found by a test.\n#\n# On two lines.\n/**/ekf_node")


def test_the_later_file_stands_before_the_earlier(tmp_path):
    first, second = tmp_path / "aircraft.yaml", tmp_path / "boresight.yaml"
    arms = (0.1, 0.0, 0.2)
    given = {"aircraft.gimbal_pivot_m": arms, "boresight_rpy_deg": (9.0, 9.0, 9.0)}
    write_parameters(first, {"gimbal_node": given}, "")
    write_parameters(second, {"gimbal_node": {"boresight_rpy_deg": (1.0, -0.8, 1.5)}}, "")
    config = ParameterFile([first, second]).config("gimbal_node", GimbalConfig)
    assert config.aircraft.gimbal_pivot_m == arms
    assert config.boresight_rpy_deg == (1.0, -0.8, 1.5)


def test_an_empty_name_is_all_nodes(tmp_path):
    path = tmp_path / "found.yaml"
    write_parameters(path, {"": {"aircraft.rtk_antenna_m": (0.1, 0.2, 0.3)}}, "")
    assert "\n/**:" in "\n" + path.read_text()
    for node, kind in (("ekf_node", EkfConfig), ("gimbal_node", GimbalConfig)):
        config = ParameterFile(path).config(node, kind)
        assert config.aircraft.rtk_antenna_m == (0.1, 0.2, 0.3)


def test_all_files_are_written_or_none(tmp_path):
    (tmp_path / "old").write_text("old")
    with pytest.raises(ConfigError, match=r"absent/b: cannot be written: No such file"):
        write_files({tmp_path / "old": "new", tmp_path / "absent" / "b": "b"}, ConfigError)
    assert (tmp_path / "old").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    write_files({tmp_path / "old": "néw", str(tmp_path / "b"): b"bytes"}, ConfigError)
    assert (tmp_path / "old").read_text(encoding="utf-8") == "néw"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "old"]
