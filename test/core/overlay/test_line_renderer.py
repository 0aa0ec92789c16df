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
"""The map's ink: where it is, where it is not, and in which style."""

import numpy as np
import pytest

from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.map.vector_map import LayerStyle
from tirgeo_ros.core.overlay.map_renderer import FADES, LineRenderer

GREY = 128
#: OpenCV's anti-aliased line is no stronger than this in its middle.
FULL = 230 / 255
YELLOW = LayerStyle(line_bgr=(0, 255, 255))


def picture(height=200, width=300):
    return np.full((height, width, 3), GREY, np.uint8)


def polylines(*lines, owner=None):
    starts = np.cumsum([0, *map(len, lines)])
    points = np.concatenate([np.empty((0, 2)), *lines]).T
    return Polylines(points, starts, np.arange(len(lines)) if owner is None else np.array(owner))


def drawn(lines, *styles, layer=None, opacity=None, image=None):
    image = picture() if image is None else image
    layer = np.zeros(len(lines), np.int64) if layer is None else np.array(layer)
    LineRenderer().strokes(image, lines, layer, styles or (YELLOW,), opacity)
    return image


def filled(rings, *styles):
    image = picture()
    LineRenderer().areas(image, rings, np.zeros(len(rings), np.int64), styles)
    return image


def square(left, top, size):
    return np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + [left, top]


def ink(image):
    """(N, 2) pixels of yellow and how strong they are."""
    strength = image[:, :, 2].astype(int) - image[:, :, 0]
    v, u = np.nonzero(strength > 0)
    return np.column_stack([u, v]), strength[v, u]


@pytest.mark.parametrize("slope", [-2.0, -0.3, 0.0, 0.7, 5.0])
@pytest.mark.parametrize("width", [1, 2, 3, 4, 5])
def test_the_ink_lies_on_the_line(slope, width):
    """Sub-pixel too: the ink's centre is off by a sixteenth of a pixel, the unit of drawing.

    The wider ones' ends, which are cut square to the picture, add as much.
    """
    direction = np.array([1, slope]) / np.hypot(1, slope)
    middle = np.array([150.37, 100.81])
    line = polylines([middle - 80 * direction, middle + 80 * direction])
    image = drawn(line, LayerStyle(width_px=width), image=picture(512, 640))
    pixels, strength = ink(image)
    offset = (pixels - middle) @ [-direction[1], direction[0]]
    # Anti-aliased ink of one pixel is up to three wide; a square grows by its diagonal.
    assert np.abs(offset).max() < 2 + (width - 1) / 2 * np.sqrt(2)
    assert abs(np.average(offset, weights=strength)) < (1 if width == 1 else 2) / 16


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5])
def test_a_line_is_as_wide_as_its_layer_says(width):
    line = polylines([[20.0, 100.0 + (width % 2 == 0) / 2], [600.0, 100.0 + (width % 2 == 0) / 2]])
    image = drawn(line, LayerStyle(width_px=width), image=picture(512, 640))
    assert np.count_nonzero(image[:, 300, 2] > 200) == width


def test_upper_layers_lie_over_lower_ones():
    red, blue = LayerStyle((0, 0, 255), 3), LayerStyle((255, 0, 0), 3)
    cross = polylines([[20.0, 100.0], [280.0, 100.0]], [[150.0, 20.0], [150.0, 180.0]])
    for layer, wanted in (([0, 1], [255, 0, 0]), ([1, 0], [0, 0, 255])):
        styles = (red, blue) if layer == [0, 1] else (blue, red)
        image = drawn(cross, *styles, layer=layer, image=picture(512, 640))
        assert image[100, 150].argmax() == np.argmax(wanted)
        assert image[100, 150].max() >= FULL * 255
        assert np.partition(image[100, 150], 1)[1] <= (1 - FULL) * 255


def test_an_uncertain_line_fades_and_its_halo_with_it():
    lines = polylines(*([[20.0, 20.0 * k], [280.0, 20.0 * k]] for k in range(1, 6)))
    image = drawn(lines, opacity=np.array([0.0, 0.25, 0.5, 0.75, 1.0])).astype(int)
    yellow = image[20:101:20, 150, 1] - image[20:101:20, 150, 0]
    halo = GREY - image[22:103:20, 150, 1]
    assert yellow[0] == halo[0] == 0
    assert (np.diff(yellow) > 20).all()
    assert (np.diff(halo) > 10).all()
    assert len(yellow) == FADES + 1


GREEN = LayerStyle(fill_bgr=(0, 200, 0), fill_opacity=0.25)
MIXED = [96, 146, 96]  # three quarters of the grey and one of the green


def test_an_area_is_mixed_with_the_picture():
    image = filled(polylines(square(50, 50, 100)), GREEN)
    assert np.abs(image[55:145, 55:145] - np.array(MIXED)).max() <= 1
    assert (image[:49] == GREY).all()
    assert (image[152:] == GREY).all()


def test_a_hole_stays_open_and_an_island_in_it_is_filled():
    rings = polylines(square(20, 20, 150), square(50, 50, 90), square(80, 80, 30), owner=[0] * 3)
    image = filled(rings, GREEN)
    assert abs(int(image[30, 30, 1]) - 146) <= 1
    assert (image[60, 60] == GREY).all()
    assert abs(int(image[95, 95, 1]) - 146) <= 1


@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (300, 5)])
def test_tiny_pictures(shape):
    image, painter = picture(*shape), LineRenderer()
    painter.areas(image, polylines(square(-50, -50, 900)), np.zeros(1, int), [GREEN])
    painter.strokes(image, polylines([[-9.0, 0.0], [400.0, 3.0]]), np.zeros(1, int), [YELLOW])
    assert image.shape == (*shape, 3)
    assert (image[..., 1] > GREY).any()


def test_a_painter_draws_the_same_on_picture_after_picture():
    """And of another size between: no ink of one picture is on the next."""
    painter, lines = LineRenderer(), polylines([[20.0, 30.0], [200.0, 130.0]])
    images = [picture(), picture(), picture()]
    painter.strokes(images[0], lines, np.zeros(1, int), [YELLOW])
    painter.strokes(picture(90, 80), lines, np.zeros(1, int), [YELLOW])
    painter.strokes(images[1], lines, np.zeros(1, int), [YELLOW])
    np.testing.assert_array_equal(images[0], images[1])
    painter.strokes(images[2], polylines(), np.zeros(0, int), [YELLOW])
    assert (images[2] == GREY).all()
