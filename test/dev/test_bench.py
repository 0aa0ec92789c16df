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
"""What make bench says of filter, smoother, DJI's bytes and DDS; its rivals fly well."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from dev.bench import dji as bench_dji, filters
from dev.bench.graph import times_of
from dev.bench.pyins import pyins_is_installed, pyins_run
from dev.flight_errors import fitting_config, navigation_samples, published
from dev.judging import Figure
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from


def test_without_pyins_the_filter_is_measured_alone(monkeypatch):
    monkeypatch.setattr(filters, "_RUNS", 1)
    monkeypatch.setattr(filters, "_SEEDS", (3,))
    monkeypatch.setattr(filters, "_FLIGHT_S", 32.0)
    monkeypatch.setattr(filters, "pyins_is_installed", lambda: False)
    cost, filtered, smoothed = filters.filter_figures()
    assert 1 < cost.value < 1e4  # us per sample, not per flight
    assert 0 < smoothed.value < 0.3 > filtered.value > 0  # 0.07 deg rms, over 2 s only


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(not pyins_is_installed(), reason="pyins is not installed: make bench does")
def test_pyins_is_given_what_it_needs_to_be_good():
    """What a cost is worth depends on the accuracy: 0.12 deg and 2 cm, as the filter's own."""
    flight = fly(scenario_from({"duration_s": 40.0}), 3)
    config = fitting_config(flight)
    start = published(Navigation(config), navigation_samples(flight))[0]
    rival = pyins_run(flight, config, start)
    result = rival.run()
    late = rival.errors(result).after(20.0)
    assert len(late.t_s) == 2000
    assert np.degrees(rms(late.rpy)).max() < 0.12
    assert rms(late.state[:, :3]).max() < 0.02
    inner, found = rival.smoothed_errors(result), rival.errors(result)
    times = [(every.t_s > 15) & (every.t_s < 30) for every in (inner, found)]
    better = rms(inner.rpy[times[0]]) / rms(found.rpy[times[1]])
    assert better.max() < 0.9  # a smoother that goes wrong is no better


@pytest.mark.slow
@pytest.mark.long
def test_the_cost_of_an_hour_is_that_of_its_passes():
    cost = filters.hour_cost(2)
    assert 1e6 < cost.peak_bytes < 1e9
    assert cost.ratio > 1.0  # the second pass alone is the filter and more
    assert cost.backward_s > 0


@pytest.fixture(scope="module")
def frames():
    return list(bench_dji.capture(2))


def test_the_capture_is_what_an_aircraft_sends(frames):
    reader = FrameReader()
    result = reader.feed(b"".join(frames))
    assert reader.counts["skipped_bytes"] == reader.buffered == 0
    kinds = Counter((f.cmd_id, f.value[0] if f.cmd_id == 5 else None) for f in result)
    # Broadcasts, and the five usual packages, two seconds of each.
    rates_hz = {None: 100, 0: 5, 1: 50, 2: 100, 3: 400, 4: 200}
    assert {package: count / 2 for (_, package), count in kinds.items()} == rates_hz
    # It must fit the line that it stands for: 92160 bytes a second at 921600 baud.
    assert 0.75 < sum(map(len, frames)) / (2 * 92160) < 0.85


@pytest.mark.parametrize("read", [1, bench_dji.PORT_READ, bench_dji.FILE_READ])
def test_all_of_it_is_decoded(frames, read):
    assert bench_dji.decode(b"".join(frames), read) == len(frames) == 1710


START, FRAME, MS = 1_700_000_000_000_000_000, 33_333_333, 1_000_000
SENT = [START + k * FRAME for k in range(420)]
#: Those after the first five seconds, and a stamp is sent later than the fifth second's end.
COUNTED = [stamp for stamp in SENT if stamp > START + 5_000_000_000]


def run(shown, *, lines=True):
    arrivals = [[stamp, stamp + age] for stamp, age in shown]
    return times_of({"sent": SENT}, {"arrivals": {"image": arrivals}, "lines": lines}, 1.8)


def test_settled_frames_alone_count_and_those_without_a_picture_are_lost():
    early = [[stamp, 900 * MS] for stamp in SENT[:100]]
    strange = [[START - FRAME, 5_000 * MS], [COUNTED[-1] + FRAME, 5_000 * MS]]
    shown = [[stamp, (5 + k % 11) * MS] for k, stamp in enumerate(COUNTED[::2])]
    result = run([*strange, *early, *shown])
    assert (result.sent, result.lost) == (len(COUNTED), len(COUNTED) // 2) == (269, 134)
    assert result.p50_s == pytest.approx(10e-3)
    assert result.p95_s == pytest.approx(15e-3)
    assert result.cpu_s == pytest.approx(1.8 / 420)


@pytest.mark.parametrize(
    ("shown", "lines", "message"),
    [
        ([[stamp, MS] for stamp in SENT], False, "no picture with lines"),
        ([], True, "overlay_node gave next to no pictures"),
    ],
)
def test_a_run_that_measured_nothing_is_an_error(shown, lines, message):
    with pytest.raises(GraphError, match=message):
        run(shown, lines=lines)


@pytest.mark.parametrize(
    ("value", "wanted", "expected"),
    [
        (1.71, ">= 1.7", False),
        (1.69, ">= 1.7", True),
        (0.0, "= 0", False),
        (1.0, "= 0", True),
        (math.nan, "<= 4", True),
        (5.0, "about 0", False),
        (5.0, "", False),
    ],
)
def test_what_is_missed(value, wanted, expected):
    assert Figure("a figure", value, "", wanted).missed == expected
