"""The frame that waits: the newest wins, late and wrong ones are counted."""

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.overlay.frame_queue import Frame, FrameQueue

PICTURE = np.zeros((4, 5), np.uint8)
SECOND = 1_000_000_000


def put(queue, *stamps_s):
    for stamp_s in stamps_s:
        queue.put(Frame(round(stamp_s * SECOND), PICTURE, 0))


def stamps(queue):
    return [frame.stamp_ns / SECOND for frame in queue]


def test_the_newest_comes_first_and_the_older_give_way_to_it():
    queue = FrameQueue()
    put(queue, 1.0, 1.1, 1.2, 1.3)
    assert stamps(queue) == [1.3, 1.2, 1.1, 1.0]
    queue.take(list(queue)[1])
    assert stamps(queue) == [1.3]  # newer ones go on waiting
    assert {name: n for name, n in queue.counts.items() if n} == {"replaced": 2}
    queue.take(next(iter(queue)))
    assert len(queue) == 0
    assert queue.counts["replaced"] == 2


def test_no_more_than_a_second_of_video_waits():
    queue = FrameQueue()
    put(queue, *(0.1 * i for i in range(1, 101)))
    assert len(queue) == 30
    assert stamps(queue)[0] == 10.0
    assert queue.counts["replaced"] == 70


def test_a_picture_that_no_jpeg_holds_is_dropped():
    queue = FrameQueue()
    for shape in ((1, 70_000), (70_000, 1), (65_501, 1, 3)):
        queue.put(Frame(SECOND, np.zeros(shape, np.uint8), 0))
    assert len(queue) == 0
    assert queue.counts["too_large"] == 3
    widest = np.zeros((1, 65_500), np.uint8)
    queue.put(Frame(SECOND, widest, 0))
    assert len(queue) == 1
    assert cv2.imencode(".jpg", widest)[0]


def test_a_late_or_repeated_frame_is_dropped():
    queue = FrameQueue()
    put(queue, 5.0, 4.5, 5.0)
    assert stamps(queue) == [5.0]
    assert queue.counts["out_of_order"] == 2


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((4, 5, 3), np.uint16),
        np.zeros((4, 5), np.int16),
        np.zeros((4, 5), float),
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((4, 5, 1), np.uint8),
        np.zeros(20, np.uint8),
        np.zeros((0, 5), np.uint8),
        np.zeros((4, 0, 3), np.uint8),
    ],
    ids=lambda pixels: f"{pixels.dtype}{pixels.shape}",
)
def test_what_is_no_picture_is_counted(pixels):
    queue = FrameQueue()
    queue.put(Frame(SECOND, pixels, 0))
    assert len(queue) == 0
    assert queue.counts["invalid"] == 1
