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
"""Labels: near their features, without overlap, and steady from frame to frame."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scenes import PLANE, camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer, VectorMap
from tirgeo_ros.core.map.visibility import View
from tirgeo_ros.core.overlay.label_placement import AnchorFinder, Labels
from tirgeo_ros.core.overlay.written_text import Box

CAMERA = Camera(640, 512, 640.0, 640.0, 319.5, 255.5)
HEIGHT_M = 64.0  # a metre is ten pixels, straight down
STRIP = Box(0, 484, 640, 512)


def pose(north=0.0, east=0.0, yaw_deg=0.0, down_deg=90.0):
    return camera_pose([north, east, -HEIGHT_M], 0.0, -down_deg, yaw_deg, 1e-4)


def feature(label, *places_px, closed=False):
    """A feature whose points lie at these pixels of the plain pose."""
    uv = np.array(places_px, float)
    north, east = (255.5 - uv[:, 1]) / 10, (uv[:, 0] - 319.5) / 10
    places = PLANE.geodetic_from_ned(np.stack([north, east, np.zeros(len(uv))], -1))
    return GeoFeature(label, closed, np.stack(places, -1))


class Placed(NamedTuple):
    box: Box
    anchor: np.ndarray  # pixel
    ray: np.ndarray


class Scene:
    """One map's labels on frames of a video."""

    def __init__(self, *layers):
        styled = [MapLayer("", each, LayerStyle()) for each in layers]
        self.map = VectorMap.from_layers(styled, PLANE)
        self.anchors, self.labels, self.view = AnchorFinder(self.map), Labels(), View(CAMERA)
        self.size = CAMERA.height, CAMERA.width, 3

    def place(self, at=None, taken=(STRIP,)):
        at = at or pose()
        lines, marks = self.view.lines(self.map, at), self.view.marks(self.map, at)
        found = self.anchors.find(lines, marks, self.labels.shown)
        image = np.zeros(self.size, np.uint8)
        labels = self.labels.place(image, self.map.labels, found, marks.points, taken)
        names = [self.map.labels[feature] for feature in found.feature]
        return {
            names[row]: Placed(box, found.uv[:, row], found.rays[:, row]) for row, box in labels
        }


def middle(label):
    box = label.box
    return np.array([(box.left + box.right) / 2, (box.top + box.bottom) / 2])


def test_a_label_stands_under_an_outline_smaller_than_itself():
    corners = (300, 200), (312, 200), (312, 212), (300, 212)
    box = Scene([feature("Park", *corners, closed=True)]).place()["Park"].box
    assert box.top >= 211
    assert abs((box.left + box.right) / 2 - 306) <= 1


def test_a_label_of_a_bent_outline_stands_in_it_and_not_in_its_bay():
    bay = feature(
        "Bay", *[(100, 100), (500, 100), (500, 170), (180, 170)],
        *[(180, 330), (500, 330), (500, 400), (100, 400)], closed=True,
    )  # fmt: skip
    u, v = middle(Scene([bay]).place()["Bay"])
    assert 100 < u < 180
    assert 170 < v < 330


def test_a_label_of_a_line_is_at_its_middle_on_the_line():
    bent = feature("Way", (100, 400), (100, 100), (500, 100))
    label = Scene([bent]).place()["Way"]
    u, v = label.anchor
    assert min(abs(u - 100), abs(v - 100)) < 0.1
    assert math.hypot(u - 100, v - 100) < 160  # near the bend, where the middle is


def test_a_mark_is_not_hidden_by_its_label():
    result = Scene([feature("Tree", (300, 200))]).place()["Tree"]
    box = result.box
    assert box.left >= 300 + 5
    assert box.top < 200 < box.bottom
    assert result.anchor == pytest.approx((300, 200), abs=1e-6)


def test_an_anchor_has_its_ray_to_the_map():
    """Of a mark, of a way and of an outline, on level ground: the ray meets the ground there."""
    features = [feature("Tree", (120, 90)), feature("Way", (400, 300), (400, 100), (600, 90))]
    bay = [(100, 200), (350, 200), (350, 230), (140, 230), (140, 400), (350, 400), (350, 430)]
    scene = Scene([*features, feature("Bay", *bay, (100, 430), closed=True)])
    for at in (pose(), pose(north=-60.0, down_deg=50.0)):
        result = scene.place(at).values()
        assert len(result) == 3
        for label in result:
            x, y, nearness = label.ray
            point_c = np.array([[x, y, 1.0]]) / nearness
            np.testing.assert_allclose(CAMERA.project(point_c)[0][0], label.anchor, atol=1e-6)
            point_n = at.position_n + matrix_from_quat(at.q_nc) @ point_c[0]
            assert abs(point_n[2]) < 1e-3  # the earth's curvature over 100 m


def test_upper_layers_come_first():
    """On one place there is room for some of many labels: those of the upper layer."""
    low = [feature(f"low {i}", (300, 200)) for i in range(20)]
    high = [feature(f"high {i}", (300, 200)) for i in range(2)]
    result = Scene(low, high).place()
    assert {"high 0", "high 1"} <= set(result)
    assert len(result) < 22


def test_labels_are_calm_in_a_slow_pan():
    """At 60 frames of 1 px each, of 60 marks: hardly a label changes sides, none flickers."""
    places = np.random.default_rng(1).uniform((-60, 40), (600, 450), (60, 2))
    scene = Scene([feature(f"tree {i}", place) for i, place in enumerate(places)])
    jumps = shown = flickers = 0
    last, gone = {}, {}
    for frame in range(60):
        result = scene.place(pose(east=-0.1 * frame))
        offset = {name: middle(label) - label.anchor for name, label in result.items()}
        shown += len(result)
        for name, at in offset.items():
            if name in last:
                jumps += np.abs(at - last[name]).max() > 2.5  # two roundings, and the edge's slide
            flickers += name in gone and frame - gone[name] < 10
        gone |= dict.fromkeys(last.keys() - result.keys(), frame)
        last = offset
    assert shown > 60 * 20
    assert jumps <= 6  # a label that another one, or the edge, drives away: one in ten
    assert flickers <= 3
