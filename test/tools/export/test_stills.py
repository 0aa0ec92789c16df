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
"""Stills of the sample flight: their metadata alone project surveyed points onto the clicks."""

from __future__ import annotations

import json

import numpy as np
import pytest
from exported_flight import UNDULATION_M
from numpy.testing import assert_allclose
from PIL import Image
from still_reader import by_gimbal, by_mapping, by_open_drone_map, place_of, projected, read_still

from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.surveys.survey import load_observations
from tirgeo_ros.tools.export.stills import Stills

#: Roundings as seen 30 m away with 800 px: three angles to 0.5e-5 deg, 0.07 mm of place.
ROUNDING_PX = 800 * (3 * np.radians(0.5e-5) + 0.07e-3 / 30)
CLICK_PX = 0.5  # one sigma of an observation in each direction


@pytest.fixture(scope="module")
def stills(flight, tmp_path_factory):
    """Every picture, with altitudes above sea level."""
    product = Stills(tmp_path_factory.mktemp("out") / "stills", undulation_m=UNDULATION_M)
    for frame in flight.frames:
        product.take(frame)
    summary = product.finish()
    assert summary["files"] == len(flight.frames)
    return product.folder


def test_surveyed_points_are_where_they_were_clicked(sample, flight, stills):
    """A reader of the file alone projects them as we do, and onto the clicks."""
    survey = json.loads((sample / "survey.geojson").read_text())["features"]
    places = {item["properties"]["id"]: item["geometry"]["coordinates"] for item in survey}
    frames = {frame.stamp_ns: frame for frame in flight.frames}
    distances = []
    for observed in load_observations(sample / "observations.csv"):
        if observed.stamp_ns < flight.frames[0].stamp_ns:  # before there was a pose
            continue
        frame, (longitude, latitude, height_m) = frames[observed.stamp_ns], places[observed.id]
        read = read_still(stills / f"{frame.number:06}.jpg")
        point_n = frame.plane.ned_from_geodetic(*np.radians([latitude, longitude]), height_m)
        points_c = (point_n - frame.pose.position_n) @ matrix_from_quat(frame.pose.q_nc)
        expected, _ = frame.camera.project(points_c)
        for axes in (by_gimbal(read), by_mapping(read), by_open_drone_map(read)):
            result = projected(read, axes, UNDULATION_M, [(latitude, longitude, height_m)])
            assert_allclose(result, expected, atol=ROUNDING_PX)
        by_pose = pixel_jacobian(frame.camera, frame.pose, point_n)[0][0]
        spread = by_pose @ frame.pose.covariance @ by_pose.T + CLICK_PX**2 * np.eye(2)
        off = result[0] - (observed.u, observed.v)
        distances.append(off @ np.linalg.solve(spread, off))
    assert len(distances) == 24
    assert max(distances) < 18.4  # of two dimensions, 1 in 10 000 is farther


def test_without_the_undulation_altitudes_are_ellipsoidal(flight, tmp_path):
    product, frame = Stills(tmp_path / "stills"), flight.frames[0]
    product.take(frame)
    summary = {"folder": str(tmp_path / "stills"), "files": 1, "altitude_above": "ellipsoid"}
    assert product.finish() == summary
    read = read_still(product.folder / f"{frame.number:06}.jpg")
    height_m = frame.plane.geodetic_from_ned(frame.pose.position_n)[2]
    assert place_of(read)[2] == pytest.approx(float(height_m), abs=1e-4)
    (tmp_path / "file").touch()
    with pytest.raises(ExportError, match="file: cannot be made: File exists"):
        Stills(tmp_path / "file")


def test_the_picture_is_the_recorded_one_without_marks(flight, stills):
    frame = flight.frames[100]
    with Image.open(stills / f"{frame.number:06}.jpg") as image:
        apart = np.asarray(image).astype(int) - frame.pixels
    assert np.abs(apart).max() <= 2  # the best quality rounds coefficients to whole numbers
