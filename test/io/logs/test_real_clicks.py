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
"""The ground below 75 real clicks on a Mavic 3T's video, by its subtitles alone.

LocateObj (Carvalho et al., SVR 2025): all clicks are on one surveyed square, 90 to 570 m away,
with zooms of 1 to 20. The video is not to be had; pixels, subtitles and the lens are.
"""

from __future__ import annotations

import csv
import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config.filter_parameters import GpsConfig
from tirgeo_ros.core.config.gimbal_parameters import GimbalConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import Q_BODY_OPTICAL, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located, place
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, PositionSample
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.logs.dji_srt import read_cues
from tirgeo_ros.io.logs.log_contents import LogOptions

SIZE = 1920, 1080
WIDE_MM = 24.0  # of the lens at a zoom of 1, as for 36 x 24 mm
CHI2_95 = 5.991  # of two degrees of freedom


@pytest.fixture(scope="module")
def flight(shared):
    """The clicks, each with its moment, position and attitude, and the surveyed places."""
    folder = shared / "real_pictures" / "locateobj" / "tests" / "UFRJ"
    numbers = [
        *map(float, re.findall(r": (-[\d.]+)", (folder / "known-positions.txt").read_text()))
    ]
    path = folder / "teste-recorte.SRT"
    # Heights of all of them are above one zero, whatever it is.
    options = LogOptions(utc_offset_s=0, geoid_undulation_m=0.0)
    contents, moments = read_cues(path.read_text(), path, options)
    kinds = (PositionSample, CameraAttitudeSample)
    samples = ([s for s in contents.samples if isinstance(s, kind)] for kind in kinds)
    # By its heights and zooms the table counts frames from 0 (its frame 1 is the second cue).
    frames = [*zip(moments, *samples, strict=True)]
    text = (folder / "results" / "R_from_yaw_pitch_roll.csv").read_text(encoding="utf-8-sig")
    rows = csv.DictReader(text.splitlines(), delimiter=";", skipinitialspace=True)
    return SimpleNamespace(
        clicks=[(row, *frames[int(row["Frame"])]) for row in rows],
        base=(*np.radians(numbers[:2]), numbers[2]),
        square=(*np.radians(numbers[3:5]), numbers[5]),
        matrix=json.loads((folder / "K-HD.json").read_text()),
        lens=json.loads((folder / "Dist.json").read_text()),
    )


def camera_at(flight, zoom):
    """The author's camera, of which the zoom takes a part about the middle."""
    (fx, _, cx), (_, fy, cy), _ = flight.matrix
    middle = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
    cx, cy = (m + zoom * (c - m) for m, c in zip(middle, (cx, cy), strict=True))
    return Camera(*SIZE, fx * zoom, fy * zoom, cx, cy, tuple(flight.lens))


def errors(flight, ground_m):
    """Errors (N,), m, and their squared Mahalanobis distances (N,)."""
    plane = TangentPlane(*flight.base)
    square_n = plane.ned_from_geodetic(*flight.square)
    gimbal = GimbalConfig()
    tilts = np.radians([max(gimbal.reported_sigma_deg)] * 2)
    north = math.radians(gimbal.north.sigma_deg)
    covariance = np.diag(np.square([*GpsConfig().position_sigma_m, *tilts, north]))
    lengths, distances = [], []
    for row, moment, position, attitude in flight.clicks:
        here = position.latitude_rad, position.longitude_rad, position.height_m
        q_nc = quat_multiply(attitude.q_ng, Q_BODY_OPTICAL)
        pose = CameraPose(position.stamp_ns, plane.ned_from_geodetic(*here), q_nc, covariance)
        camera = camera_at(flight, moment.focal_mm / WIDE_MM)
        uv = tuple(map(float, re.findall(r"[\d.]+", row["Click Pixel"])))
        point = place(camera, pose, uv, plane, ground_m, ConfidenceConfig())
        assert isinstance(point, Located)
        off = (point.point_n - square_n)[:2]
        lengths.append(math.hypot(*off))
        distances.append(off @ np.linalg.solve(point.covariance_n[:2, :2], off))
    return lengths, np.array(distances)


def test_the_table_and_the_subtitles_are_of_the_same_frames(flight):
    """Else a click would have the angles of another picture."""
    assert len(flight.clicks) == 75
    for row, moment, position, _ in flight.clicks:
        assert moment.focal_mm / WIDE_MM == pytest.approx(float(row["Zoom"]))
        drone_m = float(re.findall(r"[-\d.]+", row["Drone ENU"])[2])
        # And the earth's curvature.
        assert position.height_m - flight.base[2] == pytest.approx(drone_m, abs=0.1)


def test_the_clicks_meet_the_square_and_lie_in_their_ellipses(flight):
    """The issue's limits: 18 m on the plane of the author's zero, 22 m at the square's height.

    The sigmas are the default ones, the gimbal's north of 3 deg among them, and none of the lens.
    """
    assert np.median(errors(flight, flight.base[2])[0]) <= 18.0
    lengths, distances = errors(flight, flight.square[2])
    assert np.median(lengths) <= 22.0
    assert np.mean(distances <= CHI2_95) >= 0.9
