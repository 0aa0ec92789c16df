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
"""The sample flight as a GeoPackage: outlines, track and targets where they are."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from exported_flight import GROUND_M
from layers_by_gdal import layers_in, rows_of
from numpy.testing import assert_allclose
from scenes import graticule
from target_samples import TARGETS

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ground.ground_point import Located, circular_error_90, place
from tirgeo_ros.io.targets.columns import target_cells
from tirgeo_ros.io.targets.formats import exported as targets_as
from tirgeo_ros.tools.evaluate.result import load_truth
from tirgeo_ros.tools.export.vectors import Vectors

CONFIDENCE = ConfidenceConfig()
EAST_20_M = np.array([0.0, 20.0, 0.0])


@pytest.fixture(scope="module")
def path(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("vectors")
    (folder / "targets.gpkg").write_bytes(targets_as(TARGETS, "gpkg"))
    options = {"targets": folder / "targets.gpkg", "state_at": flight.state_at, "every_s": 1.0}
    product = Vectors(folder / "flight.gpkg", **options)
    for frame in flight.frames[::9]:
        product.take(frame)
    assert product.finish() == {
        "file": str(folder / "flight.gpkg"),
        "footprints": 29,
        "track": 1,
        "track_points": 29,
        "targets": 2,
        "ellipses": 2,
        "pictures_without_ground": 0,
    }
    return folder / "flight.gpkg"


@pytest.fixture(scope="module")
def by_number(flight):
    return {frame.number: frame for frame in flight.frames}


def test_an_outline_is_the_pictures_rim(path, by_number):
    """Projected by OpenCV, its points are on the rim, anticlockwise; four are the corners."""
    for row in rows_of(path, "footprints"):
        frame = by_number[row["picture"]]
        camera, pose = frame.camera, frame.pose
        lon_lat = np.radians(row["positions"])
        points_n = frame.plane.ned_from_geodetic(lon_lat[:, 1], lon_lat[:, 0], GROUND_M)
        points_c = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)
        lens = camera.matrix, np.array(camera.distortion)
        uv = cv2.projectPoints(points_c, np.zeros(3), np.zeros(3), *lens)[0][:, 0] + 0.5
        size = camera.width, camera.height
        # Longitudes near 117 deg have steps of 1.4e-14 deg; a ray is inverted to 1e-9 px.
        off_rim = np.minimum(np.abs(uv), np.abs(uv - size)).min(axis=1)
        assert off_rim.max() < 1e-5
        for corner in np.ndindex(2, 2):
            assert np.linalg.norm(uv - np.multiply(corner, size), axis=1).min() < 1e-5
        x, y = (row["positions"] - row["positions"].mean(axis=0)).T
        assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0


def test_a_pictures_row_says_how_it_was_taken(path, by_number, flight):
    for row in rows_of(path, "footprints"):
        frame = by_number[row["picture"]]
        where = frame.plane.geodetic_from_ned(frame.pose.position_n)
        result = [row[name] for name in ("latitude_deg", "longitude_deg", "height_m")]
        assert_allclose(result, [*np.degrees(where[:2]), where[2]], rtol=0, atol=1e-9)
        assert row["stamp_ns"] == frame.pose.stamp_ns
        assert row["time"].startswith("2021-10-20T12:0")
        middle = (frame.camera.width - 1) / 2, (frame.camera.height - 1) / 2
        observed = place(frame.camera, frame.pose, middle, frame.plane, GROUND_M, CONFIDENCE)
        assert isinstance(observed, Located)
        assert row["ce90_m"] == pytest.approx(circular_error_90(observed.covariance_n))
        assert row["above_ground_m"] == pytest.approx(where[2] - GROUND_M, abs=1e-3)
        # A pixel is one part in 803.6 of the distance along the axis, at 30 deg: to some percent.
        assert row["gsd_m"] == pytest.approx(row["slant_range_m"] / frame.camera.fx, rel=0.05)
        assert row["pitch_deg"] == pytest.approx(-30, abs=2)


def test_the_track_is_the_true_one(path, sample, by_number):
    truth = load_truth(sample / "truth.mcap")
    rows = rows_of(path, "track_points")
    for row in rows:
        true = truth.bodies.at(int(row["stamp_ns"]))
        longitude, latitude, height_m = row["positions"][0]
        found_n = truth.plane.ned_from_geodetic(*np.radians([latitude, longitude]), height_m)
        sigmas = [row[f"sigma_{axis}_m"] for axis in ("north", "east", "height")]
        assert (np.abs(found_n - true.position_n) < 5 * np.array(sigmas)).all()
    assert {row["state"] for row in rows} == {"running"}
    speeds = [row["speed_m_s"] for row in rows]
    assert np.isnan(speeds[0])  # there is no point before
    assert 2.5 < np.mean(speeds[1:]) < 3.2  # 3 m/s, slower in the turns
    (line,) = rows_of(path, "track")
    assert_allclose(line["positions"], np.array([row["positions"][0] for row in rows]))
    assert line["points"] == 29
    assert (line["begin"], line["end"]) == (rows[0]["time"], rows[-1]["time"])
    steps = np.diff([int(row["stamp_ns"]) for row in rows]) * 1e-9
    assert line["length_m"] == pytest.approx(np.sum(steps * speeds[1:]))


def test_targets_are_there_with_their_ellipses(path):
    rows = rows_of(path, "targets")
    for row, target in zip(rows, TARGETS, strict=True):
        expected = target_cells(target)
        assert {key: row[key] for key in expected} == expected
        place = target.place
        assert row["positions"].tolist() == [[place.longitude_deg, place.latitude_deg]]
    for row, target in zip(rows_of(path, "ellipses"), TARGETS, strict=True):
        assert row["target"] == target.id
        assert_allclose(row["positions"][:, ::-1], target.place.outline())


def test_the_track_needs_no_ground_and_is_broken_where_there_is_no_pose(flight, tmp_path):
    product = Vectors(tmp_path / "flight.gpkg", every_s=1.0)
    for frame in flight.frames[::9]:
        if not 100 <= frame.number < 150:
            product.take(dataclasses.replace(frame, ground=None))
    summary = product.finish()
    assert summary["footprints"] == 0
    assert summary["pictures_without_ground"] == summary["track_points"] > 3
    assert "targets" not in layers_in(tmp_path / "flight.gpkg")
    first, second = rows_of(tmp_path / "flight.gpkg", "track")
    assert first["end"] < second["begin"]
    points = rows_of(tmp_path / "flight.gpkg", "track_points")
    assert first["points"] + second["points"] == len(points)
    assert np.isnan(points[int(first["points"])]["speed_m_s"])
    assert points[0]["state"] is None  # nobody told


def test_an_elevation_model_is_a_ground_too(flight, tmp_path):
    """A level one gives the outline of level ground; beyond its edge there is no outline."""
    frame = flight.frames[0]
    south_west, rows = (39.845, 116.695), 101  # 1.1 km by 0.85 km, steps of 11 m
    grid = graticule(south_west, (1e-4, 1e-4), rows)
    level = Terrain(np.full((rows, rows), GROUND_M), grid)
    away = Terrain(np.full((rows, rows), GROUND_M), graticule((39.9, 116.695), (1e-4, 1e-4), rows))
    product = Vectors(tmp_path / "flight.gpkg")
    for ground in (GROUND_M, level, away):
        product.take(dataclasses.replace(frame, ground=ground))
    assert product.finish()["pictures_without_ground"] == 1
    first, second = rows_of(tmp_path / "flight.gpkg", "footprints")
    # The model's hit is found to a millimetre: 1e-8 deg.
    assert_allclose(second["positions"], first["positions"], rtol=0, atol=1e-8)
    assert second["above_ground_m"] == pytest.approx(first["above_ground_m"], abs=1e-3)
    assert second["ce90_m"] == pytest.approx(first["ce90_m"], rel=1e-3)


def test_an_outline_across_the_antimeridian_is_one_piece(flight, tmp_path):
    frame = flight.frames[0]
    fiji = TangentPlane(np.radians(-17.0), np.radians(179.9999), frame.plane.height_m)
    # The camera is then 26 m to the east of the line; it looks to the west across it.
    over = dataclasses.replace(frame.pose, position_n=frame.pose.position_n + EAST_20_M)
    product = Vectors(tmp_path / "flight.gpkg")
    product.take(dataclasses.replace(frame, plane=fiji, pose=over))
    product.finish()
    (row,) = rows_of(tmp_path / "flight.gpkg", "footprints")
    longitudes = np.abs(row["positions"][:, 0])
    assert longitudes.min() < 180 < longitudes.max()
    assert np.ptp(row["positions"][:, 0]) < 0.001
