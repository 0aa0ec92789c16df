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
"""The picture's tones and text, and why no part of the map is in view."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from overlays import (
    GREY,
    LATENCY,
    MS,
    PLANE,
    SQUARE_N,
    START,
    geo,
    luminance,
    pictured,
    pose_at,
    ready,
)
from scenes import camera_pose, graticule

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.map.visibility import why_absent
from tirgeo_ros.core.overlay import picture_painter
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.frame_shapes import DrawingVerdict, Unpainted
from tirgeo_ros.core.overlay.map_shapes import drape_layers
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import PicturePainter, ToneMapper
from tirgeo_ros.core.types.finding import Severity

FRAME_NS = 33_333_333
SHAPE = (120, 160)
ROWS = np.linspace(0, 1, SHAPE[0] * SHAPE[1]).reshape(SHAPE)


def ramp(low=20000.0, high=24000.0):
    return (low + ROWS * (high - low)).astype(np.uint16)


def toner(palette="white_hot", **config):
    return ToneMapper(PictureConfig(**config), palette)


def grey(image):
    assert image.dtype == np.uint8
    assert (image == image[..., :1]).all()
    return image[..., 0].astype(int)


# one picture


def test_sixteen_bits_keep_their_order_and_use_the_range():
    shown = grey(toner().tone(ramp(), 0))
    assert (shown.min(), shown.max()) == (0, 255)
    assert (np.diff(shown.ravel()) >= 0).all()
    # 1 % at each end is cut off: the middle stays in the middle, to one grey level.
    assert abs(shown[60, 0] - 128) <= 1


@pytest.mark.parametrize("value", [0, 65535])
def test_dead_and_hot_pixels_change_nothing(value):
    """Even where they are more than what is cut off at the ends."""
    broken = ramp()
    broken[:, 4:8] = value
    change = grey(toner().tone(broken, 0)) - grey(toner().tone(ramp(), 0))
    change[:, 4:8] = 0
    assert np.abs(change).max() <= 1
    assert set(np.unique(grey(toner().tone(broken, 0))[:, 4:8])) == {255 if value else 0}


@pytest.mark.parametrize("name", PALETTES)
def test_a_palette_has_a_colour_for_each_level_and_hotter_is_never_darker(name):
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    image = toner(name).tone(levels, 0)
    colours = image.reshape(256, 3)
    assert len(np.unique(colours, axis=0)) > 200
    if name != "rainbow":
        rise = np.diff(luminance(colours)) * (-1 if name == "black_hot" else 1)
        assert rise.min() > -2e-3  # OpenCV's tables are rounded to 8 bits
    image[:] = 0  # a picture of its own: what is drawn on it stays out of the message
    assert levels[15, 15] == 255


def test_local_contrast_shows_what_is_faint():
    """A bar three grey levels above an even ground."""
    faint = np.full(SHAPE, 100, np.uint8)
    faint[:, ::16] = 103
    faint[:4] = 255
    plain, local = (
        np.ptp(grey(toner(local_contrast=limit).tone(faint, 0))[60]) for limit in (0.0, 8.0)
    )
    assert plain == 3
    assert local > 2 * plain


@given(
    values=st.lists(st.integers(0, 65535), min_size=4, max_size=60),
    stamps=st.lists(st.integers(-(10**19), 10**19), min_size=2, max_size=5),
)
def test_any_values_at_any_stamps_keep_their_order(values, stamps):
    mapper = toner()
    raw = np.array([sorted(values)], np.uint16)
    for stamp_ns in stamps:
        assert (np.diff(grey(mapper.tone(raw, stamp_ns))[0]) >= 0).all()


# a video


def video(mapper, frames, start_ns=0):
    return [grey(mapper.tone(raw, start_ns + i * FRAME_NS)) for i, raw in enumerate(frames)]


def hot(raw, share=0.2, value=40000):
    """Return a picture whose hottest part is replaced by something hotter."""
    raw = raw.copy()
    raw[len(raw) - round(share * len(raw)) :] = value
    return raw


def test_a_hot_spot_changes_the_rest_slowly():
    """By no more than 3 dt / stretch_time_s of its grey level in a frame, and rounding."""
    frames = [ramp()] * 3 + [hot(ramp())] * 60
    shown = [picture[:80] for picture in video(toner(), frames)]
    most = 3 * FRAME_NS * 1e-9 / 1.0
    for before, after in pairwise(shown):
        assert (np.abs(after - before) <= most * before + 1).all()


@pytest.mark.parametrize("time_s", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("back", [False, True])
def test_a_change_of_the_scene_is_followed_within_the_time(time_s, back):
    """A span that becomes five times as large or small is then right to a tenth."""
    scenes = [ramp(), hot(ramp())]
    first, second = reversed(scenes) if back else scenes
    count = round(time_s * 1e9 / FRAME_NS)
    mapper = toner(stretch_time_s=time_s)
    shown = video(mapper, [first] * 3 + [second] * (count + 1))
    begin, settled = (grey(toner().tone(raw, 0)) for raw in (first, second))
    away = np.abs(settled - shown[-1]).max()
    assert away <= 0.1 * 255 + 1
    assert away < 0.2 * np.abs(settled - begin).max()


def test_the_noise_of_a_still_scene_moves_nothing():
    rng = np.random.default_rng(4)
    frames = [(ramp() + rng.normal(0, 30, SHAPE)).astype(np.uint16) for _ in range(40)]
    mapper = toner()
    video(mapper, frames)
    ends = mapper._stretch._ends
    video(mapper, frames, start_ns=40 * FRAME_NS)
    assert mapper._stretch._ends == ends


POSES = 40
WORDS = "NO GO: height above ground at rest 47.3 m, should be 1 m: overlay_node ground_height_m"


def town(rng):
    """Points, lines and outlines with names long and short, 200 m around."""
    names = ["N", "Hydrant 12", "Linde", "Sammelplatz an der alten Mühle", "7"]
    features = []
    for number in range(150):
        middle = np.append(rng.uniform(-100, 100, 2), 0.0)
        size = rng.uniform(2, 20)
        shapes = (
            [[0, 0, 0]],
            [[-size, 0, 0], [size, size, 0]],
            [[0, 0, 0], [size, 0, 0], [size, size, 0], [0, size, 0]],
        )
        features.append(geo(middle + np.array(shapes[number % 3], float), names[number % 5]))
    return features


def unpainted(image, pose, markers, verdict):
    seen = image, None, pose, None, "", 0.0, tuple(markers), verdict
    return Unpainted(START, *seen, status=None, age_s=0.0, rate_hz=10.0, replaced=0)


@pytest.mark.parametrize("width", [336, 640])
def test_texts_do_not_overlap(width):
    rng = np.random.default_rng(13)
    part, labels = width / XT2.width, 0
    height = round(part * XT2.height)
    camera = Camera(width, height, part * XT2.fx, part * XT2.fy, part * XT2.cx, part * XT2.cy)
    drawing = PicturePainter(OverlayConfig(ground_height_m=25.0), [MapLayer("t", town(rng))], None)
    drawing.shaper.set_plane(PLANE)
    drawing.set_lens(camera, rectify=False)
    for number in range(POSES):
        image = np.full((height, width, 3), 90, np.uint8)
        verdict = DrawingVerdict(Severity(number % 3), WORDS)
        angles_deg = rng.uniform([-15, -90, 0], [15, -5, 360])
        position_n = np.append(rng.uniform(-80, 80, 2), -rng.uniform(10, 120))
        points = np.column_stack([rng.uniform(-100, 100, (20, 2)), np.zeros(20)])
        clicks = [Marker(p, f"30.500123 114.30012{k}", np.eye(3)) for k, p in enumerate(points)]
        pose = camera_pose(position_n, *angles_deg, 1e-3)
        boxes = drawing.draw(image, drawing.shapes(unpainted(image, pose, clicks, verdict)))
        for item, other in combinations(boxes, 2):
            assert not item.meets(other), (number, item, other)
        for box in boxes:
            assert 0 <= box.left < box.right <= width
            assert 0 <= box.top < box.bottom <= height
        labels += len(boxes)
    assert labels > 8 * POSES  # or it has shown nothing


def notice(features, pose=None, style=None):
    layer = MapLayer("m", features, style or LayerStyle())
    overlay = Overlay(OverlayConfig(ground_height_m=25.0), [layer])
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    overlay.poses.add(pose or pose_at(START))
    overlay.add_frame(START + LATENCY, GREY, START)
    result = overlay.take(START)
    assert result.pose is not None
    return result.notice


def looking(down_deg, yaw_deg=0.0):
    return camera_pose([0.0, 0.0, -20.0], 0.0, -down_deg, yaw_deg, 1e-4, START)


def at(latitude_deg, longitude_deg):
    return GeoFeature("", False, np.array([[*np.radians([latitude_deg, longitude_deg]), 25.0]]))


@pytest.mark.parametrize(
    ("features", "pose", "why"),
    [
        ([geo(SQUARE_N)], looking(-30), "the camera looks above the horizon"),
        ([geo(SQUARE_N)], looking(30, 180), "map 30 m away to the north; the camera looks south"),
        (
            [geo([[-210, 210, 0]])],
            None,
            "map 300 m away to the south-east; the camera looks north",
        ),
        ([geo([[5000, 10, 0]])], None, "map 5 km away to the north; it is drawn up to 1 km"),
        ([at(34.4, 114.3)], None, "map 430 km away to the north"),
        ([at(30.5, 108.3)], None, "map 580 km away to the west; is it UTM zone 50 instead of 49?"),
    ],
)
def test_why_no_part_of_the_map_is_in_view(features, pose, why):
    assert notice(features, pose) == f"NO MAP IN VIEW: {why}"


def test_no_layer_at_this_scale():
    """The middle is 40 m away, through a lens of 804 px: 5 cm, less what it bends."""
    why = notice([geo(SQUARE_N)], style=LayerStyle(scale_m_px=(0.5, 2.0)))
    assert why == "NO MAP IN VIEW: no layer is shown at this scale (4.9 cm a pixel)"


def test_a_map_beside_the_elevation_model_lies_on_no_ground():
    grid_of = graticule((40.0, 10.0), (1e-4, 1e-4), 3)
    elsewhere = Terrain(np.full((3, 3), 25.0), grid_of)
    draped = drape_layers([MapLayer("m", [geo(SQUARE_N)])], PLANE, elsewhere)
    why = why_absent(draped.map, PLANE, draped.first_n, XT2, pose_at(START), 1000.0)
    assert why == "none of the map lies on the elevation model"


def test_the_status_line_has_the_sigma_of_the_heading_that_is_drawn_with(monkeypatch):
    """That of the camera: the gimbal's north adds to that of the body."""
    overlay, shown = ready(), []
    monkeypatch.setattr(picture_painter, "paint_status", lambda _, fields: shown.extend(fields))
    pose = pictured(overlay).pose
    sigma_deg = np.degrees(np.sqrt(pose.covariance[5, 5]))
    assert f"heading sigma {sigma_deg:.2f} deg" in [field.text for field in shown]


def test_the_notice_stands_in_the_picture_and_the_verdict_above_it():
    overlay = ready([geo([[-210, 210, 0]])], ground_height_m=25.0)
    pictures = [pictured(overlay).image.astype(int)]
    overlay.verdict = DrawingVerdict(Severity.STOP, "NO GO: gimbal")
    pictures.append(pictured(overlay, START + MS).image.astype(int))
    plain, reports = (np.abs(image - [80, 200, 255]).max(axis=2) < 20 for image in pictures)
    assert plain[:30].sum() > 100  # letters
    red = np.abs(pictures[1] - [60, 140, 255]).max(axis=2) < 20
    assert red[:30].sum() > 30  # the verdict has the first line
    assert reports[:20].sum() == 0 < reports[20:60].sum()
    assert red[480:].sum() > 10  # and leads the status line
