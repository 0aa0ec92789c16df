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
"""Which lines fade and which ellipses are drawn: by errors and in pixels."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scenes import camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import FrameConfidence, rays_to
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.uncertainty_rendering import (
    FAINTEST,
    MOST_ELLIPSES,
    STEP_PX,
    Anchors,
    cut,
    marked,
    outlines,
    sampled,
    with_ellipses,
    with_marks,
)

CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
HEIGHT_M = 20.0
#: Of a map point straight below: 40 px to a metre.
PX_PER_M = CAMERA.fx / HEIGHT_M
#: Only the map's own error, or the pose's.
PLAIN = ConfidenceConfig(
    latency_sigma_s=0.0, lens_sigma_px=0.0, map_sigma_m=0.0, ground_sigma_m=0.0
)
RADIUS = math.sqrt(5.991465)
MARK_PX = 7


def pose_at(down_deg=90.0, covariance=None, height_m=HEIGHT_M):
    return camera_pose([0.0, 0.0, -height_m], 0.0, -down_deg, 0.0, covariance)


def seen_from(pose, *lines):
    """Lines of pixels (n, 2), as they are seen on level ground."""
    starts = np.cumsum([0, *map(len, lines)])
    uv = np.concatenate([np.empty((0, 2)), *[np.array(line, float) for line in lines]])
    rays_n = CAMERA.rays(uv) @ matrix_from_quat(pose.q_nc).T
    points_n = pose.position_n - pose.position_n[2] / rays_n[:, 2:] * rays_n
    return VisibleLines(uv.T, starts, np.arange(len(lines)), rays_to(CAMERA, pose, points_n))


#: Of 95 %, for a point of the map straight below that errs by a metre.
RADIUS_PX_PER_M = RADIUS * PX_PER_M


def faded_lines(config, pose, lines, sigma_m=None):
    none = anchors_at(pose, [])
    return marked(config, FrameConfidence(config, CAMERA, pose), lines, none, sigma_m)[:2]


def faded(sigma_m, pose=None, **changes):
    pose = pose or pose_at()
    config = dataclasses.replace(PLAIN, **changes)
    lines = seen_from(pose, [(100, 200), (110, 205), (125, 200)])
    return faded_lines(config, pose, lines, np.array([sigma_m]))


@pytest.mark.parametrize(
    ("share", "opacity"),
    [(0.3, 1.0), (0.4, 0.75), (0.7, 0.5), (0.97, 0.5), (1.03, 0.25), (50, 0.25)],
)
def test_opacity_falls_to_the_faintest_at_the_configured_radius(share, opacity):
    fade_px = 37.0
    lines, result = faded(share * fade_px / RADIUS_PX_PER_M, fade_px=fade_px)
    assert result.tolist() == [opacity]
    assert len(lines) == 1


def test_a_line_of_unknown_uncertainty_is_faintest():
    none = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0])
    assert faded(0.0, pose_at(covariance=none))[1].tolist() == [FAINTEST]


def test_a_long_line_fades_along_its_way():
    """Seen from above, an error of yaw moves the picture's sides, not its middle."""
    covariance = np.zeros((6, 6))
    covariance[5, 5] = math.radians(2.0) ** 2
    pose = pose_at(covariance=covariance)
    config = dataclasses.replace(PLAIN, fade_px=20.0)
    lines = seen_from(pose, [(319.5, 255.5), (639, 255.5)], [(10, 10), (20, 12), (24, 19)])
    cut_lines, opacity = faded_lines(config, pose, lines)
    first = opacity[cut_lines.owner == 0]
    assert (np.diff(first) < 0).all()
    assert first[0] == 1.0
    assert first[-1] == FAINTEST
    pieces = [
        line for line, owner in zip(cut_lines.split(), cut_lines.owner, strict=True) if owner == 0
    ]
    for before, after in itertools.pairwise(pieces):
        assert before[-1].tolist() == after[0].tolist()
    # it has become faintest within a step of where the radius is fade_px
    expected = 20.0 / RADIUS / math.radians(2.0)
    assert abs(pieces[-1][0, 0] - 319.5 - expected) <= STEP_PX
    np.testing.assert_array_equal(cut_lines.split()[-1], [(10, 10), (20, 12), (24, 19)])


def test_cut_lines_are_the_same_lines():
    """Every segment once, in its line, with the value of its way; seeded at random."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        lengths = rng.integers(2, 40, rng.integers(1, 12))
        pixels = [
            rng.uniform(0, 600, 2) + rng.normal(0, 9, (n, 2)).cumsum(axis=0) for n in lengths
        ]
        lines, samples = sampled(seen_from(pose_at(), *pixels), STEP_PX)
        value = rng.integers(0, 2, len(samples.line) - 1)
        runs, first = cut(lines, samples, value)
        expected = {}
        for k in np.flatnonzero(samples.links()):
            for v in range(samples.vertex[k], samples.vertex[k + 1]):
                key = tuple(lines.points[:, v]) + tuple(lines.points[:, v + 1])
                expected[key] = (samples.line[k], value[k])
        result = {}
        for run, owner, way in zip(runs.split(), runs.owner, first, strict=True):
            for a, b in itertools.pairwise(run):
                assert (*a, *b) not in result
                result[(*a, *b)] = (owner, value[way])
        assert result == expected


def ellipses_of(pose, anchors, sigma_m=None):
    frame = FrameConfidence(PLAIN, CAMERA, pose)
    result = marked(PLAIN, frame, seen_from(pose), anchors, sigma_m)
    return result, outlines(anchors, result, np.arange(len(anchors.owner)), MARK_PX)


def anchors_at(pose, uv):
    lines = seen_from(pose, *[[point] for point in uv])
    return Anchors(lines.points, lines.rays, lines.owner, np.ones(len(lines), bool))


def test_ellipses_are_the_covariances():
    covariance = np.diag([0.2**2, 0.4**2, 0.0, 0.0, 0.0, 0.0])  # north is up in the picture
    pose = pose_at(covariance=covariance)
    result, drawn = ellipses_of(pose, anchors_at(pose, [(319.5, 255.5), (100, 80)]))
    assert not result.uncertain.any()
    dashes = len(drawn) // 2
    assert drawn.owner.tolist() == [0] * dashes + [1] * dashes
    assert dashes > 5
    middles = np.repeat([(319.5, 255.5), (100, 80)], dashes, axis=0)
    for line, middle in zip(drawn.split(), middles, strict=True):
        off = (line - middle) / (np.array([0.4, 0.2]) * PX_PER_M)
        np.testing.assert_allclose((off**2).sum(axis=1), 5.991465, rtol=1e-6)


def test_an_ellipse_as_large_as_the_picture_is_a_hint():
    pose = pose_at()
    sigma_m = np.array([127.0, 129.0, 1e4]) / RADIUS_PX_PER_M
    anchors = anchors_at(pose, [(200, 200), (300, 200), (400, 200)])
    result, drawn = ellipses_of(pose, anchors, sigma_m)
    assert result.uncertain.tolist() == [False, True, True]
    dashes = np.bincount(drawn.owner)
    assert dashes[0] == dashes[1] == dashes[2] > 3
    points = np.diff(drawn.starts)
    assert points[drawn.owner > 0].max() < points[drawn.owner == 0].min()
    off = drawn.points.T - anchors.uv.T[np.repeat(drawn.owner, points)]
    assert np.hypot(*off.T).max() <= 128 + 1e-9  # a quarter of 512 rows


def test_an_anchor_beyond_first_order_is_uncertain():
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 3.0**2  # of 20 m
    pose = pose_at(covariance=covariance)
    assert ellipses_of(pose, anchors_at(pose, [(330, 256)]))[0].uncertain.all()
    none = pose_at(covariance=-np.eye(6))
    result, drawn = ellipses_of(none, anchors_at(none, [(330, 256)]))
    assert result.uncertain.all()
    assert len(drawn) == 0


def test_labels_have_their_ellipses_before_other_marks():
    """At most MOST_ELLIPSES in all; one of the labels belongs to a mark that is visible too."""
    pose = pose_at(down_deg=40.0)
    uv = np.random.default_rng(5).uniform(0.2, 1, (500, 2)) * [639, 511]
    marks = seen_from(pose, *[[point] for point in uv])
    labelled = anchors_at(pose, np.random.default_rng(6).uniform(200, 250, (30, 2)))
    labelled = labelled._replace(owner=np.arange(30) + 499)
    anchors = with_marks(labelled, marks)
    chosen = with_ellipses(anchors, np.arange(30))
    numbers = anchors.owner[chosen].tolist()
    assert len(set(numbers)) == len(numbers) == MOST_ELLIPSES
    nearest = np.sort(marks.rays[2])[-MOST_ELLIPSES]
    assert anchors.rays[2, chosen[30:]].min() >= nearest
    few = with_marks(labelled, seen_from(pose, [(300, 200)]))
    assert few.owner[with_ellipses(few, np.arange(30))].tolist() == [*range(499, 529), 0]
    assert len(with_ellipses(anchors, np.arange(5))) == MOST_ELLIPSES  # and of labels without room
