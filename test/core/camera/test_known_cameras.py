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
"""Known cameras: focal lengths against fields of view, sizes and zoom."""

from __future__ import annotations

import math
import re

import pytest

from tirgeo_ros.core.camera.known_cameras import DATA_SHEETS, XT2, camera_of


@pytest.mark.parametrize(
    "sheet", DATA_SHEETS, ids=lambda sheet: f"{sheet.models[0]} {sheet.source}"
)
def test_each_focal_length_agrees_with_its_field_of_view(sheet):
    """It lies between that of a lens without distortion and one with angles as distances.

    A data sheet rounds to a degree, and an equivalent focal length to a millimetre (1.5 deg).
    """
    seen_deg = float(re.search(r"([\d.]+)(?: x \d+)? deg", sheet.source)[1])
    edge_px = math.hypot(*sheet.size) if "DFOV" in sheet.source else sheet.size[0]
    slope = edge_px / 2 * sheet.pixel_um / 1e3 / sheet.focal_mm
    straight, proportional = math.degrees(2 * math.atan(slope)), math.degrees(2 * slope)
    assert straight - 0.5 <= seen_deg <= proportional + 0.5


@pytest.mark.parametrize(
    ("size", "zoom", "focal_px"),
    [((640, 512), 1, 758.3), ((1280, 1024), 1, 1516.7), ((640, 512), 2, 1516.7)],
)
def test_interpolation_and_zoom_scale_the_focal_length(size, zoom, focal_px):
    camera = camera_of("DJI", "M3T", size, zoom)
    assert (camera.width, camera.height) == size
    assert camera.fx == camera.fy == pytest.approx(focal_px, abs=0.1)
    assert (camera.cx, camera.cy) == ((size[0] - 1) / 2, (size[1] - 1) / 2)


def test_the_focal_length_chooses_between_lenses():
    """A paper's XT2 has the lens of 13 mm; its fx is 5 % from the data sheet's."""
    calibrated = camera_of("DJI", "XT2", (640, 512), focal_mm=13.0)
    assert calibrated.fx == pytest.approx(XT2.fx, rel=0.06)
    assert camera_of("DJI", "FLIR", (640, 512), focal_mm=19.0).fx == pytest.approx(1117.6, abs=0.1)
    assert camera_of("DJI", "XT2", (640, 512)) is None


@pytest.mark.parametrize(
    ("maker", "model", "size", "focal_mm"),
    [
        ("DJI", "M3T", (4000, 3000), math.nan),  # the wide camera beside it
        ("DJI", "M3T", (640, 512), 24.0),
        ("DJI", "other", (640, 512), math.nan),
        ("other", "M3T", (640, 512), math.nan),
    ],
)
def test_a_camera_that_is_not_in_the_table_is_not_known(maker, model, size, focal_mm):
    assert camera_of(maker, model, size, focal_mm=focal_mm) is None
