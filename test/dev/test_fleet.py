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
"""Three aircraft side by side over DDS, and what the judge of a fleet counts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from dev.fleet import FleetRun, Outputs, figures, judge, run_fleet
from dev.flights import make_fleet
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import geodetic_from_ecef
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages.cdr import header_stamp_ns

SHIFT_NS = 7_000_000_007


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    return make_fleet(tmp_path_factory.mktemp("fleet"), 2, 5.0)


def perfect(flight) -> Outputs:
    """What a graph without error and loss gives."""
    plane = TangentPlane(*map(float, geodetic_from_ecef(flight.place_e[0])))
    joints = [
        header_stamp_ns(item.data) + SHIFT_NS
        for item in BagReader(flight.bag).messages(["/gimbal/joint_states"])
    ]
    stamps = {
        "tirgeo/odometry": [entry + SHIFT_NS for entry in flight.stamp_ns],
        "tirgeo/camera_pose": joints,
    }
    places = [plane.ned_from_geodetic(*geodetic_from_ecef(place)) for place in flight.place_e]
    return Outputs(stamps, places, plane)


def missed(cores, *judged):
    return [entry.what.strip() for entry in figures(FleetRun(cores, 1.0, judged)) if entry.missed]


def test_nothing_is_lost_or_crossed_where_all_came(flights):
    entry = judge(flights[0], SHIFT_NS, perfect(flights[0]))
    assert (entry.odometry_lost, entry.poses_lost, entry.crossed) == (0, 0, 0)
    assert entry.odometry == entry.imu == 501
    assert entry.off_m < 1e-6
    assert missed(0.2, entry) == []


def test_what_is_lost_is_counted(flights):
    heard = perfect(flights[0])
    for stamps in heard.stamps_ns.values():
        del stamps[10]
    del heard.place_n[10]
    entry = judge(flights[0], SHIFT_NS, heard)
    assert (entry.odometry_lost, entry.poses_lost, entry.crossed) == (1, 1, 0)
    lost = ["without odometry, from the first one on", "without a camera's pose"]
    assert missed(2.1, entry) == [*lost, "nodes"]


def test_another_aircrafts_samples_and_places_are_crossed(flights):
    heard, other = perfect(flights[0]), perfect(flights[1])
    heard.stamps_ns["tirgeo/camera_pose"][20] += 1  # the next aircraft's stamps end so
    heard.place_n[7] = heard.place_n[7] + np.array([200.0, 0.0, 0.0])
    entry = judge(flights[0], SHIFT_NS, heard)
    assert entry.crossed == 2
    assert entry.off_m == pytest.approx(200.0, abs=0.01)
    swapped = dataclasses.replace(other, stamps_ns=heard.stamps_ns)
    assert judge(flights[0], SHIFT_NS, swapped).crossed > 500
    assert missed(0.2, entry) == ["without a camera's pose", "messages crossed"]


@pytest.mark.graph
@pytest.mark.slow
@pytest.mark.long
def test_three_aircraft_lose_and_cross_nothing(tmp_path):
    """At half of real time and with patient gimbals, so that a busy machine has no part in it."""
    flights = make_fleet(tmp_path, 3, 10.0)
    for flight in flights:
        patient = "/*/gimbal_node: {ros__parameters: {max_wait_s: 5.0}}\n"
        flight.params.write_text(flight.params.read_text() + patient)
    run = run_fleet(tmp_path, flights, rate=0.5)
    assert not [figure for figure in figures(run) if figure.missed and figure.what != "nodes"]
    for entry in run.judged:
        assert entry.imu == 1001
        assert entry.odometry > 700
        assert entry.joints > 300
