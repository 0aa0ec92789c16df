"""Ink on the picture: where it is, where it is not, and that it stays there."""

import numpy as np
import pytest

from tirgeo_ros.core.painting import (
    LINE_BGR,
    Field,
    coloured,
    fitted,
    paint_labels,
    paint_lines,
    paint_notice,
    paint_status,
)
from tirgeo_ros.core.polylines import Polylines
from tirgeo_ros.core.text import stamp

GREY = 128


def picture(height=200, width=300):
    return np.full((height, width, 3), GREY, np.uint8)


def polylines(*lines):
    starts = np.cumsum([0, *map(len, lines)])
    points = np.concatenate([np.empty((0, 2)), *lines]).T
    return Polylines(points, starts, np.arange(len(lines)))


def ink(image):
    """(N, 2) pixels of the lines' colour and how strong they are."""
    strength = image[:, :, 2].astype(int) - image[:, :, 0]
    v, u = np.nonzero(strength > 0)
    return np.column_stack([u, v]), strength[v, u]


def test_a_grey_picture_becomes_a_coloured_copy():
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    image = coloured(grey)
    assert (image == grey[:, :, None]).all()
    again = coloured(image)
    again[:] = 0
    assert image.any()


@pytest.mark.parametrize("slope", [-2.0, -0.3, 0.0, 0.7, 5.0])
def test_the_ink_lies_on_the_line(slope):
    """Sub-pixel too: the ink's centre is off by a sixteenth of a pixel, the unit of drawing."""
    direction = np.array([1, slope]) / np.hypot(1, slope)
    middle = np.array([150.37, 100.81])
    image = picture()
    paint_lines(image, polylines([middle - 80 * direction, middle + 80 * direction]), polylines())
    pixels, strength = ink(image)
    offset = (pixels - middle) @ [-direction[1], direction[0]]
    assert np.abs(offset).max() < 2  # anti-aliased ink of one pixel is up to three wide
    assert abs(np.average(offset, weights=strength)) < 1 / 16


def test_lines_have_a_dark_halo_and_leave_the_rest():
    image = picture()
    paint_lines(image, polylines([[20.0, 100.0], [280.0, 100.0]]), polylines())
    assert image[100, 30:270, 1:].min() > 200
    assert image[100, 30:270, 0].max() == 0  # yellow: no blue is left
    for row in (98, 99, 101, 102):
        assert image[row, 30:270].max() < 0.7 * GREY
    assert (image[:97] == GREY).all()
    assert (image[104:] == GREY).all()


def test_lines_are_not_joined_to_each_other():
    image = picture()
    lines = polylines([[20.0, 50.0], [60.0, 50.0]], [[200.0, 150.0], [260.0, 150.0]])
    paint_lines(image, lines, polylines())
    assert (image[60:140] == GREY).all()


def test_lines_far_outside_do_no_harm():
    image = picture()
    paint_lines(image, polylines([[-9000.0, -9000.0], [9000.0, -8000.0]]), polylines())
    assert (image == GREY).all()


def test_a_mark_is_open_in_its_middle():
    image = picture()
    paint_lines(image, polylines(), polylines([[150.0, 100.0]]))
    pixels, _ = ink(image)
    assert (image[100, 150] == GREY).all()  # what is marked stays to be seen
    np.testing.assert_allclose(pixels.mean(axis=0), [150, 100], atol=0.3)
    assert np.abs(pixels - [150, 100]).sum(axis=1).max() <= 7  # 4, and 1.5 of the ink each way


def white(image):
    v, u = np.nonzero((image > 240).all(axis=2))
    return np.column_stack([u, v])


def test_a_label_stands_in_the_middle_of_a_large_feature():
    image = picture()
    square = np.array([[100, 40], [200, 40], [200, 120], [100, 120]], float)
    paint_labels(image, square, np.zeros(4, int), ["Park"])
    np.testing.assert_allclose(white(image).mean(axis=0), [150, 80], atol=5)


def test_a_label_stands_under_a_feature_smaller_than_itself():
    image = picture()
    paint_labels(image, np.array([[150.0, 80.0]]), np.zeros(1, int), ["Park"])
    assert white(image)[:, 1].min() > 84
    assert white(image)[:, 1].max() < 110


@pytest.mark.parametrize("corner", [(0, 0), (299, 0), (0, 199), (299, 199)])
def test_labels_stay_within_the_picture_and_above_the_status_line(corner):
    image = picture()
    paint_labels(image, np.array([corner], float), np.zeros(1, int), ["Park"])
    edges = np.concatenate([image[0], image[:, 0], image[:, -1], image[-20:].reshape(-1, 3)])
    assert len(white(image)) > 20
    assert edges.max() < 240


def test_labels_do_not_cover_each_other_and_the_larger_feature_wins():
    points = np.array([[150, 100], [148, 60], [152, 140], [150, 100], [40, 40]], float)
    owner = np.array([0, 1, 1, 1, 2])
    image, alone = picture(), picture()
    paint_labels(image, points, owner, ["small", "large", "far"])
    paint_labels(alone, points[1:], owner[1:] - 1, ["large", "far"])
    assert not np.array_equal(image, picture())
    # "small" stands lower than "large" and may stay; one at the same place may not.
    twice = picture()
    paint_labels(twice, np.tile(points[1:4], (2, 1)), np.repeat([0, 1], 3), ["large", "other"])
    once = picture()
    paint_labels(once, points[1:4], np.zeros(3, int), ["large"])
    np.testing.assert_array_equal(twice, once)


def test_no_labels():
    image = picture()
    paint_labels(image, np.empty((0, 2)), np.empty(0, int), [])
    assert (image == GREY).all()


def test_the_status_line_keeps_to_its_strip():
    image = picture()
    paint_status(image, [Field("one"), Field("two")])
    assert (image[:-20] == GREY).all()
    assert (image[-20:] < GREY).any()
    assert len(white(image)) > 20


def line_px(fields):
    """By another way than the code under test: painted on a picture that is wide enough."""
    image = picture(height=20, width=3000)
    paint_status(image, fields)
    return np.flatnonzero((image != image[:, -1:]).any(axis=(0, 2)))[-1] + 1


LINE = [
    Field("degraded 12 s", detail=": no rtk/fix, no rtk/vel, no rtk/heading"),
    Field("ekf_heading"),
    Field("RTK none"),
    Field("heading sigma 0.11 deg"),
    Field("frame age 83 ms", spare=True),
    Field("video 9.0 Hz", spare=True),
]


@pytest.mark.parametrize("width", [1280, 640, 560, 480, 320, 240, 120])
def test_the_status_line_fits_the_picture(width):
    kept = fitted(LINE, width, 12)
    assert line_px(kept) <= width
    assert kept[0].text == "degraded 12 s"
    image = picture(width=width, height=20)
    paint_status(image, LINE)
    assert white(image)[:, 0].max() < width - 2


def test_what_a_long_status_line_leaves_out():
    assert fitted(LINE, 1280, 12) == LINE
    assert fitted(LINE, line_px(LINE), 12) == LINE[:-1]  # an edge of 6 px stays free on the right
    assert fitted(LINE, line_px(LINE[:4]) + 10, 12) == LINE[:4]
    kept = fitted(LINE, line_px(LINE[:4]) - 20, 12)
    assert kept[1:] == LINE[1:4]
    assert kept[0].detail.endswith("\u2026")
    assert LINE[0].detail.startswith(kept[0].detail[:-1])
    no_room = fitted(LINE, line_px([Field("degraded 12 s"), *LINE[1:3]]) + 8, 12)
    assert [field.text for field in no_room] == ["degraded 12 s", "ekf_heading", "RTK none"]
    assert fitted(LINE, 1, 12) == [Field("degraded 12 s")]


def test_a_field_has_its_colour():
    image = picture()
    paint_status(image, [Field("lost 3 s", (0, 0, 255))])
    v, u = np.nonzero((image[:, :, 2] > 200) & (image[:, :, 0] < 60))
    assert len(u) > 50
    assert v.min() >= image.shape[0] - 20


def test_a_long_notice_takes_several_lines_and_all_its_words():
    notice = "NO MAP: lost: position sigma 10.2 m, heading sigma 11.3 deg, and nothing to measure"
    for width in (640, 320, 160):
        rows = []
        for text in (notice, "NO MAP:"):
            image = picture(height=512, width=width)
            paint_notice(image, text)
            changed = (image != GREY).any(axis=2)
            assert not changed[:, [0, -1]].any()
            rows.append(np.flatnonzero(changed.any(axis=1)).size)
        assert rows[0] > rows[1]


def test_a_notice_fits():
    for width in (640, 160, 60):
        image = picture(width=width)
        paint_notice(image, "NO MAP: aligning")
        assert (image != GREY).any()
    image = picture(height=512, width=640)
    notice = "NO MAP: image is 320x256, camera info 640x512, and what else there is to say of it"
    paint_notice(image, notice)
    changed = np.flatnonzero((image != GREY).any(axis=(0, 2)))
    assert changed[0] > 0
    assert changed[-1] < 639


@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (300, 5)])
def test_tiny_pictures(shape):
    image = picture(*shape)
    paint_lines(image, polylines([[-9.0, 0.0], [400.0, 3.0]]), polylines([[0.0, 0.0]]))
    paint_labels(image, np.zeros((1, 2)), np.zeros(1, int), ["Park"])
    paint_status(image, [Field("status")])
    paint_notice(image, "notice")
    assert image.shape == (*shape, 3)


def test_painting_is_the_same_each_time():
    images = [picture(), picture()]
    for image in images:
        paint_status(image, [Field("a"), Field("b")])
        paint_notice(image, "c")
    np.testing.assert_array_equal(*images)
    assert stamp("c", 20, LINE_BGR).size[1] > 20
