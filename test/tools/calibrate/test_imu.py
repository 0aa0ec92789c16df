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
"""``tirgeo calibrate imu`` over bags: what it measures, writes, warns of and refuses."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from imu_noise import (
    FLIGHT_DENSITY as DENSITY,
    FLIGHT_HZ as RATE_HZ,
    START_NS,
    flown,
    imu_bag,
    white,
)

from dev.real_flights import fly_bag, hidden_fixes, samples_of
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.types.errors import BagError, CalibrationError, ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.calibrate.imu import calibrate_imu
from tirgeo_ros.tools.cli import main as command

DEFAULTS = np.array([*EkfConfig().imu.angle_random_walk, *EkfConfig().imu.velocity_random_walk])
SHARES = np.repeat(
    [EkfConfig().imu.gyro_vibration_share, EkfConfig().imu.accel_vibration_share], 3
)
# The calmest tenth of pieces whose floor is known to 4 % each is 1.28 of these below the median.
LOW = 1 - 1.28 * 0.04


def at_rest(seed, duration_s):
    rng = np.random.default_rng(seed)
    values = white(rng, (duration_s * RATE_HZ, 6), np.repeat([1.7e-4, 1.3e-2], 3), 1 / RATE_HZ)
    values[:, 5] += 9.8
    return values


def column(result, name):
    return [axis[name] for axis in result["axes"]]


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    values = flown()
    values[:, 3] += 2.0 * np.sin(2 * np.pi * 61.3 * np.arange(len(values)) / RATE_HZ)
    return imu_bag(tmp_path_factory.mktemp("imu") / "flight.mcap", values)


@pytest.fixture(scope="module")
def found(flight):
    return flight.parent, calibrate_imu(flight, flight.with_name("imu.yaml"))


def test_the_densities_of_a_flight_are_found(found):
    _, result = found
    # 4 sigma of a median over 30 pieces of which each is known to 4 %.
    np.testing.assert_allclose(column(result, "density"), DENSITY, rtol=4 * 0.04 * 1.25 / 30**0.5)
    # The 10th percentile of 30 is itself known to 0.3 of a piece's sigma; 4 of these.
    np.testing.assert_allclose(column(result, "density_low"), LOW * DENSITY, rtol=4 * 0.3 * 0.04)
    np.testing.assert_allclose(column(result, "configured"), DEFAULTS)
    (line,) = result["axes"][3]["lines"]
    assert line["frequency_hz"] == pytest.approx(61.3, abs=0.2)
    assert line["amplitude"] == pytest.approx(2.0, rel=0.02)
    gain = (2 * math.sin(math.pi * 61.3 / RATE_HZ)) ** 4
    both = math.sqrt(0.11**2 + 2.0**2 / 2 * gain / RATE_HZ / 6)
    assert result["axes"][3]["second_difference"] == pytest.approx(both, rel=0.03)
    assert (result["flying_s"], result["resting_s"], result["warning"]) == (90, 0, None)


def test_ekf_node_accepts_the_written_file_as_a_floor(found):
    folder, result = found
    imu = ParameterFile(folder / "imu.yaml").config("ekf_node", EkfConfig).imu
    written = [*imu.angle_random_walk, *imu.velocity_random_walk]
    np.testing.assert_allclose(written, column(result, "written"), rtol=1e-8)
    # What the filter follows by itself in the calmest tenth, where that is less than the floor
    # between the lines; 4 sigma as above.
    np.testing.assert_allclose(written[:3], SHARES[:3] * LOW * DENSITY[:3], rtol=0.05)
    np.testing.assert_allclose(written[4:], SHARES[4:] * LOW * DENSITY[4:], rtol=0.05)
    assert written[3] < DENSITY[3]  # the line is not in it
    head = (folder / "imu.yaml").read_text()
    assert head.startswith("# Noise of the IMU in flight, flight.mcap: 90 s at 200.00 Hz")
    assert "lines: Hz (amplitude)" in head
    assert (folder / "imu.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_never_less_than_configured(tmp_path):
    quiet = imu_bag(tmp_path / "a.mcap", flown(2, 30, 0.1 * DEFAULTS))
    assert column(calibrate_imu(quiet), "written") == DEFAULTS.tolist()
    params = tmp_path / "given.yaml"
    params.write_text(
        "/**/ekf_node:\n  ros__parameters:\n    imu:\n"
        "      angle_random_walk: [1.0e-5, 1.0e-5, 1.0e-5]\n"
        "      velocity_random_walk: [0.5, 0.5, 0.5]\n"
        "      gyro_vibration_share: 0.0\n"
    )
    result = calibrate_imu(imu_bag(tmp_path / "b.mcap", flown(3, 30)), params=params)
    assert column(result, "written")[3:] == [0.5] * 3
    # Where the filter follows nothing by itself it is the low density as it is.
    assert column(result, "written")[:3] == column(result, "density_low")[:3]
    params.write_text("/**/ekf_node:\n  ros__parameters:\n    imu.noise: 1.0\n")
    with pytest.raises(ConfigError, match=r"given\.yaml"):
        calibrate_imu(tmp_path / "b.mcap", params=params)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["imu", "allan"])
def test_the_commands_print_a_table_or_json(what, tmp_path, capsys):
    bag = imu_bag(tmp_path / "a.mcap", flown() if what == "imu" else at_rest(3, 90))
    words = ["calibrate", what, str(bag), "-o", str(tmp_path / "i.yaml")]
    assert command.main(words) == 0
    assert "18000 samples of /imu/data" in capsys.readouterr().out
    assert command.main([*words, "--json", "--to", "80"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["output"] == [str(tmp_path / "i.yaml"), str(tmp_path / "i.png")]
    assert result["axes"][4]["axis"] == "accel y"


def test_lost_samples_are_warned_of(tmp_path):
    values = flown(5, 60)
    keep = np.random.default_rng(6).random(len(values)) > 0.015
    stamps = START_NS + np.arange(len(values), dtype=np.int64) * (1_000_000_000 // RATE_HZ)
    result = calibrate_imu(imu_bag(tmp_path / "a.mcap", values[keep], stamps_ns=stamps[keep]))
    assert f"{(~keep)[:-1].sum()} samples are missing" in result["warning"]


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (flown(7, 15), "record of 15 s is too short; 20 s of flight are needed"),
        (at_rest(7, 60), r"lies still for 60 of 60 s: no flight; use tirgeo calibrate allan"),
        (flown(7, 30) * [1, 0, 1, 1, 1, 1], "gyro y: never changes"),
    ],
)
def test_refusals(values, reason, tmp_path):
    bag = imu_bag(tmp_path / "a.mcap", values)
    with pytest.raises(CalibrationError, match=rf"a\.mcap: /imu/data: .*{reason}") as refused:
        calibrate_imu(bag, tmp_path / "imu.yaml")
    assert "\n" not in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_stamps_beyond_use_are_refused(tmp_path):
    values = flown(8, 40)
    numbers = np.arange(len(values), dtype=np.int64)
    rng = np.random.default_rng(8)
    shaken = numbers * 5_000_000 + np.sort(rng.integers(0, 200_000_000, len(values)) % 4_900_000)
    bursts = numbers // 20 * 100_000_000 + numbers % 20 * 100_000
    slow = numbers * 40_000_000
    lossy = np.sort(rng.choice(len(values) * 2, len(values), replace=False)) * 5_000_000
    for stamps, reason in (
        (bursts, "stamps jitter by"),
        (lossy, "missing or not finite"),
        (slow, "25 samples a second are too few above 8 Hz"),
    ):
        bag = imu_bag(tmp_path / "a.mcap", values, stamps_ns=START_NS + stamps)
        with pytest.raises(CalibrationError, match=reason):
            calibrate_imu(bag)
    assert (
        calibrate_imu(imu_bag(tmp_path / "a.mcap", values, stamps_ns=START_NS + shaken))[
            "flying_s"
        ]
        > 30
    )
    with pytest.raises(BagError, match="is absent"):
        calibrate_imu(tmp_path / "a.mcap", namespace="uav1")


P4 = [f"p4rtk_horizontal_{n}.mcap" for n in ("03", "06", "09", "15", "18", "24")]


def test_real_flights_are_as_measured_elsewhere(shared):
    """The table beside the bags: medians over its seven horizontal flights, six of them here."""
    flights = shared / "real_flights"
    medians = [column(calibrate_imu(flights / name), "density") for name in P4]
    table = [3.0e-3, 5.8e-3, 1.5e-3, 0.118, 0.068, 0.392]
    np.testing.assert_allclose(np.median(medians, axis=0), table, rtol=0.12)


def test_steps_of_a_walker_do_not_count_as_noise(shared):
    result = calibrate_imu(shared / "real_flights" / "walk_0827.mcap")
    table = [1.5e-3, 1.4e-3, 3.5e-4, 0.005, 0.006, 0.011]
    # Gaits differ: the table is of the mean power, which is up to a quarter more than usual.
    np.testing.assert_allclose(column(result, "density"), table, rtol=0.3)
    assert result["resting_s"] == 21  # the first 15 s and pauses
    assert max(column(result, "density_at_rest")[3:]) < 0.1 * 0.005


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["p4rtk_horizontal_09", "p4rtk_horizontal_24_differenced_velocity", "walk_0827"]
)
@pytest.mark.long
def test_the_written_parameters_make_no_flight_worse(name, shared, tmp_path):
    bag = shared / "real_flights" / f"{name}.mcap"
    calibrate_imu(bag, tmp_path / "imu.yaml")
    samples = samples_of(bag)
    method = config_from(EkfConfig, {"method": "ekf"})
    written = ParameterFile(tmp_path / "imu.yaml").config("ekf_node", EkfConfig).imu
    configs = (method, replace(method, imu=written))
    before, after = (fly_bag(config, samples) for config in configs)
    # The share of fixes used may change by two fixes, the error after 5 s without them by a tenth.
    assert after.used >= before.used - 2
    cuts = [[misses[-1] for misses in hidden_fixes(item, samples)] for item in configs]
    errors_m = [np.median([cut.error_m for cut in some]) for some in cuts]
    assert errors_m[1] <= 1.1 * errors_m[0]
    assert sum(cut.within(3) for cut in cuts[1]) >= sum(cut.within(3) for cut in cuts[0])


def test_densities_are_never_below_the_noise_at_rest(tmp_path):
    """A sensor that is noisier than configured shows this at rest."""
    rest = at_rest(9, 30) + 5 * (at_rest(10, 30) - [0, 0, 0, 0, 0, 9.8])
    rest[:, 3:] = at_rest(11, 30)[:, 3:]
    result = calibrate_imu(imu_bag(tmp_path / "a.mcap", np.concatenate([rest, flown(9, 30)])))
    # 10 pieces of 4 %: 4 sigma.
    gyro = 1.7e-4 * math.sqrt(1 + 5**2)
    assert column(result, "written")[2] == pytest.approx(gyro, rel=4 * 0.04 * 1.25 / 10**0.5)
    assert column(result, "written")[:3] == pytest.approx(
        [max(gyro, 0.3 * LOW * n) for n in DENSITY[:3]], rel=0.1
    )
