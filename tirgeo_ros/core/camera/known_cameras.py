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
"""Know the cameras of which a calibration or a data sheet is published.

A data sheet gives a lens's focal length and its field of view. Of wide lenses the two differ by
the distortion: one of 9 mm before 640 pixels of 17 um sees 62 deg across without distortion, and
69 deg if angles are proportional to the distance from the middle, as the data sheet has it. The
focal length is that of the middle; distortion is not in a data sheet, so none is assumed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera

#: The FLIR XT2's thermal camera (Ren et al. 2022, Table 9).
XT2 = Camera(640, 512, 803.5593, 797.6270, 349.3325, 251.8215, (0.0540, 0.3462, -0.0037, 0.0076))

#: Relative sigma of a focal length from a data sheet: what calibrations of single cameras, and a
#: data sheet's own field of view, differ from it.
DATA_SHEET_SIGMA = 0.02
_SAME_LENS = 0.1  # EXIF rounds focal lengths; the lenses of one camera differ by more
_SAME_SHAPE = 0.01


class DataSheet(NamedTuple):
    """Hold a camera's models as EXIF or XMP has them, one of its lenses, and what is published."""

    makers: str
    models: tuple[str, ...]
    size: tuple[int, int]  # of the sensor: width, height, pixels
    pixel_um: float
    focal_mm: float
    source: str  # with the field of view: from corner to corner (DFOV), or across and down


_VGA, _PITCH, _WIDE = (640, 512), 12.0, 17.0  # um: uncooled sensors of today, of ten years ago
_M3T, _M4T, _H20N = ("M3T", "M3TD", "M30T"), ("M4T", "M4TD"), ("ZH20N", "H20N")
_M2EA, _H20T, _H30T = ("MAVIC2-ENTERPRISE-ADVANCED", "M2EA"), ("ZH20T", "H20T"), ("ZH30T", "H30T")
_VT300 = ("VT300-Z_40", "VT300-L_40")
_XT = ("XT", "XT2", "FLIR", "VUE PRO", "VUE PRO R", "VUE PRO 640", "VUE PRO R 640", "DUO PRO R")
#: Data sheets give some focal lengths as the equivalent of a full frame: 'like 40 mm'.
DATA_SHEETS = (
    DataSheet("DJI", _M3T, _VGA, _PITCH, 9.1, "9.1 mm, like 40 mm, DFOV 61 deg"),
    DataSheet("DJI", _M4T, _VGA, _PITCH, 12.0, "like 53 mm, DFOV 45 deg"),
    DataSheet("DJI", _M2EA, _VGA, _PITCH, 9.0, "about 9 mm, like 38 mm: DFOV 59.3 deg"),
    DataSheet("DJI", _H20T, _VGA, _PITCH, 13.5, "13.5 mm, DFOV 40.6 deg"),
    DataSheet("DJI", _H20N, _VGA, _PITCH, 12.0, "12 mm, like 53 mm, DFOV 45.5 deg"),
    DataSheet("DJI", _H20N, _VGA, _PITCH, 44.5, "44.5 mm, like 196 mm: DFOV 12.5 deg"),
    DataSheet("DJI", _H30T, (1280, 1024), _PITCH, 24.0, "24 mm, DFOV 45.2 deg"),
    DataSheet("DJI FLIR", _XT, _VGA, _WIDE, 9.0, "9 mm, 69 x 56 deg"),
    DataSheet("DJI FLIR", _XT, _VGA, _WIDE, 13.0, "13 mm, 45 x 37 deg"),
    DataSheet("DJI FLIR", _XT, _VGA, _WIDE, 19.0, "19 mm, 32 x 26 deg"),
    DataSheet("DJI FLIR", _XT, _VGA, _WIDE, 25.0, "25 mm, 25 x 20 deg"),
    DataSheet("SKYDIO", _VT300, _VGA, _PITCH, 13.6, "13.6 mm, DFOV 40 deg"),
)


def camera_of(
    maker: str, model: str, size: tuple[int, int], zoom: float = 1.0, focal_mm: float = math.nan
) -> Camera | None:
    """Return the camera that took a picture of ``size`` (width, height), without distortion.

    ``focal_mm`` chooses between lenses; without it a camera with several is not known. A picture
    that is larger than the sensor by interpolation, and digital ``zoom``, scale the focal length.
    None: the table does not have it, or the picture has another shape than its sensor.
    """
    width, height = size
    lengths_px = [
        sheet.focal_mm / sheet.pixel_um * 1e3 * zoom * width / sheet.size[0]
        for sheet in DATA_SHEETS
        if maker.upper() in sheet.makers.split()
        and model.upper() in sheet.models
        and abs(height / sheet.size[1] * sheet.size[0] / width - 1) < _SAME_SHAPE
        and not abs(focal_mm / sheet.focal_mm - 1) > _SAME_LENS  # nan: not given
    ]
    if len(lengths_px) != 1:
        return None
    fx = fy = lengths_px[0]
    return Camera(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2)
