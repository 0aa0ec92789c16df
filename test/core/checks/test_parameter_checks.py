"""Parameters that nobody gave, or gave to another aircraft; calibrations of another size."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.checks.parameter_checks import parameter_findings, size_fault
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
