"""Faults on the running graph: named in time, and no green picture that is wrong; ``--live``."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from tirgeo_ros.tools.planted_faults.faults import FAULTS
from tirgeo_ros.tools.planted_faults.live import CLEAN, Live
from tirgeo_ros.tools.planted_faults.planting import Flight
from tirgeo_ros.tools.progress import silent

pytestmark = pytest.mark.graph

#: Of one node each; what needs motion, and the rest, takes twenty minutes.
QUICK = ("gimbal of another type", "fixes above sea level")
#: Their evidence are turns over five windows of 4 s: see docs/checks.md.
LATE = ("lever arm sign", "RTK 0.6 s late")


def outcome(fault, sample, folder):
    return Live(Flight.in_folder(sample), folder).outcome(fault, silent)


def test_nothing_is_said_of_a_good_flight_and_its_places_are_in_their_ellipses(sample, tmp_path):
    found = outcome(CLEAN, sample, tmp_path)
    assert found.is_quiet, found
    assert found.green > 150  # of 20 s at 9 Hz
    assert found.times < 3


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, marks=[] if fault.name in QUICK else [pytest.mark.slow], id=fault.name)
        for fault in FAULTS
    ],
)
def test_a_fault_is_named_in_time_and_no_green_picture_is_wrong(fault, sample, tmp_path):
    if fault.name.startswith("DEM"):
        pytest.importorskip("rasterio", reason="elevation models need rasterio")
    found = outcome(fault, sample, tmp_path)
    if found.refused:
        assert found.in_time, found
        return
    assert found.named is not None, found
    assert found.named.at_s <= found.notice_s <= found.named.at_s + 1.5  # a report and a picture
    if fault.name not in LATE:
        assert found.is_good, found
