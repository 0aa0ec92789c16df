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
"""A map in the tangent plane: labels, outlines, heights, and how it lies on an elevation model."""

import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.map import vector_map as map_module
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer, VectorMap
from tirgeo_ros.core.types.errors import ConfigError

PLANE = TangentPlane(math.radians(48.2), math.radians(16.4), 200.0)
CELL_M = 5.0
SIZE = 201  # nodes: a square of 1 km about the origin
RADIUS_M = 6.37e6


def grid_of(latitude, longitude):
    north = (latitude - PLANE.latitude_rad) * RADIUS_M
    east = (longitude - PLANE.longitude_rad) * RADIUS_M * math.cos(PLANE.latitude_rad)
    return east / CELL_M + SIZE // 2, SIZE // 2 - north / CELL_M


def terrain(hole=False):
    row, column = np.mgrid[:SIZE, :SIZE].astype(float)
    heights = 200.0 + 10.0 * np.sin(column / 15) + 8.0 * np.cos(row / 20)
    if hole:
        heights[60:80, 60:80] = np.nan
    return Terrain(heights, grid_of)


def feature(offsets_n, *, label="", closed=False, group=-1):
    """Points at north, east and down; at north and east alone, of unknown heights."""
    offsets_n = np.array(offsets_n, float)
    flat = offsets_n.shape[1] == 2
    points = np.column_stack(PLANE.geodetic_from_ned(np.pad(offsets_n, ((0, 0), (0, flat)))))
    if flat:
        points[:, 2] = np.nan
    return GeoFeature(label, closed, points, group)


def draped(*features, ground=None, style=LayerStyle()):  # noqa: B008 frozen
    ground = terrain() if ground is None else ground
    return VectorMap.from_layers([MapLayer("m", features, style)], PLANE, ground)


SQUARE = [[0, 0, 0], [0, 10, 0], [10, 10, 0], [10, 0, 0]]


def test_points_come_back_where_they_were():
    rng = np.random.default_rng(1)
    offsets = [rng.uniform(-500, 500, (n, 3)) for n in (3, 2, 7)]
    got = draped(*map(feature, offsets), ground=math.nan)
    for line, wanted in zip(got.lines.split(), offsets, strict=True):
        np.testing.assert_allclose(line, wanted, atol=1e-7)  # 6.4e6 m in float64: 1e-9 m


def test_a_map_without_heights_needs_the_ground_height():
    features = [feature(SQUARE), feature(np.array(SQUARE)[:, :2])]
    with pytest.raises(ConfigError, match=r"1 of 2 features.*ground_height_m \(--ground-height\)"):
        draped(*features, ground=math.nan)


def test_parts_of_a_group_share_one_label():
    features = [
        feature(SQUARE, label="Beet", group=4),
        feature(SQUARE, group=4),
        feature(SQUARE, label="Beet"),
        feature(SQUARE, label="Beet"),
        feature([[0, 0, 0]], label="Beet", group=4),
    ]
    got = draped(*features, ground=math.nan)
    assert got.labels == ("Beet", "Beet", "Beet")
    assert got.lines.owner.tolist() == [0, 0, 1, 2]
    assert got.marks.owner.tolist() == [0]


def height_above(model, points_n):
    latitude, longitude, height = PLANE.geodetic_from_ned(points_n)
    return height - model.height_m(latitude, longitude)


def test_a_long_line_follows_the_ground():
    model = terrain()
    line = draped(feature([[-450, -400], [430, 410]]), ground=model).lines.split()[0]
    assert len(line) > 230  # 1190 m of cells of 5 m
    between = (line[:-1] + line[1:]) / 2
    assert np.abs(height_above(model, line)).max() < 1e-6
    # Sagitta of the surface over half a cell's diagonal: its curvature is below 10 / 15^2 and
    # 8 / 20^2 m a node squared; 1/8 of their sum.
    assert np.abs(height_above(model, between)).max() < 0.01 + (10 / 15**2 + 8 / 20**2) / 8
    assert np.ptp(line[:, 2]) > 10


def test_a_line_ends_where_the_model_ends():
    got = draped(feature([[0, -5000], [0, 5000]], label="far"), feature([[10, 0], [20, 9]]))
    far = [
        part for part, owner in zip(got.lines.split(), got.lines.owner, strict=True) if not owner
    ]
    assert len(far) == 1
    assert np.abs(far[0][:, 1]).max() == pytest.approx(500, abs=CELL_M * 1.5)
    assert np.diff(far[0][:, 1]).max() < 1.01 * CELL_M
    assert got.without_ground == 1
    assert "1 of 2 features lie where the elevation model has no height" in got.notes[0]


def test_a_gap_of_the_model_cuts_a_line_and_leaves_its_ring_unfilled():
    model, fill = terrain(hole=True), LayerStyle(fill_bgr=(0, 0, 255))
    north, east = (SIZE // 2 - 70) * CELL_M, (70 - SIZE // 2) * CELL_M
    across = feature([[north, east - 200], [north, east + 200]])
    ring = [[north - 20, east], [north - 20, east + 300], [north - 200, east + 300]]
    whole = [[-200, 0], [-200, 50], [-250, 50]]
    got = draped(
        across, feature(ring, closed=True), feature(whole, closed=True), ground=model, style=fill
    )
    assert got.without_ground == 2
    assert np.isfinite(got.lines.points).all()
    assert (got.lines.owner == 0).sum() == 2
    assert got.rings.owner.tolist() == [2]


def test_marks_off_the_model_are_left_out():
    got = draped(feature([[10, 10]], label="in"), feature([[9e3, 0]], label="out"))
    assert [got.labels[i] for i in got.marks.owner] == ["in"]
    assert np.abs(height_above(terrain(), got.marks.points.T)).max() < 1e-6
    assert got.without_ground == 1


def test_lines_on_too_fine_a_model_get_fewer_vertices_and_a_note(monkeypatch):
    line = feature([[-450, 0], [450, 0]])
    every_cell = draped(line)
    assert not every_cell.notes
    monkeypatch.setattr(map_module, "MOST_VERTICES", 50)
    got = draped(line)
    assert 40 < got.lines.points.shape[1] < 70
    [note] = got.notes
    steps = every_cell.lines.points.shape[1] / got.lines.points.shape[1]
    assert float(note.partition(" cells")[0].split()[-1]) == pytest.approx(steps, rel=0.1)
