"""Words that change with every second do not pile up."""

from __future__ import annotations

import tracemalloc

import numpy as np

from tirgeo_ros.core.overlay.text_boxes import Field, paint_notice, paint_status

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
