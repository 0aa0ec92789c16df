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
"""Projecting and locating: as the camera says, as tirgeo locate says, and as a crowd spreads."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import tirgeo_ros
from tirgeo_ros import PicturePose, PoseError, Refusal, TableError, locate, project
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_rotvec, quat_multiply
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.surveys.survey import save_observations
from tirgeo_ros.tools.replay.locate import locate_pixels

SIGMAS = np.array([0.02, 0.03, 0.04, 0.002, 0.003, 0.004])
#: Of the pose alone: the time is exact without rates.
EXACT = {f"confidence.{name}": 0.0 for name in ("lens_sigma_px", "map_sigma_m", "ground_sigma_m")}


def looking_down(pitch_deg=-60.0):
    """20 m above the ellipsoid, looking to the north-east."""
    return PicturePose.of_angles(
        *(0.7, 2.0, 20.0),
        pitch_rad=math.radians(pitch_deg),
        heading_rad=math.radians(45),
        covariance=np.diag(SIGMAS**2),
        stamp_ns=7,
    )


def test_a_point_on_the_axis_is_at_the_principal_point():
    pose = looking_down()
    ahead = np.array([math.cos(math.pi / 4), math.sin(math.pi / 4), math.tan(math.pi / 3)])
    result = project(10 * ahead, pose, XT2)
    assert result.pixels == pytest.approx(np.array([[XT2.cx, XT2.cy]]))
    right_of_it = 10 * ahead + np.array([-0.5, 0.5, 0.0])  # to the south-east
    ((u, v),) = project(right_of_it, pose, XT2).pixels
    assert u > XT2.cx + 10
    assert v == pytest.approx(XT2.cy, abs=3)


def test_what_is_projected_is_located_again():
    pose = looking_down()
    pixels = np.array([[10.0, 20.0], [300.0, 256.0], [600.0, 500.0], [-0.5, 511.5]])
    answers = locate(pixels, pose, XT2, 0.0)
    points_n = np.array([item.point_n for item in answers])
    back = project(points_n, pose, XT2)
    assert back.pixels == pytest.approx(pixels, abs=1e-6)
    assert back.visible[:3].all()
    latitude, longitude, height = pose.plane.geodetic_from_ned(points_n)
    assert height == pytest.approx(0.0, abs=1e-6)  # where the iteration is accepted
    assert {item.stamp_ns for item in answers} == {7}
    # the answers hold degrees: one rounding
    assert latitude == pytest.approx([item.latitude_rad for item in answers], rel=1e-15)
    assert longitude == pytest.approx([item.longitude_rad for item in answers], rel=1e-15)


def crowd(pose, count=1500):
    """Poses with errors of its covariance; q_true = exp(phi) q."""
    rng = np.random.default_rng(5)
    for error in rng.normal(size=(count, 6)) * SIGMAS:
        q_nc = quat_multiply(quat_from_rotvec(error[3:]), pose.pose.q_nc)
        yield replace(pose, pose=CameraPose(0, error[:3], q_nc, pose.pose.covariance))


def test_the_covariances_are_those_of_a_crowd():
    """1500 poses give a variance to 3.7 %, one sigma: sqrt(2 / 1500); 15 % is four of them."""
    pose, config = looking_down(), tirgeo_ros.load_config(EXACT)
    (point,) = locate([200.0, 300.0], pose, XT2, 0.0, config=config)
    result = project(point.point_n, pose, XT2, config=config)
    assert result.linear.all()
    pixels, places = [], []
    for item in crowd(pose):
        offset_n = point.point_n - item.pose.position_n
        pixels.append(XT2.project(offset_n @ matrix_from_quat(item.pose.q_nc))[0][0])
        places.append(locate([200.0, 300.0], item, XT2, 0.0, config=config)[0].point_n)
    for crowded, computed in ((pixels, result.covariance[0]), (places, point.covariance_n)):
        spread = np.cov(np.transpose(crowded))[:2, :2]
        assert spread == pytest.approx(computed[:2, :2], rel=0.15, abs=0.15 * computed.trace() / 2)


def test_a_point_s_own_sigma_counts():
    pose, config = looking_down(), tirgeo_ros.load_config(EXACT)
    points_n = np.tile(locate([320.0, 256.0], pose, XT2, 0.0)[0].point_n, (3, 1))
    result = project(points_n, pose, XT2, sigma_m=[0.0, np.nan, 1.0], config=config)
    traces = np.trace(result.covariance, axis1=1, axis2=2)
    assert traces[0] == traces[1] < traces[2]


def test_what_is_behind_or_beside_the_camera_is_not_visible():
    pose = looking_down()
    result = project([[0.0, 0.0, -5.0], [30.0, -30.0, 20.0], [8.0, 8.0, 20.0]], pose, XT2)
    assert result.visible.tolist() == [False, False, True]
    assert np.isnan(result.pixels[0]).all()
    assert np.isnan(result.covariance[0]).all()
    assert not result.linear[0]
    empty = project(np.zeros((0, 3)), pose, XT2)
    assert empty.pixels.shape == (0, 2)
    assert empty.covariance.shape == (0, 2, 2)


def test_an_elevation_model_is_a_ground():
    """One that is level gives what its height gives, but for its own slope: none."""
    pose = looking_down()

    def grid_of(latitude_rad, longitude_rad):
        return 50 + (longitude_rad - 2.0) * 5e6 / 100, 50 + (0.7 - latitude_rad) * 6.4e6 / 100

    terrain = tirgeo_ros.Terrain(np.full((101, 101), 3.0), grid_of)
    (on_model,) = locate([320.0, 256.0], pose, XT2, terrain)
    (level,) = locate([320.0, 256.0], pose, XT2, 3.0)
    assert on_model.point_n == pytest.approx(level.point_n, abs=1e-4)
    assert on_model.covariance_n == pytest.approx(level.covariance_n, rel=1e-3, abs=1e-6)


def test_a_pixel_without_ground_is_refused_with_its_reason():
    sky, outside = locate([[320, 0], [999, 0]], looking_down(0.0), XT2, 0.0)
    assert isinstance(sky, Refusal)
    assert sky.reason is Reason.ABOVE_HORIZON
    assert outside.reason is Reason.OUTSIDE_PICTURE


def test_located_as_tirgeo_locate_does(short, flight, params, sample, tmp_path):
    observed = [
        item
        for item in tirgeo_ros.load_observations(sample / "observations.csv")
        if item.stamp_ns < flight.stamp_ns[-1]
    ]
    observed[0] = replace(observed[0], stamp_ns=int(flight.stamp_ns[-200]), u=9999.0)
    assert len(observed) >= 4
    save_observations(tmp_path / "pixels.csv", observed)
    locate_pixels(short, tmp_path / "pixels.csv", tmp_path / "tool.geojson", params=params)
    camera = tirgeo_ros.read_camera(short)
    answers = [
        answer
        for item in observed
        for answer in locate(
            (item.u, item.v), flight.picture_pose(item.stamp_ns), camera, 11.5, config=params
        )
    ]
    tirgeo_ros.save_located(tmp_path / "mine.geojson", answers, [item.id for item in observed])
    assert (tmp_path / "mine.geojson").read_bytes() == (tmp_path / "tool.geojson").read_bytes()
    tirgeo_ros.save_located(tmp_path / "numbered.csv", answers)
    assert json.loads((tmp_path / "mine.geojson").read_text())["features"]
    with pytest.raises(TableError, match=f"ids: 1 given for {len(answers)} answers"):
        tirgeo_ros.save_located(tmp_path / "bad.geojson", answers, ["a"])


POSE, POINTS = looking_down(), np.eye(3)


@pytest.mark.parametrize(
    ("call", "arguments", "line"),
    [
        (project, ([[1.0, 2.0]], POSE, XT2), r"points_n: .*\(N, 3\), is \(1, 2\)"),
        (partial(project, sigma_m=[1.0, 2.0]), (POINTS, POSE, XT2), r"sigma_m: .*\(3,\)"),
        (partial(project, sigma_m=-1), (POINTS, POSE, XT2), "must not be negat"),
        (project, (POINTS, "x", XT2), "pose: must be a PicturePose; it"),
        (locate, ("here", POSE, XT2, 0.0), "pixels: must be numbers"),
        (locate, ([1, 2], POSE, XT2, "dem.tif"), "it is 'dem.tif'"),
        (locate, ([1, 2], POSE, None, 0.0), "camera: must be a Camera; it"),
        (locate, (np.ma.masked_array([1, 2], [1, 0]), POSE, XT2, 0.0), "pixels has 1 masked val"),
        (locate, ([1, 2], POSE, XT2, math.nan), "ground: .*; it is nan"),
        (locate, (np.zeros((2, 2, 2)), POSE, XT2, 0.0), r"is \(2, 2, 2\)"),
    ],
)
def test_arrays_of_another_shape_are_refused(call, arguments, line):
    with pytest.raises(TableError, match=line):
        call(*arguments)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"latitude_rad": 39.8}, "latitude or longitude is out of range"),
        ({"covariance": np.full((6, 6), np.nan)}, "covariance is not finite"),
        ({"covariance": np.eye(3)}, r"of shape \(6, 6\), is \(3, 3\)"),
        ({"covariance": np.triu(np.full((6, 6), 0.1)) + np.eye(6)}, "covariance is not symmetric"),
        ({"pitch_rad": math.nan}, "attitude is not a unit quaternion"),
        ({"covariance": "x"}, "not the pose of a camera: could not convert"),
    ],
)
def test_a_pose_that_is_none_is_refused(change, line):
    pose = {"latitude_rad": 0.7, "longitude_rad": 2.0, "height_m": 20.0}
    pose |= {"pitch_rad": -1.0, "heading_rad": 0.0, "covariance": np.eye(6)}
    with pytest.raises(PoseError, match=line):
        PicturePose.of_angles(**(pose | change))
