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
"""Observations of surveyed points to errors on the ground, and the plane they are projected to."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, quat_from_matrix, rotation_y
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, save_observations, save_survey
from tirgeo_ros.tools.evaluate.experiment import experiment_of, load_experiment, projection_of
from tirgeo_ros.tools.evaluate.result import ground_errors, locate_observations

PLANE = TangentPlane(0.6955, 2.0368, 30.0)
GROUND_M = 11.5
SPEED_M_S = 3.0
LATENCY_S = 0.05
VARIANCES = [1e-4] * 3 + [1e-6] * 3
#: Depression 30 deg, looking north.
Q_NC = quat_from_matrix(rotation_y(math.radians(-30)) @ BODY_OPTICAL)
# the plane's curvature over the 70 m of these points is 70^2 / (2 R) = 0.4 mm, seen at 17 deg
# and more above the ground's plane: 1.3 mm
CURVATURE_M = 2e-3


def pose_at(t_s, shift_n=(0.0, 0.0)):
    position_n = np.array([SPEED_M_S * t_s + shift_n[0], shift_n[1], -1.5])
    return CameraPose(round(t_s * 1e9), position_n, Q_NC, np.diag(VARIANCES))


def flown(points_n, exposures_s):
    """Survey and observations of points (N, 3), each seen at its exposure."""
    survey, observed = [], []
    for k, (point_n, t_s) in enumerate(zip(points_n, exposures_s, strict=True)):
        lat, lon, height = (float(x) for x in PLANE.geodetic_from_ned(point_n))
        survey.append(SurveyPoint(f"P{k}", lat, lon, height))
        pose = pose_at(t_s)
        from_camera_n = (point_n - pose.position_n)[None]
        uv, valid = XT2.project(from_camera_n @ (rotation_y(math.radians(-30)) @ BODY_OPTICAL))
        assert valid[0]
        observed.append(Observation(f"P{k}", round((t_s + LATENCY_S) * 1e9), *uv[0]))
    return survey, observed


def some_points(count=9):
    rng = np.random.default_rng(5)
    exposures_s = rng.uniform(0.5, 9.5, count)
    ahead = rng.uniform(25, 60, count) + SPEED_M_S * exposures_s
    across = rng.uniform(-8, 8, count)
    lat, lon, _ = PLANE.geodetic_from_ned(np.stack([ahead, across, np.full(count, 18.5)], -1))
    return PLANE.ned_from_geodetic(lat, lon, GROUND_M), exposures_s


def located(survey, observed, shift_n=(0.0, 0.0)):
    poses: PoseBuffer[CameraPose] = PoseBuffer(1e6)
    for k in range(101):
        poses.add(pose_at(0.1 * k, shift_n))
    overlay = config_from(OverlayConfig, {"video_latency_s": LATENCY_S})
    experiment = experiment_of(survey, observed)
    return locate_observations(poses, PLANE, XT2, experiment, GROUND_M, overlay)


def test_points_come_back_where_they_are():
    survey, observed = flown(*some_points())
    result, refused = located(survey, observed)
    assert [item.id for item in result] == [item.id for item in observed]
    assert not refused
    assert ground_errors(result).distance_m.max() < CURVATURE_M
    assert all(item.is_inside for item in result)


def test_camera_shift_is_the_ground_error():
    survey, observed = flown(*some_points())
    result, _ = located(survey, observed, (0.7, -0.4))
    experiment = experiment_of(survey, observed)
    # the axes of the projected plane are turned by 0.2 deg there
    expected = experiment.projection.local_axes(PLANE.latitude_rad, PLANE.longitude_rad) @ [
        0.7,
        -0.4,
    ]
    assert expected[0] == pytest.approx(-0.4, abs=0.01)  # east comes first
    for item in result:
        np.testing.assert_allclose(item.error_en, expected, atol=CURVATURE_M)
        point = experiment.survey[item.id]
        surveyed_en = experiment.projection.project(point.latitude_rad, point.longitude_rad)
        np.testing.assert_allclose(item.place_en - surveyed_en, item.error_en, atol=1e-9)
    assert ground_errors(result).rmse_m == pytest.approx(math.hypot(0.7, 0.4), abs=CURVATURE_M)
    assert not any(item.is_inside for item in result)  # of centimetres


def test_refused_points_have_a_reason_and_unsurveyed_ones_are_left_out(tmp_path):
    survey, observed = flown(*some_points(3))
    unknown = Observation("nobody", observed[0].stamp_ns, 320.0, 256.0)
    too_late = Observation("P0", 60_000_000_000, 320.0, 256.0)
    beside = Observation("P0", observed[0].stamp_ns, -4000.0, 256.0)
    result, refused = located(survey, [*observed, unknown, too_late, beside])
    assert len(result) == 3
    assert [(item.id, item.reason) for item in refused] == [
        ("P0", "no trusted pose at that picture"),
        ("P0", "the pixel is outside the picture"),
    ]
    save_survey(tmp_path / "survey.csv", survey)
    save_observations(tmp_path / "none.csv", [])
    with pytest.raises(SurveyError, match=r"none\.csv: has no observations$"):
        load_experiment(tmp_path / "survey.csv", tmp_path / "none.csv")
    save_observations(tmp_path / "seen.csv", [unknown, unknown])
    reason = r"seen\.csv: none of its 2 observations is of a point in .*survey\.csv"
    with pytest.raises(SurveyError, match=reason):
        load_experiment(tmp_path / "survey.csv", tmp_path / "seen.csv")


def at(latitude_deg, longitude_deg):
    return projection_of(np.radians([latitude_deg]), np.radians([longitude_deg]))


@pytest.mark.parametrize(
    ("longitude_deg", "meridian_deg", "named"),
    [
        (115.4, 114, "114 deg E"),
        (115.6, 117, "117 deg E"),
        (-71.2, -72, "72 deg W"),
        (-179.9, -180, "180 deg W"),
    ],
)
def test_gauss_krueger_has_the_nearest_meridian(longitude_deg, meridian_deg, named):
    result = at(40, longitude_deg)
    assert named in result.name
    east_m, north_m = result.project(math.radians(40), math.radians(meridian_deg))
    assert east_m == pytest.approx(500e3, abs=1e-6)
    # the meridian's arc from the equator to 40 deg, by PROJ's geodesics
    _, _, arc_m = pyproj.Geod(ellps="WGS84").inv(0, 0, 0, 40)
    assert north_m == pytest.approx(arc_m, abs=1e-3)


@given(st.floats(-80, 80), st.floats(-179.9, 179.9), st.floats(-1.4, 1.4))
def test_local_axes_are_the_derivative(latitude_deg, longitude_deg, off_deg):
    plane = at(latitude_deg, longitude_deg)
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg + off_deg)
    meridional_m, transverse_m = radii_of_curvature(lat)
    step_m = 10.0
    steps = [(step_m / meridional_m, 0.0), (0.0, step_m / (transverse_m * math.cos(lat)))]
    slopes = [
        (plane.project(lat + a, lon + b) - plane.project(lat - a, lon - b)) / (2 * step_m)
        for a, b in steps
    ]
    # coordinates of up to 1e7 m carry 2e-9 m each, 2e-10 of the step; PROJ takes convergence and
    # scale from differences over 1e-5 rad, whose own error is of second order: some 1e-10
    np.testing.assert_allclose(plane.local_axes(lat, lon), np.stack(slopes, -1), atol=1e-8)


def test_a_survey_across_the_date_line_and_at_a_pole():
    latitudes, longitudes = np.radians([-17.0, -17.0]), np.radians([179.99, -179.98])
    result = projection_of(latitudes, longitudes)
    # 0.03 deg at 17 deg south
    assert np.ptp(result.project(latitudes, longitudes)[:, 0]) == pytest.approx(3196, rel=1e-2)
    with pytest.raises(SurveyError, match=r"latitude 85\.0: no transverse Mercator zone"):
        at(85, 20)
