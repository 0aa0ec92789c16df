"""Points of pictures that move by a known shift, and pictures that show nothing to follow."""

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.checks.picture_tracks import PictureTracker

STEP_NS = 111_000_000


def scene(width=1600, height=1300):
    """Blurred noise: something to follow everywhere."""
    noise = np.random.default_rng(0).normal(0.0, 1.0, (height, width)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 6.0)
    return np.clip(128 + 60 * blurred / blurred.std(), 0, 255).astype(np.uint8)


def cut(right, down, width=640, height=512):
    return scene()[100 + down : 100 + down + height, 100 + right : 100 + right + width]


def taken(*pictures, step_ns=STEP_NS):
    tracker = PictureTracker()
    found = [tracker.take(10**9 + k * step_ns, one) for k, one in enumerate(pictures)]
    return tracker, [one for one in found if one is not None]


@pytest.mark.parametrize("size", [(640, 512), (336, 256), (1280, 1024), (500, 400)])
@pytest.mark.parametrize("shift", [(0, 6), (40, -12), (3, 0)])
def test_a_shift_is_followed(size, shift):
    shift = tuple(px * size[0] // 640 for px in shift)
    _, [tracks] = taken(cut(0, 0, *size), cut(*shift, *size))
    # A quarter of a pixel of the small picture, which is four times smaller at the most.
    moved = tracks.second - tracks.first
    assert np.abs(np.median(moved, axis=0) + shift).max() < 0.5
    assert len(tracks.first) >= 6


def test_a_crosshair_stays_and_is_left_out():
    first, second = cut(0, 0).copy(), cut(20, 8).copy()
    for one in (first, second):
        one[250:262, 300:340] = 255
        one[236:276, 314:326] = 255
    _, [tracks] = taken(first, second)
    assert (np.linalg.norm(tracks.second - tracks.first, axis=1) > 5.0).all()


def test_what_cannot_be_followed_gives_nothing():
    flat = np.full((512, 640), 80, np.uint8)
    assert taken(flat, flat)[1] == []
    assert taken(cut(0, 0), cut(0, 0, 320, 256))[1] == []
    assert taken(cut(0, 0, 24, 20), cut(2, 0, 24, 20))[1] == []
    assert taken(cut(0, 0), cut(6, 0), step_ns=-STEP_NS)[1] == []
    assert taken(cut(0, 0), cut(6, 0).astype(np.uint16))[1] == []  # a camera that changes depth
