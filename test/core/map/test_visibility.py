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
"""What a view returns of a map, drawn pixel by pixel, for any pose, map and lens."""

import cv2
import numpy as np
import pytest
from scenes import PLANE, camera_pose, map_of

from tirgeo_ros.core.camera.camera_model import NEAR_M, Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map import visibility as view_module
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer, VectorMap
from tirgeo_ros.core.map.visibility import FAR_M, View, farthest_m

LENSES = {
    "pinhole": Camera(640, 512, 500.0, 500.0, 319.5, 255.5),
    "xt2": XT2,
    "folds in the image": Camera(640, 512, 400.0, 400.0, 319.5, 255.5, (-0.30, 0, 0, 0)),
    "runs away": Camera(640, 512, 800.0, 800.0, 320.0, 256.0, (0.3, -0.9, 0.0, 0.0, 4.0)),
    "k3 folds": Camera(640, 512, 600.0, 600.0, 320.0, 256.0, (0.1, 0.2, 0.001, 0.001, -0.6)),
    "rational": Camera(
        640, 512, 400.0, 401.0, 320.0, 250.0, (0.9, 0.3, 6e-4, -4e-4, 0.01, 1.25, 0.55, 0.06)
    ),
    "rational with a pole": Camera(
        640, 512, 500.0, 500.0, 320.0, 256.0, (0.1, 0.0, 0.0, 0.0, 0.0, -0.4, 0.0, 0.0)
    ),
    "rational that folds": Camera(
        640, 512, 420.0, 420.0, 320.0, 256.0, (0.0, -0.1, 0.0, 0.0, 0.0, 0.2, 0.1, 0.0)
    ),
}
PINHOLE = LENSES["pinhole"]


def pose_at(height_m=20.0, pitch=-30.0, roll=0.0, yaw=0.0):
    return camera_pose([0.0, 0.0, -height_m], roll, pitch, yaw)


def test_marks_are_projected_points_of_the_image():
    pose = pose_at()
    points = [[35, 0, 0], [40, 3, 0], [35, 100, 0], [-20, 0, 0]]
    vector_map = map_of(*[[point] for point in points])
    marks = View(XT2).marks(vector_map, pose)
    wanted, _ = XT2.project(
        (np.array(points[:2], float) - pose.position_n) @ matrix_from_quat(pose.q_nc)
    )
    assert marks.owner.tolist() == [0, 1]
    np.testing.assert_allclose(np.concatenate(marks.split()), wanted, atol=1e-6)


@pytest.mark.parametrize("camera", [PINHOLE, XT2])
def test_a_visible_point_has_its_ray_to_the_map(camera):
    rng = np.random.default_rng(5)
    line = np.column_stack([rng.uniform(-50, 200, 40), rng.uniform(-80, 80, 40), np.zeros(40)])
    pose = pose_at(pitch=-20, roll=5)
    observed = View(camera).lines(map_of(line, [[35, 0, 0]]), pose)
    x, y, nearness = observed.rays
    points_c = np.stack([x, y, np.ones_like(x)]) / nearness
    points_n = matrix_from_quat(pose.q_nc) @ points_c + pose.position_n[:, None]
    assert points_n.shape == (3, observed.points.shape[1])
    uv, valid = camera.project((points_n.T - pose.position_n) @ matrix_from_quat(pose.q_nc))
    assert valid.mean() > 0.9  # but those cut at a limit itself
    np.testing.assert_allclose(uv[valid], observed.points.T[valid], atol=1e-6)
    # A tangent plane point at 200 m comes back to 1e-7 m; times 200 / 20 of slant.
    np.testing.assert_allclose(points_n[2], 0.0, atol=1e-5)


def test_ground_ends_sixteen_rows_under_the_horizon():
    """By what the camera itself projects: a point at the farthest, as high as the ground."""
    for height_m in (20.0, 100.0, 250.0):
        far_m = farthest_m(XT2, height_m)
        near_axis = Camera(640, 512, XT2.fx, XT2.fy, XT2.cx, XT2.cy)
        uv, _ = near_axis.project(np.array([[0.0, height_m, far_m], [0.0, 0.0, far_m]]))
        assert uv[0, 1] - uv[1, 1] == pytest.approx(16.0)
    assert farthest_m(XT2, 1000.0) == FAR_M
    for unknown in (np.nan, 0.0, -3.0):
        assert farthest_m(XT2, unknown) == FAR_M


def test_a_crowd_is_drawn_with_few_vertices_and_the_same_ink():
    """Ten thousand small outlines, most of them far off, against all of their vertices."""
    rng = np.random.default_rng(6)
    corners = 4.0 * np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]])
    places = rng.uniform([100, -1500, 0], [4000, 1500, 0], (10_000, 3))
    vector_map = map_of(*(place + corners for place in places))
    pose = pose_at(120, pitch=-5)
    observed = View(PINHOLE).lines(vector_map, pose)
    assert observed.points.shape[1] < 0.4 * vector_map.lines.points.shape[1]
    middle = corners[:4].mean(axis=0)
    truth, valid = PINHOLE.project(
        (places + middle - pose.position_n) @ matrix_from_quat(pose.q_nc)
    )
    truth = truth[valid]
    truth = truth[View(PINHOLE).inside(truth.T)]
    drawn = np.zeros((PINHOLE.height, PINHOLE.width), np.uint8)
    runs = [np.rint(run * 16).astype(np.int32) for run in observed.split()]
    cv2.polylines(drawn, runs, False, (255,), 1, cv2.LINE_AA, 4)
    off = cv2.distanceTransform((drawn == 0).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.floor(truth.T + 0.5).astype(int)
    # From 800 m on an outline's middle is at most 2 px from its ink, which may be off by 2 px and
    # be that of another one in its dot of 4 px.
    far = (-pose.position_n[2] * 500 / np.maximum(row - 212, 1)) > 800
    assert far.sum() > 3000
    assert off[row, column][far].max() < 2.0 + 2.0 + 4.0


CAMERAS = {name: LENSES[name] for name in ("xt2", "pinhole")}
EACH = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
#: Ink of a contour and rounding to 1/16 px: a pixel about an edge may be of either side.
EDGE = np.ones((5, 5), np.uint8)
FILL = LayerStyle(fill_bgr=(255, 0, 0))


def area_of(*rings):
    """One feature; its rings (N, 2) are north, east on the plane."""
    features = [
        GeoFeature(
            "",
            True,
            np.column_stack(PLANE.geodetic_from_ned(np.pad(ring, ((0, 0), (0, 1))))),
            group=0,
        )
        for ring in rings
    ]
    return VectorMap.from_layers([MapLayer("", features, FILL)], PLANE)


def wanted(camera, rings, pose):
    """(h, w) by the crossings of a ray along the ground from each pixel's place."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays_c = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]))
    rays_n = rays_c @ matrix_from_quat(pose.q_nc).T
    with np.errstate(invalid="ignore", divide="ignore"):
        north, east = (rays_n[:, :2] * (-pose.position_n[2] / rays_n[:, 2:])).T
        odd = np.zeros(len(north), bool)
        for ring in rings:
            ring = np.asarray(ring, float)  # noqa: PLW2901  meant
            for (n0, e0), (n1, e1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                spans = (n0 > north) != (n1 > north)
                if n0 != n1:
                    odd ^= spans & (east < e0 + (north - n0) / (n1 - n0) * (e1 - e0))
        odd &= rays_n[:, 2] > 0
    return 255 * odd.reshape(columns.shape).astype(np.uint8)


def assert_filled_as_wanted(camera, rings, pose, ink=EDGE):
    got, want = np.zeros((camera.height, camera.width), np.uint8), wanted(camera, rings, pose)
    areas = View(camera).areas(area_of(*rings), pose).split()
    if areas:
        fixed = [np.rint(ring * 16).astype(np.int32) for ring in areas]
        cv2.fillPoly(got, fixed, (255,), cv2.LINE_8, 4)
    inner = np.s_[2:-2, 2:-2]  # contours beside the image have ink in it
    assert not ((got > 0) & (cv2.dilate(want, ink) == 0))[inner].any()
    assert not ((want > 0) & (cv2.dilate(got, EDGE) == 0))[inner].any()
    return want


def ring_about(north, east, radius, corners=40, spread=0.0, seed=0):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    reach = radius * (1 + rng.uniform(-spread, spread, corners))
    return np.column_stack([north + reach * np.cos(angle), east + reach * np.sin(angle)])


@EACH
def test_a_polygon_in_the_image_with_a_hole(camera):
    rings = [ring_about(35, 0, 8), ring_about(35, 1, 3)]
    want = assert_filled_as_wanted(camera, rings, pose_at())
    assert 0.02 < (want > 0).mean() < 0.5


@EACH
def test_a_polygon_around_the_camera_fills_all_of_the_ground(camera):
    want = assert_filled_as_wanted(camera, [ring_about(0, 0, 5000)], pose_at(pitch=-60))
    assert (want > 0).sum() > 1e5


def test_a_lens_that_ends_within_the_picture_fills_nothing():
    vector_map = area_of(ring_about(35, 0, 8))
    assert len(View(LENSES["folds in the image"]).areas(vector_map, pose_at())) == 0


#: Rounding of ink at sharp corners may reach a pixel beyond ``EDGE``.
INK = np.ones((7, 7), np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values())
@pytest.mark.parametrize("seed", range(12))
def test_random_polygons(camera, seed):
    rng = np.random.default_rng(seed)
    north, east = rng.uniform(-30, 80), rng.uniform(-40, 40)
    outer = ring_about(north, east, rng.uniform(5, 80), 30, 0.5, seed)
    inner = ring_about(north, east, rng.uniform(1, 30), 12, 0.3, seed)
    pose = pose_at(
        rng.uniform(5, 60), rng.uniform(-90, 5), rng.normal(0, 15), rng.uniform(-90, 90)
    )
    assert_filled_as_wanted(camera, [outer, inner], pose, INK)


SAMPLES = 4000  # over 180 deg: below 0.7 px apart with a focal length of 800 px
#: Half of 0.7 px between samples, half a pixel where a sample is rounded to, a pixel of
#: anti-aliased ink, 0.1 px that a chord may leave its curve.
REACH_PX = 2
#: With simplified lines half a pixel more, and a row for what is drawn as spans.
DETAIL_REACH_PX = 3
RIM_PX = 4


def random_lines(rng):
    """Walks, outlines, walls and long lines: before, around and behind the camera, NED."""
    scale = 10 ** rng.uniform(0.5, 3.5)
    centre = rng.uniform(-scale, scale, 3) * [1, 1, 0]
    kind = rng.integers(5)
    if kind == 0:  # a road
        return centre + np.cumsum(rng.normal(0, scale / 20, (40, 3)) * [1, 1, 0.05], axis=0)
    if kind == 1:  # a house
        corners = np.array([[0, 0], [0, 1], [0.5, 1], [0.5, 0.5], [1, 0.5], [1, 0], [0, 0]])
        return centre + np.column_stack([corners * rng.uniform(3, 30, 2), np.zeros(7)])
    if kind == 2:  # an outline around the camera
        angle = np.linspace(0, 2 * np.pi, 30)
        ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        return ring * scale * rng.uniform(0.5, 1.5, (30, 1)) * [1, 1, 0]
    if kind == 3:  # anything, from behind to before
        return rng.uniform(-scale, scale, (4, 3))
    return rng.uniform(-1e5, 1e5, (2, 3)) * [1, 1, 1e-3]  # through the horizon


def random_case(seed):
    rng = np.random.default_rng(seed)
    camera = list(LENSES.values())[seed % len(LENSES)]
    lines = [random_lines(rng) for _ in range(rng.integers(1, 7))]
    angles_deg = rng.normal(0, 15), rng.uniform(-90, 15), rng.uniform(0, 360)
    position_n = [*rng.normal(0, 5, 2), -(10 ** rng.uniform(0, 2.5))]
    return camera, lines, camera_pose(position_n, *angles_deg)


def sampled(begin_c, end_c):
    """Points (N, 3) of segments at even angles as seen from the camera."""
    step = end_c - begin_c
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)[:, None]
    along = step / length
    foot = -(begin_c * along).sum(axis=1)[:, None]
    height = np.maximum(np.linalg.norm(begin_c + foot * along, axis=1), 1e-6)[:, None]
    first, last = np.arctan2(-foot, height), np.arctan2(length - foot, height)
    steps = np.ceil(SAMPLES * (last - first)[:, 0] / np.pi).astype(int) + 1
    row = np.repeat(np.arange(len(steps)), steps + 1)
    share = np.concatenate([np.linspace(0, 1, count + 1) for count in steps])[:, None]
    distance = foot[row] + height[row] * np.tan(first[row] + (last - first)[row] * share)
    return begin_c[row] + distance * along[row]


def by_points(camera, lines, pose):
    """The pixels of a map in the image and a rim, each sample by itself through OpenCV's lens."""
    rotation = matrix_from_quat(pose.q_nc)
    in_camera = [(line - pose.position_n) @ rotation for line in lines]
    points_c = sampled(
        np.concatenate([line[:-1] for line in in_camera]),
        np.concatenate([line[1:] for line in in_camera]),
    )
    points_c = points_c[(points_c[:, 2] > NEAR_M) & (points_c[:, 2] < FAR_M)]
    flat = points_c[:, :2] / points_c[:, 2:]
    points_c = points_c[np.hypot(*flat.T) <= camera.max_radius]
    image = np.zeros((camera.height + 2 * RIM_PX, camera.width + 2 * RIM_PX), np.uint8)
    if len(points_c):
        zero, distortion = np.zeros(3), np.array(camera.distortion or (0.0,) * 4)
        uv, _ = cv2.projectPoints(points_c, zero, zero, camera.matrix, distortion)
        column, row = np.rint(uv[:, 0].T).astype(int) + RIM_PX
        height, width = image.shape
        observed = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        image[row[observed], column[observed]] = 255
    return image


def drawn(camera, lines, pose):
    image = np.zeros((camera.height, camera.width), np.uint8)
    runs = View(camera).lines(map_of(*lines), pose).split()
    fixed = [np.rint(run * 16).astype(np.int32) for run in runs]
    cv2.polylines(image, fixed, False, (255,), 1, cv2.LINE_AA, 4)
    return image


def grown(image, radius):
    return cv2.dilate(image, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))


def assert_no_ghost_and_nothing_lost(case, reach, name):
    camera, lines, pose = case
    wanted, got = by_points(camera, lines, pose), drawn(camera, lines, pose)
    inner = np.s_[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
    ghosts = (got > 0) & (grown(wanted, reach)[inner] == 0)
    lost = (wanted[inner] > 0) & (grown(got, reach) == 0)
    lost[[0, -1]] = lost[:, [0, -1]] = False  # OpenCV draws no ink of a line beside the image
    assert not ghosts.any(), f"{name}: {ghosts.sum()} pixels drawn that are not of the map"
    assert not lost.any(), f"{name}: {lost.sum()} pixels of the map not drawn"
    return bool(wanted.any())


def assert_views(seeds, reach=REACH_PX):
    observed = [
        assert_no_ghost_and_nothing_lost(random_case(k), reach, f"seed {k}") for k in seeds
    ]
    assert sum(observed) > len(seeds) / 2


def test_no_ghost_and_nothing_lost():
    assert_views(range(120))


def test_simplified_lines_leave_no_ghost_either(monkeypatch):
    monkeypatch.setattr(view_module, "_FEW_VERTICES", -1)
    assert_views(range(5000, 5120), DETAIL_REACH_PX)


AROUND = [[-30, -30, 0], [-30, 30, 0], [30, 30, 0], [30, -30, 0], [-30, -30, 0]]


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize(
    ("line", "pitch_deg"),
    [
        pytest.param(AROUND, -35, id="around the camera"),
        pytest.param([[-50, 3, 0], [1e5, 3, 0]], 0, id="to the vanishing point"),
        pytest.param([[-50, 3, 0], [1e4, 3, -2e3]], 0, id="through the horizon"),
        pytest.param([[10, 15, -28], [10, 15, -12]], 0, id="beyond the fold"),
        pytest.param([[10, -9, -17.1], [10, 9, -17.1]], 0, id="bent by the lens"),
    ],
)
def test_each_lens_draws_the_named_lines(camera, line, pitch_deg):
    pose = camera_pose([0.0, 0.0, -20.0], 0.0, pitch_deg)
    assert_no_ghost_and_nothing_lost((camera, [np.array(line, float)], pose), REACH_PX, "named")
