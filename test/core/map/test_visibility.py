"""What is drawn, against the map's segments sampled point by point through the lens."""

import itertools
import math

import cv2
import numpy as np
import pytest
from camera_poses import camera_pose
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.camera.camera_model import NEAR_M, XT2, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.layers import GeoFeature, MapLayer
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import CHORD_PX, FAR_M, View

PLANE = TangentPlane(math.radians(48.2), math.radians(16.4), 200.0)
PINHOLE = Camera(640, 512, 500.0, 500.0, 319.5, 255.5)
FOLDING = Camera(640, 512, 400.0, 400.0, 319.5, 255.5, (-0.30, 0.0, 0.0, 0.0))
BARREL = Camera(640, 512, 420.0, 425.0, 318.0, 250.0, (-0.28, 0.09, 0.001, -0.0005))
RUNAWAY = Camera(640, 512, 800.0, 800.0, 320.0, 256.0, (0.3, -0.9, 0.0, 0.0, 4.0))
CAMERAS = {"pinhole": PINHOLE, "xt2": XT2, "folds": FOLDING, "barrel": BARREL, "runs": RUNAWAY}
EACH = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
#: Chords may leave the lens's curve by CHORD_PX; the rest is for the samples between which the
#: lens's bend was measured.
WITHIN_PX = 1.2 * CHORD_PX
SAMPLES = 1500  # over at most 180 deg: below 3 px apart with a focal length of 800 px


def pose_at(position_n=(0, 0, -20), roll=0.0, pitch=-30.0, yaw=0.0):
    return camera_pose(position_n, roll, pitch, yaw)


def laid(features):
    return VectorMap.from_layers([MapLayer("", features)], PLANE)


def map_of(*lines, closed=False):
    return laid(
        [
            GeoFeature("", closed, np.column_stack(PLANE.geodetic_from_ned(np.array(line, float))))
            for line in lines
        ]
    )


def sampled(camera, pose, vector_map):
    """Pixels (N, 2) in the image of the map's segments, sampled evenly by view angle."""
    rotation = matrix_from_quat(pose.q_nc)
    found = [np.empty((0, 2))]
    for line in vector_map.lines.split():
        for a, b in itertools.pairwise((line - pose.position_n) @ rotation):
            points_c = samples_by_angle(a, b)
            uv, valid = camera.project(points_c)
            found.append(uv[valid & (points_c[:, 2] <= FAR_M)])
    uv = np.concatenate(found)
    return uv[View(camera).inside(uv.T)]


def samples_by_angle(a, b):
    """Points (N, 3) of a segment at even angles as seen from the origin."""
    step = b - a
    foot = -(a @ step) / (step @ step)
    height = max(np.linalg.norm(a + foot * step), 1e-6) / np.linalg.norm(step)
    angle = np.linspace(np.arctan2(-foot, height), np.arctan2(1 - foot, height), SAMPLES)
    return a + (foot + height * np.tan(angle))[:, None] * step


def distance_to_lines(uv, lines):
    """(N,) distance of pixels to the nearest drawn line."""
    best = np.full(len(uv), np.inf)
    for line in lines:
        for a, b in itertools.pairwise(line):
            along = np.clip((uv - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
            best = np.minimum(best, np.hypot(*(uv - a - along[:, None] * (b - a)).T))
    return best


def densified(lines):
    """Points (N, 2) on the drawn lines, at most 2 px apart."""
    points = [np.empty((0, 2))]
    for line in lines:
        for a, b in itertools.pairwise(line):
            count = 2 + int(np.hypot(*(b - a)) / 2)
            points.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
    return np.concatenate(points)


def assert_drawn_as_sampled(camera, pose, vector_map):
    view = View(camera)
    lines = view.lines(vector_map, pose).split()
    truth = sampled(camera, pose, vector_map)
    if len(truth):
        assert distance_to_lines(truth, lines).max() < WITHIN_PX
    drawn = densified(lines)
    drawn = drawn[view.inside(drawn.T)]
    if len(drawn) and len(truth):
        # No ghost: something of the truth lies within the samples' spacing of all that is drawn.
        nearest = np.min(np.hypot(*(drawn[:, None] - truth[None]).T), axis=0)
        assert nearest.max() < 4.0
    return lines, truth, drawn


@pytest.mark.slow
@EACH
@given(
    seed=st.integers(0, 2**31),
    roll=st.floats(-30, 30),
    pitch=st.floats(-90, 10),
    yaw=st.floats(-180, 180),
)
def test_random_segments(camera, seed, roll, pitch, yaw):
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(0, 3)
    line = rng.uniform(-scale, scale, (3, 3)) * [1, 1, 0.02]
    pose = pose_at(roll=roll, pitch=pitch, yaw=yaw)
    _, truth, drawn = assert_drawn_as_sampled(camera, pose, map_of(line))
    # Where the samples saw nothing at all, only a corner of a few pixels may have been drawn.
    assert len(truth) or len(drawn) < 5


@EACH
def test_a_polygon_around_the_camera(camera):
    ring = [[-30, -30, 0], [-30, 30, 0], [30, 30, 0], [30, -30, 0]]
    vector_map = map_of(ring, closed=True)
    lines, truth, _ = assert_drawn_as_sampled(camera, pose_at(pitch=-35), vector_map)
    assert len(truth) > 100
    assert len(lines) >= 1


@EACH
def test_a_line_through_the_horizon(camera):
    pose = pose_at(pitch=0.0)
    along = map_of([[-50, 3, 0], [1e5, 3, 0]])
    lines, truth, drawn = assert_drawn_as_sampled(camera, pose, along)
    assert len(lines) == 1
    assert len(truth) > 100
    # It ends at its vanishing point, the principal point, and never rises above it.
    assert drawn[:, 1].min() == pytest.approx(camera.cy, abs=1.0)
    rising = map_of([[-50, 3, 0], [1e4, 3, -2e3]])
    assert_drawn_as_sampled(camera, pose, rising)


def test_a_line_beyond_the_fold_leaves_no_ghost():
    """At r = 1.5 this lens's polynomial gives 0.49, the middle of the image's half width."""
    uv = FOLDING.cx + 400 * 1.5 * (1 - 0.3 * 1.5**2)
    assert 0 < uv < 639
    pose = pose_at((0, 0, 0), pitch=0.0)
    ghost = map_of([[10, 15, -8], [10, 15, 8]])
    assert len(View(FOLDING).lines(ghost, pose)) == 0
    across = map_of([[10, -15, 1], [10, 15, 1]])
    lines, _, _ = assert_drawn_as_sampled(FOLDING, pose, across)
    assert len(lines) == 1


def test_a_long_line_bends_with_the_lens():
    pose = pose_at((0, 0, 0), pitch=0.0)
    across = map_of([[10, -9, 2.9], [10, 9, 2.9]])
    line = View(XT2).lines(across, pose).split()[0]
    chord = line[0] + np.linspace(0, 1, 50)[:, None] * (line[-1] - line[0])
    assert distance_to_lines(chord, [line]).max() > 2.0  # a straight line would be off by this
    assert len(line) > 20


def test_culling_loses_nothing_and_keeps_owners():
    rng = np.random.default_rng(3)
    lines = [
        rng.uniform(-300, 300, (1, 3)) * [1, 1, 0] + rng.normal(0, 5, (5, 3)) for _ in range(400)
    ]
    pose = pose_at(pitch=-25, yaw=60)
    together = View(XT2).lines(map_of(*lines), pose)
    assert 5 < len(set(together.owner.tolist())) < 200
    for number, line in enumerate(lines):
        alone = View(XT2).lines(map_of(line), pose).split()
        of_map = [x for x, o in zip(together.split(), together.owner, strict=True) if o == number]
        assert len(alone) == len(of_map)
        for one, other in zip(alone, of_map, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)


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


@EACH
def test_nothing_nearer_than_the_near_plane_is_drawn(camera):
    pose = pose_at((0, 0, 0), pitch=0.0)
    assert len(View(camera).lines(map_of([[0.05, -1, 0], [0.05, 1, 0]]), pose)) == 0
    # From 5 cm to 10 m ahead, 1 cm to the right: it begins where z = NEAR_M.
    line = View(camera).lines(map_of([[0.05, 0.01, 0], [10, 0.01, 0]]), pose).split()[0]
    start, _ = camera.project(np.array([[0.01, 0.0, 1.0001 * NEAR_M]]))
    np.testing.assert_allclose(line[0], start[0], atol=0.05)  # 1e-4 of 80 px


@EACH
def test_what_is_seen_knows_its_place_on_the_map(camera):
    rng = np.random.default_rng(5)
    line = np.column_stack([rng.uniform(-50, 200, 40), rng.uniform(-80, 80, 40), np.zeros(40)])
    pose = pose_at(pitch=-20, roll=5)
    seen = View(camera).lines(map_of(line, [[35, 0, 0]]), pose)
    x, y, nearness = seen.rays
    points_c = np.stack([x, y, np.ones_like(x)]) / nearness
    points_n = matrix_from_quat(pose.q_nc) @ points_c + pose.position_n[:, None]
    assert points_n.shape == (3, seen.points.shape[1])
    uv, valid = camera.project((points_n.T - pose.position_n) @ matrix_from_quat(pose.q_nc))
    assert valid.mean() > 0.9  # but those cut at a limit itself
    np.testing.assert_allclose(uv[valid], seen.points.T[valid], atol=1e-6)
    # A tangent plane point at 200 m comes back to 1e-7 m; times 200 / 20 of slant.
    np.testing.assert_allclose(points_n[2], 0.0, atol=1e-5)


def test_what_is_too_far_is_not_drawn():
    pose = pose_at(pitch=0.0)
    near, far = [[15_000, -50, 0], [15_000, 50, 0]], [[25_000, -50, 0], [25_000, 50, 0]]
    assert View(PINHOLE).lines(map_of(near, far), pose).owner.tolist() == [0]
    assert len(View(PINHOLE).lines(map_of(near, far), pose, far_m=10_000)) == 0


def test_ground_ends_sixteen_rows_under_the_horizon():
    """By what the camera itself projects: a point at the farthest, as high as the ground."""
    view = View(XT2)
    for height_m in (20.0, 100.0, 250.0):
        far_m = view.farthest_m(height_m)
        near_axis = Camera(640, 512, XT2.fx, XT2.fy, XT2.cx, XT2.cy)
        uv, _ = near_axis.project(np.array([[0.0, height_m, far_m], [0.0, 0.0, far_m]]))
        assert uv[0, 1] - uv[1, 1] == pytest.approx(16.0)
    assert view.farthest_m(1000.0) == FAR_M
    for unknown in (np.nan, 0.0, -3.0):
        assert view.farthest_m(unknown) == FAR_M


def test_a_crowd_is_drawn_with_few_vertices_and_the_same_ink():
    """Ten thousand small outlines, most of them far off, against all of their vertices."""
    rng = np.random.default_rng(6)
    corners = 4.0 * np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]])
    places = rng.uniform([100, -1500, 0], [4000, 1500, 0], (10_000, 3))
    vector_map = map_of(*(place + corners for place in places))
    pose = pose_at((0, 0, -120), pitch=-5)
    seen = View(PINHOLE).lines(vector_map, pose)
    assert seen.points.shape[1] < 0.4 * vector_map.lines.points.shape[1]
    middle = corners[:4].mean(axis=0)
    truth, valid = PINHOLE.project(
        (places + middle - pose.position_n) @ matrix_from_quat(pose.q_nc)
    )
    truth = truth[valid]
    truth = truth[View(PINHOLE).inside(truth.T)]
    drawn = np.zeros((PINHOLE.height, PINHOLE.width), np.uint8)
    runs = [np.rint(run * 16).astype(np.int32) for run in seen.split()]
    cv2.polylines(drawn, runs, False, (255,), 1, cv2.LINE_AA, 4)
    off = cv2.distanceTransform((drawn == 0).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.floor(truth.T + 0.5).astype(int)
    # From 800 m on an outline's middle is at most 2 px from its ink, which may be off by 2 px and
    # be that of another one in its dot of 4 px.
    far = (-pose.position_n[2] * 500 / np.maximum(row - 212, 1)) > 800
    assert far.sum() > 3000
    assert off[row, column][far].max() < 2.0 + 2.0 + 4.0
