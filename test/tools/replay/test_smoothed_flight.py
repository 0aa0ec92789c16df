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
"""--smooth over the sample flight: the same outputs and verdicts, with smoothed poses."""

from __future__ import annotations

import numpy as np
import pytest
from process_bags import messages_of

from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.evaluate.evaluate import evaluate
from tirgeo_ros.tools.evaluate.report import summary
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.locate import locate_pixels
from tirgeo_ros.tools.replay.process import process


def test_only_poses_differ_and_they_are_more_certain(nine_s, params, tmp_path):
    given = {"params": params, "images": False}
    both = {
        name: process(nine_s, tmp_path / f"{name}.mcap", **given, smooth=name == "smoother")
        for name in ("filter", "smoother")
    }
    assert [item["smoothed"] for item in both.values()] == [False, True]
    for key in ("written", "verdicts", "states_s", "read", "gimbal", "state"):
        assert both["smoother"][key] == both["filter"][key]
    of_filter, of_smoother = (
        [message for _, message in messages_of(tmp_path / f"{name}.mcap", "/tirgeo/odometry")]
        for name in both
    )
    stamps = [m.header.stamp for m in of_filter]
    assert [m.header.stamp for m in of_smoother] == stamps
    middle = slice(len(stamps) // 4, len(stamps) // 2)
    variances = [
        np.mean([m.pose.covariance.reshape(6, 6).diagonal() for m in result[middle]], axis=0)
        for result in (of_filter, of_smoother)
    ]
    assert (variances[1] < 0.8 * variances[0]).all()


@pytest.mark.parametrize("method", ["raw", "rtk"])
def test_a_method_without_filter_is_refused_in_one_line(nine_s, sample, tmp_path, capsys, method):
    out = tmp_path / "out.mcap"
    args = ["process", nine_s, "-o", out, "--params", sample / "params.yaml", "--no-images"]
    assert main([str(item) for item in (*args, "--method", method, "--smooth")]) == 1
    expected = (
        f"tirgeo process: method {method} has no filter to smooth: choose ekf or ekf_heading, or "
        "do not smooth\n"
    )
    assert capsys.readouterr().err == expected
    assert not out.exists()


def test_progress_covers_both_passes(nine_s):
    shares = []
    flight = Flight(BagReader(nine_s), needs_camera=False)
    flight.registered(EkfConfig(), GimbalConfig(), [], smooth=True)
    flight.read_all(lambda done, total: shares.append(done / total))
    assert shares == sorted(shares)
    assert shares[0] < 0.05
    assert shares[-1] == pytest.approx(1.0)


@pytest.mark.slow
def test_every_verb_has_the_option(sample, tmp_path):
    flight, params = sample / "flight.mcap", sample / "params.yaml"
    points = sample / "survey.geojson", sample / "observations.csv"
    out, options = tmp_path / "points.geojson", {"params": params, "smooth": True}
    assert locate_pixels(flight, points[1], out, **options)["smoothed"]
    with pytest.raises(ConfigError, match="method rtk has no filter to smooth"):
        locate_pixels(flight, points[1], out, method="rtk", **options)
    result = summary(evaluate(flight, *points, **options))
    assert result["smoothed"]
    assert any(note.startswith("raw and rtk are not smoothed") for note in result["notes"])
    usual = [flight, "--survey", points[0], "--observations", points[1], "--params", params]
    args = ("calibrate", "boresight", *usual, "-o", tmp_path / "boresight.yaml", "--smooth")
    assert main([str(item) for item in args]) == 0
