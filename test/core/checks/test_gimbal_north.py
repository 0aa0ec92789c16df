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
"""A gimbal whose north is far off is named, with the parameter that mends it."""

import re

import numpy as np
import pytest
from stills import strip

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.stills import read_stills


def found(samples, bias_deg=0.0, *, alone=True):
    """The finding on the north, or None."""
    checks = GimbalChecks(config_from(GimbalConfig, {"north.bias_deg": bias_deg}), None)
    for sample in samples:
        if isinstance(sample, ImuSample):
            checks.autopilot(sample.stamp_ns, sample.autopilot_q_nb)
            if alone:
                checks.autopilot_alone(sample.stamp_ns, sample.autopilot_q_nb)
        elif isinstance(sample, CameraAttitudeSample):
            checks.reported(sample)
    return next((each for each in checks.findings() if each.check == "gimbal_north"), None)


def result(stills, bias_deg=0.0, *, order=1, alone=True):
    """The finding on the samples of stills, each still's in this order."""
    samples = [sample for still in stills for sample in still.samples()[::order]]
    return found(samples, bias_deg, alone=alone)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("aside_deg", [-52.6, 178.0, 25.0])
def test_the_bias_is_that_to_be_set(aside_deg, order):
    """Of stills straight down, with a roll of 0 and of 180, and oblique ones."""
    named = result(strip(aside_deg=aside_deg), order=order)
    assert named.severity is Severity.STOP
    assert "gimbal_node north.bias_deg" in named.parameter
    bias_deg = float(re.search(r"set it to ([-+.\d]+)", named.mend)[1])
    # the noise of the nose is 1 deg: the median of 12 is known to 0.36 deg
    assert abs((bias_deg - aside_deg + 180) % 360 - 180) < 1.1
    assert result(strip(aside_deg=aside_deg), bias_deg, order=order) is None


def test_a_camera_that_looks_aside_and_ahead_is_a_caution():
    stills = [s._replace(gimbal_deg=(s.flight_deg[0] + 60, -20, 0)) for s in strip()]
    assert result(stills).severity is Severity.CAUTION


def test_no_false_alarms():
    assert result(strip(aside_deg=15.0)) is None
    assert result(strip(aside_deg=60.0)[:7]) is None  # too few
    assert result(strip(aside_deg=60.0), alone=False) is None  # an aircraft with an IMU
    turning = [
        s._replace(gimbal_deg=(s.flight_deg[0] + turn, -45.0, 0.0))
        for s, turn in zip(strip(), np.linspace(-170, 170, 12), strict=True)
    ]
    assert result(turning) is None


@pytest.mark.parametrize(("name", "bias_deg"), [("m2ea_strip", -52.6), ("h20t_strip", None)])
def test_real_stills(shared, name, bias_deg):
    folder = shared / "real_pictures" / name
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    options = LogOptions(0.0, takeoff_height_m=0.0, height="takeoff", utc_offset_s=0)
    named = found(read_stills(folder, options).samples)
    assert (named is None) is (bias_deg is None)
    if named is not None:
        assert f"{bias_deg:+.1f} deg aside" in named.evidence
        assert named.severity is Severity.STOP
