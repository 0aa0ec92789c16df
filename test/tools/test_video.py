"""Video files: rate from stamps, whole or not there."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.errors import VideoError
from tirgeo_ros.tools.video import VideoFile

STEP_NS = 111_111_111  # 9 Hz


def frame(level, shape=(48, 64, 3)):
    return np.full(shape, level, np.uint8)


def frames_of(path):
    capture = cv2.VideoCapture(str(path))
    rate_hz = capture.get(cv2.CAP_PROP_FPS)
    found = []
    while True:
        read, pixels = capture.read()
        if not read:
            return rate_hz, found
        found.append(pixels)


@pytest.mark.parametrize("count", [3, 25])
def test_frames_and_rate_come_back(tmp_path, count):
    path = tmp_path / "out.mp4"
    levels = [10 * k for k in range(count)]
    with VideoFile(path) as video:
        for k, level in enumerate(levels):
            video.add(10**18 + k * STEP_NS, frame(level))
    assert video.frames == count
    rate_hz, found = frames_of(path)
    assert rate_hz == pytest.approx(9.0, rel=1e-3)  # the container keeps the rate as a ratio
    # limited-range YUV with quantised blocks: a flat grey comes back within a few levels
    np.testing.assert_allclose([pixels.mean() for pixels in found], levels, atol=6)


def test_one_late_frame_does_not_change_the_rate(tmp_path):
    stamps = [k * STEP_NS for k in range(12) if k != 4]
    with VideoFile(tmp_path / "out.mp4") as video:
        for stamp_ns in stamps:
            video.add(stamp_ns, frame(90))
    assert video.rate_hz == pytest.approx(9.0, rel=1e-6)


@pytest.mark.parametrize("stamps", [[5], [5, 5], [9, 5]])
def test_stamps_without_a_rate_still_give_a_file(tmp_path, stamps):
    path = tmp_path / "out.mp4"
    with VideoFile(path) as video:
        for stamp_ns in stamps:
            video.add(stamp_ns, frame(90))
    assert len(frames_of(path)[1]) == len(stamps)


def write_and_fail(path):
    with VideoFile(path) as video:
        for k in range(12):
            video.add(k * STEP_NS, frame(0))
        raise RuntimeError("work failed")


def test_nothing_is_left_after_an_error(tmp_path):
    path = tmp_path / "out.mp4"
    path.write_bytes(b"what was there")
    with pytest.raises(RuntimeError, match="work failed"):
        write_and_fail(path)
    assert path.read_bytes() == b"what was there"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.mp4"]


def test_no_frame_no_file(tmp_path):
    with VideoFile(tmp_path / "out.mp4"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_other_size_is_refused(tmp_path):
    with VideoFile(tmp_path / "out.mp4") as video:
        video.add(0, frame(0))
        with pytest.raises(VideoError, match=r"out\.mp4: a frame of 32x24 .* follows .* 64x48"):
            video.add(STEP_NS, frame(0, (24, 32, 3)))


def test_place_is_checked_at_once(tmp_path):
    with pytest.raises(VideoError, match=r"no such folder .*absent"):
        VideoFile(tmp_path / "absent" / "out.mp4")
    with pytest.raises(VideoError, match=r"out\.avi: the video's name must end with \.mp4"):
        VideoFile(tmp_path / "out.avi")
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(VideoError, match=r"folder\.mp4: not a file; give the output another name"):
        VideoFile(tmp_path / "folder.mp4")
