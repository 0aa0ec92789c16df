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
"""``tirgeo calibrate allan`` over bags: what it writes, and what it warns of and refuses."""

from __future__ import annotations

import re

import numpy as np
import pytest
from imu_noise import gauss_markov, imu_bag, white

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.calibrate.allan import calibrate_allan

RATE_HZ = 50
SIZE = 30_000  # 10 min
WALKS = np.array([1.7e-4, 1.9e-4, 1.6e-4, 1.3e-2, 1.4e-2, 1.2e-2])
BIAS, BIAS_TIME_S = 3e-4, 20.0


def record(seed=1, size=SIZE):
    rng = np.random.default_rng(seed)
    values = white(rng, (size, 6), WALKS, 1 / RATE_HZ)
    values[:, 2] += gauss_markov(rng, size, BIAS, BIAS_TIME_S, 1 / RATE_HZ)
    values[:, 5] += 9.8
    return values


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    return imu_bag(tmp_path_factory.mktemp("allan") / "still.mcap", record(), RATE_HZ)


@pytest.fixture(scope="module")
def found(still):
    return still.parent, calibrate_allan(still, still.with_name("imu.yaml"))


@pytest.mark.slow
def test_ekf_node_accepts_the_written_file(found):
    folder, result = found
    imu = ParameterFile(folder / "imu.yaml").config("ekf_node", EkfConfig).imu
    # 10 min tell N to 0.6 %; the bias of gyro z, 15 times twice its correlation time, to a fifth.
    assert imu.angle_random_walk == pytest.approx(WALKS[:3], rel=0.03)
    assert imu.velocity_random_walk == pytest.approx(WALKS[3:], rel=0.03)
    assert imu.gyro_bias_instability[2] == pytest.approx(BIAS, rel=0.4)
    assert imu.gyro_bias_time_s[2] == pytest.approx(BIAS_TIME_S, rel=0.6)
    assert imu.gyro_bias_instability[0] < BIAS
    assert result["parameters"]["imu.gyro_bias_time_s"] == pytest.approx(imu.gyro_bias_time_s)
    head = (folder / "imu.yaml").read_text()
    assert head.startswith("# Noise of the IMU in still.mcap: 0.17 h at 50.00 Hz")
    assert "B: flicker floor / 0.664" in head
    assert (folder / "imu.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    """Turned by 0.5 rad/s for 4 s and laid down askew."""
    values = record(3)
    values[25_000:25_200, :3] += 0.5
    values[25_000:, 3] += 0.8
    return imu_bag(tmp_path_factory.mktemp("allan") / "lifted.mcap", values, RATE_HZ)


@pytest.mark.slow
@pytest.mark.long
def test_someone_lifts_the_drone(lifted, tmp_path):
    out = tmp_path / "imu.yaml"
    with pytest.raises(CalibrationError, match=r"lifted.mcap: the IMU moved .* --from 0 --to 499"):
        calibrate_allan(lifted, out)
    with pytest.raises(CalibrationError, match=r"moved at 499-505 s.* --from 50 --to 499"):
        calibrate_allan(lifted, out, from_s=50.0)
    assert list(tmp_path.iterdir()) == []
    calibrate_allan(lifted, out, to_s=499.0)


@pytest.mark.slow
@pytest.mark.long
def test_the_imu_warms_up(tmp_path):
    values, numbers = record(4), np.arange(SIZE)
    values[:, 0] += 2e-6 / RATE_HZ * numbers
    result = calibrate_allan(imu_bag(tmp_path / "a.mcap", values, RATE_HZ), tmp_path / "imu.yaml")
    assert re.search(r"gyro x by 0\.0012 rad/s: drifts steadily", result["warning"])
    assert result["axes"][0]["random_walk"] == pytest.approx(1.7e-4, rel=0.03)


@pytest.mark.slow
def test_refusals(still, tmp_path):
    out = tmp_path / "imu.yaml"
    with pytest.raises(BagError, match=r"/imu/raw is absent; topics of .*: /imu/data; give"):
        calibrate_allan(still, out, topic="imu/raw")
    with pytest.raises(CalibrationError, match=r"none of .* has a sample between .*; check"):
        calibrate_allan(still, out, from_s=1e6)
    with pytest.raises(CalibrationError, match="40 s without a gap are too short"):
        calibrate_allan(still, out, to_s=40.0)
    with pytest.raises(CalibrationError, match=r"absent/imu\.yaml: cannot be written: No such"):
        calibrate_allan(still, tmp_path / "absent/imu.yaml")
    assert list(tmp_path.iterdir()) == []
