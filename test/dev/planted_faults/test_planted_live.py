"""Faults on the running graph: named in time, and no green picture that is wrong; ``--live``."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from dev.planted_faults.faults import FAULTS
from dev.planted_faults.live import CLEAN, Live
from dev.planted_faults.planting import FlightFiles
from tirgeo_ros.tools.presentation.progress import silent

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]

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
    return Live(FlightFiles.in_folder(sample), folder).outcome(fault, silent)


def test_nothing_is_said_of_a_good_flight_and_its_places_are_in_their_ellipses(sample, tmp_path):
    found = outcome(CLEAN, sample, tmp_path)
    assert found.is_quiet, found
    assert found.green > 150  # of 20 s at 9 Hz
    assert found.times < 3


@pytest.mark.parametrize(
    "fault", [f for f in FAULTS if f.name in PLAYED], ids=lambda fault: fault.name
)
def test_a_fault_is_named_in_time_and_no_green_picture_is_wrong(fault, sample, tmp_path):
    found = outcome(fault, sample, tmp_path)
    assert found.named is not None, found
    assert found.named.at_s <= found.notice_s <= found.named.at_s + 1.5  # a report and a picture
    assert found.is_good, found
