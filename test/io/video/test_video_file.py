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
"""Video files (.mp4, .ts): whole or absent, in the forms that players take."""

from __future__ import annotations

import os

import av
import numpy as np
import pytest
from klv_reader import by_klvdata, demuxed

from tirgeo_ros.core.types.errors import VideoError
from tirgeo_ros.io.video.frame_metadata import packet
from tirgeo_ros.io.video.video_file import VideoFile

STEP_NS = 111_111_111  # 9 Hz
TICK_S = 1 / 1000  # Matroska counts milliseconds, the finer MP4 has 1/90000 s


def frame(level, shape=(48, 64, 3)):
    return np.full(shape, level, np.uint8)


def write(path, stamps, levels=None):
    with VideoFile(path) as video:
        for stamp_ns, level in zip(stamps, levels or [90] * len(stamps), strict=True):
            video.add(stamp_ns, frame(level))
    return video


def frames_of(path):
    """The time in seconds and the mean brightness of each frame."""
    with av.open(str(path)) as container:
        result = [
            (item.time, item.to_ndarray(format="gray").mean()) for item in container.decode()
        ]
    return zip(*result, strict=True)


@pytest.mark.parametrize(("name", "count"), [("out.mp4", 25), ("OUT.MP4", 3)])
def test_frames_come_back_at_their_times(tmp_path, count, name):
    levels = [10 * k for k in range(count)]
    stamps = [10**18 + k * STEP_NS for k in range(count)]
    video = write(tmp_path / name, stamps, levels)
    with av.open(str(tmp_path / name)) as container:
        (form,) = (stream.codec_context for stream in container.streams)
        assert (form.name, form.pix_fmt) == ("h264", "yuv420p")  # which browsers take
    # Boxes of ISO/IEC 14496-12: with the index before the pictures it plays while it loads.
    data = (tmp_path / name).read_bytes()
    assert 0 < data.index(b"moov") < data.index(b"mdat")
    assert video.frames == count
    assert video.rate_hz == pytest.approx(9.0, rel=1e-6)
    times, result = frames_of(tmp_path / name)
    np.testing.assert_allclose(times, np.arange(count) / 9.0, atol=TICK_S)
    # limited-range YUV with quantised blocks: a flat grey comes back within a few levels
    np.testing.assert_allclose(result, levels, atol=6)


@pytest.mark.parametrize(
    ("stamps", "steps_s"),
    [
        ([5], []),
        ([5, 5], [0.1]),
        ([9, 5], [0.1]),
        ([0, STEP_NS, 0, STEP_NS], [1 / 9] * 3),
        ([0, STEP_NS, 10**18], [1 / 9] * 2),
        # below a tick of the clock: two frames would have the same time, which no container takes
        ([0, STEP_NS, STEP_NS + 5_000], [1 / 9] * 2),
    ],
)
def test_stamps_that_repeat_or_jump_keep_the_step_before(tmp_path, stamps, steps_s):
    write(tmp_path / "out.mp4", stamps)
    times, _ = frames_of(tmp_path / "out.mp4")
    np.testing.assert_allclose(np.diff(times), steps_s, atol=TICK_S)


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core alone")
@pytest.mark.parametrize("ending", [".mp4", ".ts"])
def test_the_same_bytes_on_one_core_and_on_all(tmp_path, ending):
    cores = os.sched_getaffinity(0)
    shots = np.random.default_rng(7).integers(0, 255, (8, 256, 320, 3)).astype(np.uint8)
    for name, some in (("one", {min(cores)}), ("all", cores)):
        try:
            os.sched_setaffinity(0, some)
            with VideoFile(tmp_path / f"{name}{ending}") as video:
                for k, pixels in enumerate(shots):
                    video.add(k * STEP_NS, pixels, b"key" if video.takes_metadata else b"")
        finally:
            os.sched_setaffinity(0, cores)
    item, every = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("one", "all"))
    assert item == every


def test_a_side_of_odd_length_has_its_last_pixel_twice(tmp_path):
    levels = np.arange(63 * 47, dtype=np.uint32).reshape(47, 63) * 250 // (63 * 47)
    pixels = np.repeat(levels.astype(np.uint8)[..., None], 3, axis=2)
    with VideoFile(tmp_path / "out.mp4") as video:
        video.add(0, pixels)
    with av.open(str(tmp_path / "out.mp4")) as container:
        (result,) = [item.to_ndarray(format="bgr24") for item in container.decode()]
    assert result.shape == (48, 64, 3)
    np.testing.assert_allclose(result[:47, :63], pixels, atol=12)
    np.testing.assert_allclose(result[47, :63], pixels[46], atol=12)


def write_and_fail(path, last):
    with VideoFile(path) as video:
        for k in range(12):
            video.add(k * STEP_NS, frame(0))
        video.add(12 * STEP_NS, last)
        raise RuntimeError("work failed")


@pytest.mark.parametrize(
    ("shape", "error", "reason"),
    [
        ((48, 64, 3), RuntimeError, "work failed"),
        ((24, 32, 3), VideoError, r"out\.mp4: a frame of 32x24 .* follows .* 64x48"),
    ],
)
def test_nothing_is_left_after_an_error(tmp_path, shape, error, reason):
    path = tmp_path / "out.mp4"
    path.write_bytes(b"what was there")
    with pytest.raises(error, match=reason):
        write_and_fail(path, frame(0, shape))
    assert path.read_bytes() == b"what was there"
    # More pixels in a row than H.264 has: no OSError of PyAV.
    with (
        pytest.raises(VideoError, match=r"out\.mp4: cannot be written: "),
        VideoFile(path) as video,
    ):
        video.add(0, frame(0, (2, 20_000, 3)))
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.mp4"]


def test_a_growing_file_plays_as_far_as_it_was_written(tmp_path):
    path = tmp_path / "flight.ts"

    def killed():
        with VideoFile(path, growing=True) as film:
            for number in range(300):
                film.add(number * 33_000_000, np.full((64, 64, 3), number % 250, np.uint8))
            raise KeyboardInterrupt  # whatever ends it

    with pytest.raises(KeyboardInterrupt):
        killed()
    with av.open(str(path)) as film:
        assert [item.type for item in film.streams] == ["video"]  # no metadata was given
        assert sum(1 for _ in film.decode(video=0)) == 300
    assert [each.name for each in tmp_path.iterdir()] == ["flight.ts"]


START_NS = 1_634_731_264_000_000_000


def write_stream(path, count, size=(48, 64)):
    packets = []
    with VideoFile(path) as video:
        for k in range(count):
            stamp_ns = START_NS + k * STEP_NS
            packets.append(packet(stamp_ns, {13: k / 10, 10: "x" * (k % 100)}))
            video.add(stamp_ns, np.full((*size, 3), 5 * (k % 50), np.uint8), packets[-1])
    return packets


@pytest.mark.parametrize(("count", "size"), [(1, (48, 64)), (60, (48, 64)), (12, (47, 63))])
def test_as_many_packets_as_frames_at_the_same_times(tmp_path, count, size):
    packets = write_stream(tmp_path / "out.ts", count, size)
    result = demuxed(tmp_path / "out.ts")
    assert result.packets == packets
    assert result.packet_s == result.frame_s
    steps = np.subtract(result.frame_s, result.frame_s[0])
    np.testing.assert_allclose(steps, np.arange(count) * STEP_NS * 1e-9, atol=1 / 90_000)
    for item in result.packets:
        by_klvdata(item)
    # H.264 as browsers take it, and the registration KLVA by which FFmpeg knows metadata.
    with av.open(str(tmp_path / "out.ts")) as container:
        video, data = container.streams
        assert (video.codec_context.name, video.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert data.type == "data"
    content = (tmp_path / "out.ts").read_bytes()
    assert len(content) % 188 == 0
    assert bytes.fromhex("05044b4c5641") in content
