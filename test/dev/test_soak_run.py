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
"""A short soak of the real graph, and how the witness sees lines."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from overlays import GREY, LATENCY, MS, START, WAIT, pose_at, ready, status

from dev.flights import SOAK_SCENARIO, make_soak_flight
from dev.nodes.soak_witness import line_pixels
from dev.soak.__main__ import soak
from dev.soak.run import RATE, Event, Kind, schedule
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.simulate.scenario import Scenario


def drawn(variance, state=None):
    """The picture of an overlay with poses of a variance, or of 0 without poses."""
    overlay = ready()
    if state is not None:
        overlay.status = status(state, "rtk/fix is missing for reasons of its own")
    overlay.add_frame(START, GREY, START)
    for before_ms in (100, 0) if variance else ():
        pose = pose_at(START - LATENCY - before_ms * MS)
        overlay.poses.add(dataclasses.replace(pose, covariance=np.eye(6) * variance))
    result = overlay.take(START + 3 * WAIT)
    assert bool(result.notice) is not bool(variance)
    return result.image


@pytest.mark.parametrize("variance", [1e-6, 1e-3, 1.0])
def test_lines_are_seen_faded_ones_too(variance):
    assert line_pixels(drawn(variance)) > 400


@pytest.mark.parametrize("state", [None, *FilterState])
def test_a_notice_is_no_line(state):
    assert line_pixels(drawn(0, state)) == 0


def test_lives_are_run_in_with_full_queues():
    """Else a longer stop later takes memory: the most that ever waits is a mark reached once."""
    profile = find_resource("config/fastdds.xml").read_text()
    healthy_s = int(re.search(r"<healthy_check_timeout_ms>(\d+)<", profile)[1]) / 1000
    run_in = [e for e in schedule(1, 600.0) if e.at_s < 60.0 and e.kind is Kind.STOP]
    assert {e.node for e in run_in} == {"ekf_node", "gimbal_node", "overlay_node"}
    for event in run_in:
        assert event.lasts_s * RATE * Scenario().imu.rate_hz > STREAM_DEPTH
        assert event.lasts_s < healthy_s


@pytest.mark.graph
@pytest.mark.slow
@pytest.mark.long
def test_a_short_soak_misses_nothing(tmp_path):
    """Twenty seconds: two stops, a jump of the clock, a kill; of memory it cannot tell."""
    few = tmp_path / "few_pictures.yaml"
    few.write_text(
        find_resource(SOAK_SCENARIO).read_text().replace("rate_hz: 10.0", "rate_hz: 2.5")
    )
    flight = make_soak_flight(tmp_path / "flight", scenario=few)
    events = [
        Event(2.0, Kind.STOP, "gimbal_node", 0.5),
        Event(4.0, Kind.JUMP),
        Event(6.0, Kind.KILL, "overlay_node", 0.5),
        Event(9.0, Kind.STOP, "ekf_node", 1.0),
    ]
    figures = soak(flight, tmp_path / "soak", 20.0, events)
    assert not [figure for figure in figures if figure.missed]
    value = {figure.what.strip(): figure.value for figure in figures}
    assert value["frames sent"] > 60
    assert value["pictures with lines"] > 20
    assert value["camera poses"] > 200
    assert (tmp_path / "soak" / "soak.json").is_file()
