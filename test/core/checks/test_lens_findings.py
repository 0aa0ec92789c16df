"""Lenses that cannot be, and those that fly."""

from dataclasses import replace

import pytest

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.checks.lens_findings import lens_findings

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
