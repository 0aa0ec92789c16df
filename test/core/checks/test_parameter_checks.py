"""Parameters that nobody gave, or gave to another aircraft; calibrations of another size."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.checks.parameter_checks import lens_findings, parameter_findings, size_fault
from tirgeo_ros.core.types.finding import Severity


@pytest.mark.parametrize(
    ("given", "pictures", "checks"),
    [
        ((), True, ["no_parameters"]),
        (("ground_height_m", "camera", "method"), True, ["no_parameters"]),
        (("aircraft.rtk_antenna_m",), True, []),
        ((), False, []),
    ],
)
def test_no_parameters_matter_where_there_is_a_picture(given, pictures, checks):
    found = parameter_findings(given, (), "", pictures=pictures)
    assert [one.check for one in found] == checks
    for one in found:
        assert (one.severity, one.parameter) == (Severity.CAUTION, "--params")
        assert ("ground" in one.evidence) == ("ground_height_m" not in given)


def test_sections_of_another_aircraft():
    (finding,) = parameter_findings(("method",), ("/uav1/ekf_node",), "/uav2/", pictures=False)
    assert finding.check == "parameters_elsewhere"
    assert finding.evidence.endswith("(/uav2): /uav1/ekf_node")


def test_sizes():
    assert size_fault(XT2, 640, 512) == ""
    assert size_fault(XT2, 336, 256) == (
        "the calibration is of 640x512 pixels and the pictures have 336x256"
    )


BOSON = Camera(640, 512, 770.0, 770.0, 319.5, 255.5)
WIDE = Camera(1280, 1024, 700.0, 702.0, 640.0, 512.0, (-0.3, 0.1, 0.0, 0.0))


def checks_of(camera):
    return [finding.check for finding in lens_findings(camera, "thermal/camera_info")]


@pytest.mark.parametrize("camera", [XT2, BOSON, WIDE])
def test_good_lenses_say_nothing(camera):
    assert checks_of(camera) == []
    assert lens_findings(camera, "", (camera.width, camera.height)) == []


@pytest.mark.parametrize(
    ("changes", "check"),
    [
        ({"cx": 420.0}, "principal_point"),
        ({"cy": 150.0}, "principal_point"),
        ({"fx": 10000.0, "fy": 10000.0}, "field_of_view"),
        ({"fx": 150.0, "fy": 150.0}, "field_of_view"),
    ],
)
def test_what_cannot_be_is_told(changes, check):
    assert checks_of(replace(BOSON, **changes)) == [check]


def test_a_matrix_of_pictures_twice_as_large_stops():
    twice = replace(BOSON, fx=2 * BOSON.fx, fy=2 * BOSON.fy, cx=2 * BOSON.cx, cy=2 * BOSON.cy)
    [found] = lens_findings(twice, "")
    assert (found.check, found.severity) == ("principal_point", Severity.STOP)
