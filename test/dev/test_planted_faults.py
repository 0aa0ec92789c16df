"""What is read of a fault on the graph, and how it is judged and told."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from overlays import PLANE, pose_at

from dev.planted_faults.faults import FAULTS, Fault, FlightFiles
from dev.planted_faults.live import (
    CLEAN,
    Eye,
    Live,
    Outcome,
    Report,
    times_of_ellipse,
)
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.presentation.progress import silent

STAMP_NS = 1_700_000_000 * 10**9
FAULT = Fault("late", ("rtk.delay_s",), lambda good, _: good)
NAMED = Report(
    8.0,
    "ekf_node",
    Finding("late", Severity.CAUTION, "rtk/fix is late", "ekf_node rtk.delay_s", "set it"),
)


def test_a_fault_is_in_time_from_when_the_data_show_it():
    late = dataclasses.replace(NAMED, at_s=17.5)
    assert Outcome(FAULT, 0.0, NAMED).in_time
    assert not Outcome(FAULT, 0.0, late).in_time
    assert Outcome(FAULT, 7.6, late).in_time
    assert not Outcome(FAULT, 0.0).in_time
    assert Outcome(FAULT, refused="parameter rtk.delay_s: is not a number").in_time
    assert not Outcome(FAULT, refused="ekf_node ended").in_time


def eye(shift_n: np.ndarray) -> Eye:
    """A camera that stands still, so far from its place, on level ground."""
    poses: PoseBuffer[CameraPose] = PoseBuffer(1e9)
    for step in range(21):
        pose = pose_at(STAMP_NS + step * 10**8)
        poses.add(dataclasses.replace(pose, position_n=pose.position_n + shift_n))
    return Eye(poses, PLANE, XT2, PLANE.height_m, OverlayConfig())


def test_an_error_is_told_in_ellipses():
    """On level ground the places move as the camera does; along the major axis 1 is the edge."""
    true, at_ns = eye(np.zeros(3)), STAMP_NS + 10**9  # degrees round by a nanometre
    assert times_of_ellipse(true, true, at_ns) == pytest.approx(
        0, abs=1e-8
    )  # degrees round by a nanometre
    found = true.locate(at_ns, ((XT2.width - 1) / 2, (XT2.height - 1) / 2))
    assert isinstance(found, Located)
    ellipse = found.ellipse
    along = np.array([math.cos(ellipse.azimuth_rad), math.sin(ellipse.azimuth_rad), 0.0])
    wrong = eye(4.0 * ellipse.major_m * along)
    middle = times_of_ellipse(wrong, true, at_ns)
    assert middle >= 4.0 * (1 - 1e-3)  # others may have smaller ellipses that way
    assert math.isnan(times_of_ellipse(wrong, true, at_ns + 10**12))  # no pose, nothing said


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


def outcome(fault, sample, folder):
    pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")
    return Live(FlightFiles.in_folder(sample), folder).outcome(fault, silent)


@pytest.mark.graph
@pytest.mark.slow
@pytest.mark.long
def test_nothing_is_said_of_a_good_flight_and_its_places_are_in_their_ellipses(sample, tmp_path):
    found = outcome(CLEAN, sample, tmp_path)
    assert found.is_quiet, found
    assert found.silent > 150  # of 20 s at 9 Hz
    assert found.times < 3


@pytest.mark.graph
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    "fault", [f for f in FAULTS if f.name in PLAYED], ids=lambda fault: fault.name
)
def test_a_fault_is_named_in_time_and_no_silent_picture_is_wrong(fault, sample, tmp_path):
    found = outcome(fault, sample, tmp_path)
    assert found.named is not None, found
    assert found.is_good, found
