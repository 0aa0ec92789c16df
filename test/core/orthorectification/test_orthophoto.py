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
"""Pictures on the ground: what each pixel shows, which view is the best, and how views blend."""

from __future__ import annotations

import math

import numpy as np
import pytest
from coded_frames import (
    CAMERA,
    CODE_M,
    GROUND_M,
    NADIR,
    OBLIQUE,
    PIXEL_M,
    UTM,
    WHOLE,
    coded,
    terrain_of,
    tiles_of,
)
from scenes import PLANE, camera_pose

from tirgeo_ros.core.ground.backprojection import hidden
from tirgeo_ros.core.orthorectification.orthophoto import (
    TILE_PX,
    FrameView,
    MosaicTile,
    Patch,
    level_gsd_m,
    seeds,
)

GRAZING = math.radians(15.0)
SLOPE = terrain_of(lambda north, east: 0.2 * north - 0.1 * east)
#: Two metres of node distance and 1.5 m high over 80 m: bends of a DEM's cells.
HILLS = terrain_of(lambda north, east: 1.5 * np.sin(north / 12.0) * np.cos(east / 15.0))


def white_view(ground, pose):
    """The view of a picture that is white all over."""
    white = np.full((CAMERA.height, CAMERA.width), 200, np.uint8)
    return FrameView(tiles_of(ground), CAMERA, pose, white, GRAZING)


def off_px(ground, pose):
    """Return each pixel's error (n, 2), px: the place that it shows minus its own place."""
    picture, corner = coded(pose, ground)
    result = []
    view = FrameView(tiles_of(ground, PIXEL_M), CAMERA, pose, picture, GRAZING)
    for key, patch in view.patches():
        numbers = np.arange(TILE_PX) + np.array(key)[:, None] * TILE_PX + 0.5
        x, y = np.meshgrid(numbers[0, patch.columns], -numbers[1, patch.rows])
        inner = patch.seen & (patch.values[..., 2] == WHOLE)
        own_m = np.stack([x, y], axis=2)[inner] * PIXEL_M - corner
        result.append((patch.values[inner][:, :2] * CODE_M - own_m) / PIXEL_M)
    return np.concatenate(result)


@pytest.mark.parametrize(
    ("ground", "pose"),
    [
        pytest.param(GROUND_M, OBLIQUE, id="level-oblique"),
        pytest.param(GROUND_M, NADIR, id="level-nadir"),
        pytest.param(SLOPE, OBLIQUE, id="slope-oblique"),
        pytest.param(SLOPE, NADIR, id="slope-nadir", marks=pytest.mark.slow),
        pytest.param(HILLS, OBLIQUE, id="hills-oblique", marks=pytest.mark.slow),
        pytest.param(HILLS, NADIR, id="hills-nadir", marks=pytest.mark.slow),
    ],
)
def test_a_pixel_shows_its_own_place(ground, pose):
    """The inverse way: the picture was made by rays from its pixels to the ground."""
    off = off_px(ground, pose)
    assert len(off) > 4_000
    # Codes are 0.02; between nodes of 4 pixels, and between the picture's pixels, the perspective
    # bends by a few hundredths. Older versions of OpenCV round places to 1/32 of the picture's
    # pixels, of which one covers six at the far end: another 0.1.
    assert np.abs(off).max() < 0.25
    assert (np.abs(off.mean(axis=0)) < 0.01).all()


def test_flat_views_are_left_out():
    pose = camera_pose([0, 0, -20.0], 0.0, -10.0, 0.0)  # the horizon is in the picture
    observed = []
    for key, patch in white_view(GROUND_M, pose).patches():
        rows = np.arange(TILE_PX)[patch.rows] + key[1] * TILE_PX
        observed.append(-rows[patch.seen.any(axis=1)] * PIXEL_M)
        assert np.isfinite(patch.score[patch.seen]).all()
        assert (patch.score[patch.seen] > 0).all()
    north_m = np.concatenate(observed)
    # 20 m / tan 15 deg to the north of the camera, to a node of four pixels.
    reach_m = north_m.max() - north_m.min()
    steepest_m = 20.0 / math.tan(math.radians(10.0) + math.atan(CAMERA.height / 2 / CAMERA.fy))
    assert reach_m == pytest.approx(20.0 / math.tan(GRAZING) - steepest_m, abs=2.0)
    assert list(white_view(40.0, pose).patches()) == []  # below


def test_a_ridge_hides_what_is_behind_it():
    """A wall of 6 m at 30 m to the north: seen from 20 m, it hides 30 m * 6 / 14 behind it."""
    ridge = terrain_of(lambda north, _: 6.0 * (np.abs(north - 30.0) < 1.5))
    places = np.array([[north, 0.0, -0.0] for north in (20.0, 26.0, 34.0, 40.0, 46.0, 60.0)])
    assert hidden(ridge, PLANE, np.array([0.0, 0, -20]), places).tolist() == [
        *(False, False, True, True, False, False)
    ]
    pose = camera_pose([0.0, 0, -20], 0.0, -30.0, 0.0)
    areas = [
        sum(int(patch.seen.sum()) for _, patch in white_view(item, pose).patches())
        for item in (GROUND_M, ridge)
    ]
    assert areas[1] < 0.85 * areas[0]


def test_ground_sample_distance_of_a_pixel():
    """In the middle of a level view it is the height over the focal length."""
    points = seeds(CAMERA, NADIR, PLANE, GROUND_M)
    result = level_gsd_m(CAMERA, NADIR, PLANE, points, GRAZING)
    assert np.median(result) == pytest.approx(20.0 / math.sqrt(CAMERA.fx * CAMERA.fy), rel=0.01)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert len(points) == 25
    assert np.isnan(level_gsd_m(CAMERA, NADIR, PLANE, 1e3 * corners[1:] @ np.eye(2, 3), 0.2)).all()


def test_a_coarse_raster_shows_means():
    """Noise of one pixel is a mean of many in a pixel of the raster that is four times as long."""
    noise = np.random.default_rng(5).integers(0, 255, (CAMERA.height, CAMERA.width))
    values = {}
    for nearest in (False, True):
        view = FrameView(
            tiles_of(GROUND_M, 0.5),
            *(CAMERA, NADIR, noise.astype(np.uint8), GRAZING),
            nearest=nearest,
        )
        values[nearest] = np.concatenate([item.values[item.seen] for _, item in view.patches()])
    assert values[True].std() == pytest.approx(noise.std(), rel=0.1)
    assert values[False].std() < 0.35 * noise.std()  # of 16 pixels a quarter


def shown_norths_m(view):
    """The whole metres to the north of the origin of all that a picture shows."""
    norths = []
    for key, patch in view.patches():
        rows = (np.arange(TILE_PX)[patch.rows] + key[1] * TILE_PX + 0.5) * -PIXEL_M
        norths.append(np.broadcast_to(rows[:, None], patch.seen.shape)[patch.seen])
    origin_m = UTM.metres(np.degrees([[PLANE.longitude_rad, PLANE.latitude_rad]]))[0, 1]
    return set(np.round(np.concatenate(norths) - origin_m).tolist())


def test_a_slope_that_faces_the_camera_is_found_behind_one_that_does_not():
    """A dyke across the view: its far side is not seen, the hill behind it is."""
    dyke = terrain_of(
        lambda north, _: np.interp(north, [22, 30, 31, 38, 60], [0.0, 3.0, 3.0, 0.0, 12.0])
    )
    pose = camera_pose([0.0, 0, -12.0], 0.0, -15.0, 0.0)
    shown = shown_norths_m(white_view(dyke, pose))
    assert {26.0, 45.0} <= shown  # the near face, and the hill
    assert not {33.0, 36.0} & shown  # the far face falls by 3 in 7, as seen from 9 m above


def test_where_the_elevation_model_has_no_height_nothing_is_shown():
    """A gap of 10 m, and the model's own end at 60 m to the north."""
    gap = terrain_of(
        lambda north, _: np.where((np.abs(north - 25.0) < 5.0) | (north > 60.0), np.nan, 0.0)
    )
    pose = camera_pose([0.0, 0, -20.0], 0.0, -30.0, 0.0)
    shown = shown_norths_m(white_view(gap, pose))
    assert {19.0, 35.0, 50.0} <= shown
    assert not {21.0, 25.0, 29.0} & shown
    assert max(shown) < 60.5


TILE = slice(0, TILE_PX)


def patch_of(value, score, rows=TILE, columns=TILE):
    shape = rows.stop - rows.start, columns.stop - columns.start
    scores = np.broadcast_to(np.asarray(score, np.float32), shape).copy()
    values = np.broadcast_to(np.asarray(value), shape).astype(np.uint16)
    return Patch(rows, columns, values, np.isfinite(scores), scores)


@pytest.fixture
def patches():
    """Two views whose scores cross in the middle column, and a third over a corner."""
    across = np.linspace(0.5, 1.5, TILE_PX)
    corner = slice(0, 100), slice(0, 50)
    return [patch_of(100, across), patch_of(200, across[::-1]), patch_of(900, 0.2, *corner)]


def mosaic(patches, *, hard=False):
    tile = MosaicTile.empty(1)
    for patch in patches:
        tile.add(patch, hard=hard)
    return tile.values()


@pytest.mark.parametrize("hard", [False, True], ids=["feathered", "hard"])
def test_the_order_does_not_matter(patches, hard):
    values, others = (mosaic(order, hard=hard)[0] for order in (patches, patches[::-1]))
    # Single precision, and a handful of sums: 1e-6 of the value.
    np.testing.assert_allclose(values, others, rtol=3e-6)


def test_the_best_view_is_on_top_and_the_seam_is_feathered(patches):
    values, observed = mosaic(patches)
    assert observed.all()
    row = values[300, :, 0]
    assert row[:200] == pytest.approx(100, abs=0.1)
    assert row[-200:] == pytest.approx(200, abs=0.1)
    assert np.diff(row).min() > -1e-4  # rounding
    assert np.diff(row).max() < 10  # a hard seam were 100
    assert row[TILE_PX // 2 - 1 : TILE_PX // 2 + 1].mean() == pytest.approx(150, abs=0.5)
    # A view 10 % worse has 1.1^-32 = 5 % of the weight.
    worse = int(np.searchsorted(np.linspace(0.5, 1.5, TILE_PX), 1.0 - 0.5 / 10.5))
    assert row[worse] == pytest.approx(100 + 100 * 0.045, abs=1)
    assert values[50, 20, 0] == pytest.approx(900)


def test_hard_values_are_those_of_the_best_view(patches):
    values, _ = mosaic(patches, hard=True)
    assert set(np.unique(values)) == {100.0, 200.0, 900.0}
    assert (values[300, : TILE_PX // 2, 0] == 100).all()
    assert (values[:100, :50] == 900).all()


def test_ground_that_no_picture_shows_is_unknown():
    tile = MosaicTile.empty(3)
    values, observed = tile.values()
    assert not observed.any()
    assert np.isfinite(values).all()
    part = patch_of(7, 1.0, slice(10, 20), slice(30, 50))
    tile.add(part._replace(values=np.dstack([part.values] * 3)))
    values, observed = tile.values()
    assert observed.sum() == 200
    assert (values[observed] == 7).all()
