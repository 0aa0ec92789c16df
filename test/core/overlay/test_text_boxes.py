"""Words on the picture: where they are, where they are not, and that they fit."""

import tracemalloc

import numpy as np
import pytest

from tirgeo_ros.core.overlay.text_boxes import (
    Field,
    fitted,
    paint_notice,
    paint_status,
)

GREY = 128


def picture(height=200, width=300):
    return np.full((height, width, 3), GREY, np.uint8)


def white(image):
    v, u = np.nonzero((image > 240).all(axis=2))
    return np.column_stack([u, v])


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


REASON = ": rtk/fix refused: older than max_delay_s or the alignment, rtk/vel refused as well"


def paint(seconds):
    for second in seconds:
        picture = np.zeros((512, 640, 3), np.uint8)
        paint_status(picture, [Field(f"degraded {second} s", detail=REASON), Field("RTK fixed")])
        paint_notice(picture, f"NO MAP: pose {second / 10:.1f} s old, and rtk/fix is missing")


def test_an_hour_of_seconds_is_not_remembered():
    paint(range(100))
    tracemalloc.start()
    try:
        paint(range(100, 130))
        before, _ = tracemalloc.get_traced_memory()
        paint(range(130, 400))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The texts that were remembered before change for newer ones, of other lengths at the most.
    assert after - before < 1_000_000
