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
"""Stills over the sample park as a stand-in of their reader makes them of a folder's files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_stills import picture

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.io.logs import forms
from tirgeo_ros.io.logs.forms import Form
from tirgeo_ros.io.logs.log_contents import LogContents, Picture
from tirgeo_ros.tools.convert import direct_input, import_logs

START_NS, STEP_NS = 1_700_000_000_000_000_000, 2_000_000_000
#: Of the park's beds (deg), on the ground at 11.5 m, and the height of the stills above it (m).
PLACE_DEG, GROUND_M, ABOVE_M = (39.849377, 116.699679), 11.5, 60.0
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><a b="still %d"/></x:xmpmeta>'
#: A segment with the raw data of a thermal picture, which must not be copied.
RAW = b"\xff\xe3\x00\x0araw data"


def still_jpeg(number, size=(640, 512)):
    """A JPEG with EXIF, XMP and raw data, brighter with its number."""
    jpeg = picture(xmp=XMP % number, model=f"still {number}", size=size, grey=40 + number)
    return jpeg[:2] + RAW + jpeg[2:]


def folder_of(path: Path, count=3, size=(640, 512)):
    """A folder of stills, whose numbers are in their names."""
    path.mkdir()
    for number in range(count):
        (path / f"DJI_{number:04}_T.JPG").write_bytes(still_jpeg(number, size))
    return path


@dataclass
class StandIn:
    """Read a folder: still n is taken at 2 n s, looks down and north, and is 1 m north of n - 1.

    ``options`` are those of the last import. Of the stills ``lost`` there is no position.
    """

    parameters: dict[str, object]
    lost: tuple[int, ...] = ()
    options: object = None
    camera: object = XT2

    def read(self, path, options):
        self.options = options
        contents = LogContents(parameters=self.parameters, notes=["a stand-in read them"])
        files = sorted(path.glob("*.JPG"))
        for number, _ in enumerate(files):
            contents.samples += self._samples(number)
        contents.read["still"] = len(files)
        contents.refused["other.txt", "it is no JPEG <script>"] = 1
        contents.pictures = (
            Picture(START_NS + n * STEP_NS, file.read_bytes(), self.camera, file.name)
            for n, file in enumerate(files)
        )
        return contents

    def _samples(self, number):
        stamp_ns = START_NS + number * STEP_NS
        latitude, longitude = map(math.radians, PLACE_DEG)
        place = latitude + number / 6.37e6, longitude, GROUND_M + ABOVE_M
        kind = stamp_ns, Source.GPS_POSITION, FixStatus.SINGLE
        level = quat_from_euler(0.0, 0.0, 0.0)
        if number not in self.lost:
            yield PositionSample(*kind, *place, np.eye(3))
        yield ImuSample.of_attitude(stamp_ns, level)
        yield CameraAttitudeSample(stamp_ns, quat_from_euler(0.0, math.radians(-90.0), 0.0))

    def put(self, monkeypatch):
        """Recognise folders that are no bags as stills, in place of the reader."""
        form = Form("stills", lambda _: False, self.read)
        for module in (direct_input, import_logs):
            monkeypatch.setattr(
                module,
                "form_of",
                lambda path, **_: form if path.is_dir() else (forms.form_of(path)),
            )
        return self
