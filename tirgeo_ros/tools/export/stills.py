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
"""Export pictures as they were recorded, each with its position and angles in EXIF and XMP."""

from __future__ import annotations

import math
from pathlib import Path

from tirgeo_ros.core.ground.frame_geometry import (
    body_rpy,
    camera_heading_rad,
    camera_place,
    height_above_m,
)
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.files.whole_files import made_folder, write_files
from tirgeo_ros.io.pictures.still_file import Still, ending_of, still_bytes
from tirgeo_ros.tools.export.frames import ExportFrame


class Stills:
    """Write stills ``NNNNNN.jpg`` (8 bits) or ``.tif`` (16 bits) into a folder.

    ``undulation_m`` of the geoid makes their altitudes those above sea level; without it they are
    ellipsoidal. Raises ExportError naming a file that cannot be written.
    """

    def __init__(self, folder: Path, undulation_m: float = math.nan) -> None:
        self.folder = made_folder(folder, ExportError)
        self._undulation_m, self._written = undulation_m, 0

    def take(self, frame: ExportFrame) -> None:
        """Write a picture."""
        pose, plane = frame.pose, frame.plane
        still = Still(
            exposure_ns=pose.stamp_ns,
            camera=frame.camera,
            place=camera_place(pose, plane),
            heading_rad=camera_heading_rad(pose),
            body_rpy=body_rpy(frame.body, plane),
            above_ground_m=height_above_m(pose, plane, frame.ground),
            undulation_m=self._undulation_m,
        )
        path = self.folder / f"{frame.number:06}{ending_of(frame.pixels)}"
        write_files({path: still_bytes(frame.pixels, still)}, ExportError)
        self._written += 1

    def finish(self) -> dict[str, object]:
        """Return the folder and the number of stills."""
        above = "sea level" if math.isfinite(self._undulation_m) else "ellipsoid"
        return {"folder": str(self.folder), "files": self._written, "altitude_above": above}
