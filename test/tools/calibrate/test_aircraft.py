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
"""``tirgeo calibrate aircraft`` over bags: what it finds, writes and refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from aircraft_flights import (
    ANTENNA_M,
    AZIMUTH_DEG,
    DELAYS_S,
    TURNS,
    aircraft_samples,
    truth,
)
from process_bags import write_samples

from tirgeo_ros.core.calibration.aircraft_fit import expected_biases
from tirgeo_ros.core.calibration.aircraft_parameters import PARAMETERS
from tirgeo_ros.core.config import AutopilotConfig
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample
from tirgeo_ros.tools.calibrate.aircraft import calibrate_aircraft
from tirgeo_ros.tools.cli.calibrate import aircraft as verb
from tirgeo_ros.tools.cli.main import main as command

PER_UNIT = {"m": 1.0, "deg": math.radians(1.0), "ms": 1e-3}
#: What is asked of a flight of three minutes: m, deg, ms.
ASKED = {"m": 0.02, "deg": 0.1, "ms": 3.0}


def errors(result):
    """Return estimate minus truth by parameter, in its unit."""
    planted = dict(zip(PARAMETERS, truth(), strict=True))
    return {
        name: item["found"] - planted[name] / PER_UNIT[item["unit"]]
        for name, item in result["parameters"].items()
        if name in planted
    }


def written(path):
    """Nodes and their parameters, and the comment."""
    text = path.read_text()
    nodes = {name: each["ros__parameters"] for name, each in yaml.safe_load(text).items()}
    return nodes, text[: text.index("/**")]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_samples(
        tmp_path_factory.mktemp("aircraft") / "flight.mcap", aircraft_samples(1, 70.0)
    )


@pytest.fixture(scope="module")
def found(bag):
    out = bag.with_name("found.yaml")
    return calibrate_aircraft(bag, out), out


@pytest.mark.slow
def test_what_it_finds_is_written_under_the_nodes_names(found):
    result, out = found
    nodes, head = written(out)
    everywhere, ekf = nodes["/**"], nodes["/**/ekf_node"]
    sigma = {name: item["sigma"] for name, item in result["parameters"].items()}
    for k, axis in enumerate(("forward", "left", "up")):
        off_m = everywhere["aircraft.rtk_antenna_m"][k] - ANTENNA_M[k]
        assert abs(off_m) < 4 * sigma[f"antenna_{axis}"]
    first, second = (
        np.array(everywhere[f"aircraft.{name}_antenna_m"]) for name in ("rtk", "second")
    )
    baseline = second - first
    assert np.linalg.norm(baseline) == pytest.approx(1.0, abs=1e-3)
    azimuth_deg = -math.degrees(math.atan2(baseline[1], baseline[0]))
    assert abs(azimuth_deg - AZIMUTH_DEG) < 4 * sigma["baseline_azimuth"] + 0.02
    given = DELAYS_S[0], DELAYS_S[1] - DELAYS_S[0], DELAYS_S[2]
    for key, delay_s in zip(
        ("rtk.delay_s", "rtk.velocity_delay_s", "heading.delay_s"), given, strict=True
    ):
        assert ekf[key] == pytest.approx(delay_s, abs=0.006)  # 4 sigma of 70 s
    assert "imu.delay_s" not in ekf
    assert "1 m is written" in head
    assert "level_pitch" not in verb.describe(result)
    assert "aircraft.imu_rpy_deg" not in everywhere
    assert result["nis"]["rtk_position"]["before"] > 5 > result["nis"]["rtk_position"]["after"]
    assert "aircraft.rtk_antenna_m" in head


@pytest.mark.slow
def test_with_the_receivers_clock_held_the_imus_delay_is_found(bag, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text(
        "/**:\n  ros__parameters:\n    aircraft:\n"
        f"      rtk_antenna_m: {list(ANTENNA_M)}\n/**/ekf_node:\n"
        "  ros__parameters: {rtk.delay_s: 0.1}\n"
    )
    out = tmp_path / "out.yaml"
    hold = ("rtk", "antenna")
    calibrate_aircraft(bag, out, params=params, hold=hold)
    nodes, _ = written(out)
    ekf = nodes["/**/ekf_node"]
    assert "rtk.delay_s" not in ekf
    imu_s = 0.1 - DELAYS_S[0]
    assert ekf["imu.delay_s"] == pytest.approx(imu_s, abs=0.006)
    assert ekf["heading.delay_s"] == pytest.approx(imu_s + DELAYS_S[2], abs=0.006)
    assert set(nodes["/**"]) == {"aircraft.second_antenna_m"}


@pytest.mark.slow
def test_delays_that_are_all_off_by_the_same_are_the_imus(tmp_path):
    """RTK 10 ms early is an IMU that is 10 ms late; its sigma goes with it to later flights."""
    samples = aircraft_samples(2, 120.0, delays_s=(-0.01, -0.01, -0.01))
    bag, out = write_samples(tmp_path / "flight.mcap", samples), tmp_path / "found.yaml"
    calibrate_aircraft(bag, out)
    ekf = written(out)[0]["/**/ekf_node"]
    assert set(ekf) == {"imu.delay_s", "imu.delay_sigma_s"}
    assert ekf["imu.delay_sigma_s"] < 0.0017
    assert abs(ekf["imu.delay_s"] - 0.01) < 3 * ekf["imu.delay_sigma_s"]


@pytest.mark.slow
def test_the_level_is_found_if_asked_no_surer_than_the_autopilot(bag, tmp_path):
    """The IMU is mounted level: what is found is the autopilot's own error, 0.3 deg rms."""
    out = tmp_path / "out.yaml"
    result = calibrate_aircraft(bag, out, level=True)
    own_deg = AutopilotConfig().attitude_sigma_deg
    for name, sigma_deg in zip(("level_roll", "level_pitch"), own_deg[:2], strict=True):
        row = result["parameters"][name]
        assert sigma_deg <= row["sigma"] < 1.2 * sigma_deg
        assert 0.01 < abs(row["found"]) < 3 * row["sigma"]
    nodes, head = written(out)
    assert any(nodes["/**"]["aircraft.imu_rpy_deg"][:2])
    assert "note: aircraft.imu_rpy_deg turns base_link" in head
    assert "calibrate the boresight again" in " ".join(head.split())


@pytest.mark.slow
def test_a_hover_is_refused_with_what_to_fly(tmp_path, capsys):
    samples = aircraft_samples(2, 30.0, **{"route.hover_s": 600.0})
    flight = write_samples(tmp_path / "hover.mcap", samples)
    out = tmp_path / "out.yaml"
    assert command(["calibrate", "aircraft", str(flight), "-o", str(out)]) == 1
    message_text = capsys.readouterr().err
    assert "determines no parameter: antenna_forward (aircraft.rtk_antenna_m)" in message_text
    assert "fly legs in several directions" in message_text
    assert message_text.count("\n") == 1
    assert not out.exists()


def test_a_missing_topic_is_named(tmp_path):
    samples = [s for s in aircraft_samples(2, 10.0) if isinstance(s, ImuSample | HeadingSample)]
    flight = write_samples(tmp_path / "in.mcap", samples)
    with pytest.raises(BagError, match="needed topic absent: /rtk/fix; give --namesp"):
        calibrate_aircraft(flight)
    short = write_samples(tmp_path / "short.mcap", aircraft_samples(2, 10.0))
    with pytest.raises(CalibrationError, match=r"only 10\.0 s of imu/data without a gap"):
        calibrate_aircraft(short)


@pytest.mark.slow
@pytest.mark.long
def test_a_real_walk_shows_velocities_that_are_late(shared, tmp_path):
    """The receiver's velocities are differences over 0.25 s, so they are half of that late."""
    path = shared / "real_flights" / "walk_0827.mcap"
    if not path.exists():
        pytest.skip(f"no {path}")
    result = calibrate_aircraft(path, tmp_path / "out.yaml")
    late = result["parameters"]["velocity_delay"]
    assert late["found"] == pytest.approx(125.0, abs=15.0)
    for source in ("rtk_position", "rtk_velocity"):
        assert 0.5 < result["nis"][source]["after"] < 1.5


@pytest.mark.slow
@pytest.mark.long
def test_a_flight_of_three_minutes(tmp_path):
    """One of the ten that were flown for the figures of docs/calibration.md."""
    result = calibrate_aircraft(write_samples(tmp_path / "1.mcap", aircraft_samples(1)))
    assert set(PARAMETERS) <= set(result["parameters"])
    for name, off in errors(result).items():
        row = result["parameters"][name]
        assert abs(off) <= min(ASKED[row["unit"]], 3 * row["sigma"]), (name, off, row)


def test_several_flights_tell_what_biases_to_expect(tmp_path):
    gyro, accel = np.array([0.0145, -0.008, 0.006]), np.array([0.0, 0.01, 0.05])
    offs = np.random.default_rng(8).standard_normal((3, 3)) * 1e-3  # rad/s, from flight to flight
    flights = []
    for k, off in enumerate(offs):
        planted = {"imu.gyro_bias_rad_s": gyro + off, "imu.accel_bias_m_s2": accel}
        planted = {name: bias.tolist() for name, bias in planted.items()}
        samples = aircraft_samples(1 + k, 25.0, 0.0, (0.0,) * 3, **planted, **TURNS)
        flights.append(write_samples(tmp_path / f"flight_{k}.mcap", samples))
    first, *more = map(str, flights)
    out = tmp_path / "out.yaml"
    held = "antenna,baseline,position_delay,velocity_delay,heading_delay"
    params = tmp_path / "params.yaml"
    params.write_text(f"/**: {{ros__parameters: {{aircraft.rtk_antenna_m: {list(ANTENNA_M)}}}}}")
    words = ["calibrate", "aircraft", first, *more, "-o", str(out), "--params", str(params)]
    assert command([*words, "--hold", held]) == 0
    ekf = written(out)[0]["/**/ekf_node"]
    names = ("bias", "turn_on_bias")
    assert set(ekf) == {f"imu.{kind}_{name}" for kind in ("gyro", "accel") for name in names}
    # A flight of 25 s tells its bias to 3e-4 rad/s, and its accelerometers' to some 0.01 m/s2.
    np.testing.assert_allclose(ekf["imu.gyro_bias"], gyro + offs.mean(axis=0), atol=1e-3)
    assert abs(ekf["imu.accel_bias"][2] - 0.05) < 4 * 0.01
    # Student's factor and the mean's error make 1.4 of the spread, itself good to 1 in sqrt(12).
    assert 0.7e-3 < ekf["imu.gyro_turn_on_bias"] < 3e-3


@pytest.mark.parametrize("number", [2, 3, 6])
def test_the_next_flights_bias_is_within_the_sigma_that_several_tell(number):
    rng = np.random.default_rng(4)
    spread, own = np.array([1e-3, 0.02]), np.diag(np.repeat([1e-5, 1e-4], 3) ** 2)
    ratios = []
    for _ in range(5_000):
        drawn = np.array([0.01, 0.3])[:, None] + spread[:, None] * rng.standard_normal(
            (number + 1, 2, 3)
        )
        flights = [Biases(tuple(gyro), tuple(accel), own) for gyro, accel in drawn[:-1]]
        mean, sigma = expected_biases(flights)
        ratios.append((drawn[-1] - mean) / sigma[:, None])
    # Student's distribution of 3 degrees has no fourth moment: its rms converges slowly.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(ratios), axis=(0, 2))), 1.0, rtol=0.1)
