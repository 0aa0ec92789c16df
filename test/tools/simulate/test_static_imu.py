"""The record of an IMU at rest: its messages and its errors."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.sensors import imu_bias, imu_white
from tirgeo_ros.tools.simulate.static_imu import main, write_static

HOURS, SEED = 0.01, 3


@pytest.fixture(scope="module")
def scenario():
    return scenario_from({"imu.rate_hz": 400.0})


@pytest.fixture(scope="module")
def messages(scenario, tmp_path_factory):
    path = tmp_path_factory.mktemp("static") / "static.mcap"
    count = write_static(path, HOURS, scenario, SEED)
    cdr = Cdr()
    read = [(m, cdr.deserialize(m.data, m.typename)) for m in BagReader(path).messages()]
    assert len(read) == count == 14400
    return read


def test_stamps_are_even_and_the_log_times(scenario, messages):
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages])
    assert stamps[0] == scenario.start_ns
    np.testing.assert_array_equal(np.diff(stamps), 2_500_000)
    np.testing.assert_array_equal(stamps, [raw.log_time_ns for raw, _ in messages])
    assert {(raw.topic, m.header.frame_id) for raw, m in messages} == {("/imu/data", "base_link")}


def test_values_are_gravity_and_the_errors_of_the_flights(scenario, messages):
    def xyz(vectors):
        return np.array([(v.x, v.y, v.z) for v in vectors])

    rate = flu_from_frd(xyz(m.angular_velocity for _, m in messages))
    force = flu_from_frd(xyz(m.linear_acceleration for _, m in messages))
    bias = imu_bias(scenario.imu, SEED, len(messages))
    white = imu_white(scenario.imu, SEED, len(messages))
    gravity = gravity_down(np.radians(scenario.site.latitude_deg), scenario.site.ground_height_m)
    np.testing.assert_allclose(rate, bias.gyro_b + white[0], rtol=1e-12, atol=1e-15)
    wanted = bias.accel_b + white[1] - [0, 0, gravity]
    np.testing.assert_allclose(force, wanted, rtol=1e-12, atol=1e-12)


def test_the_command(tmp_path, capsys):
    path = tmp_path / "new" / "static.mcap"
    main(["-o", str(path), "--hours", "0.001"])
    assert capsys.readouterr().out == f"360 messages: {path}\n"
    first = path.read_bytes()
    main(["-o", str(path), "--hours", "0.001"])
    assert path.read_bytes() == first
    with pytest.raises(SystemExit, match="--hours must be above 0"):
        main(["-o", str(path), "--hours", "0"])
