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
"""What is read of a fault on the graph, and how it is judged and told."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from overlays import PLANE, pose_at

from dev.planted_faults.ellipses import Locator, times_of_ellipse
from dev.planted_faults.faults import FAULTS, Fault, FlightFiles
from dev.planted_faults.live import CLEAN, Outcome, Report, play
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.graph.node_graph import free_domain

STAMP_NS = 1_700_000_000 * 10**9
FAULT = Fault("late", ("rtk.delay_s",), lambda good, _: good)
NAMED = Report(
    8.0,
    "ekf_node",
    Finding("late", Severity.CAUTION, "rtk/fix is late", "ekf_node rtk.delay_s", "set it"),
)


def test_a_fault_is_in_time_from_when_the_data_show_it():
    late = NAMED._replace(at_s=17.5)
    assert Outcome(FAULT, 0.0, NAMED).is_good
    assert not Outcome(FAULT, 0.0, late).is_good
    assert Outcome(FAULT, 7.6, late).is_good
    assert not Outcome(FAULT, 0.0).is_good
    assert Outcome(FAULT, refused="parameter rtk.delay_s: is not a number").is_good
    assert not Outcome(FAULT, refused="ekf_node ended").is_good


def locator(shift_n: np.ndarray) -> Locator:
    """A camera that stands still, so far from its place, on level ground."""
    poses: PoseBuffer[CameraPose] = PoseBuffer(1e9)
    for step in range(21):
        pose = pose_at(STAMP_NS + step * 10**8)
        poses.add(dataclasses.replace(pose, position_n=pose.position_n + shift_n))
    return Locator(poses, PLANE, XT2, PLANE.height_m, OverlayConfig())


def test_an_error_is_told_in_ellipses():
    """On level ground the places move as the camera does; along the major axis 1 is the edge."""
    true, at_ns = locator(np.zeros(3)), STAMP_NS + 10**9
    # Degrees round by a nanometre.
    assert times_of_ellipse(true, true, at_ns, at_ns) == pytest.approx(0, abs=1e-8)
    result = true.locate(at_ns, ((XT2.width - 1) / 2, (XT2.height - 1) / 2))
    assert isinstance(result, Located)
    ellipse = result.ellipse
    along = np.array([math.cos(ellipse.azimuth_rad), math.sin(ellipse.azimuth_rad), 0.0])
    wrong = locator(4.0 * ellipse.major_m * along)
    # Others may have smaller ellipses that way.
    assert times_of_ellipse(wrong, true, at_ns, at_ns) >= 4.0 * (1 - 1e-3)
    late_ns = at_ns + 10**12  # no pose, nothing said
    assert math.isnan(times_of_ellipse(wrong, true, late_ns, late_ns))


#: Each takes a flight of half a minute. The others are ``--live``'s, and ``check``'s in
#: ``test_planted_faults``: of each node, and of each kind of evidence, one is enough here.
PLAYED = (
    "gimbal of another type",
    "fixes above sea level",
    "wrong K",
    "UTM zone",
    "no params",
    "lever arm sign",
    "RTK 0.6 s late",
)


@pytest.mark.graph
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    "fault",
    [CLEAN, *(f for f in FAULTS if f.name in PLAYED)],
    ids=lambda fault: fault.name,
)
def test_a_fault_is_named_in_time_and_nothing_is_said_of_a_good_flight(fault, sample, tmp_path):
    pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")
    result = play(fault, FlightFiles.in_folder(sample), tmp_path, free_domain())
    assert result.is_good, result
    assert bool(result.named) == bool(fault.names)
