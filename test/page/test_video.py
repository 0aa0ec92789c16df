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
"""The video for the page: sizes that suit a link, and the pictures that are kept."""

from __future__ import annotations

import asyncio
import errno
import heapq
import os
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from page_backend import HEIGHT, WIDTH, Pictures

from tirgeo_ros.page import picture_ring
from tirgeo_ros.page.pace import LEVELS, Pace
from tirgeo_ros.page.picture_ring import Picture, PictureRing
from tirgeo_ros.page.video import VideoFeed

KEPT = 1_000_000  # bytes of pictures


def picture(stamp_ns, size):
    rng = np.random.default_rng(stamp_ns)
    return Picture(stamp_ns, stamp_ns, 0, rng.bytes(size), rng.bytes(size // 7), 4, 3)


@given(sizes=st.lists(st.integers(1, 700), max_size=60))
def test_a_ring_has_the_newest_pictures_and_no_more_bytes(sizes):
    """What is dropped did not fit: the gaps at the file's end and before the oldest are small."""
    ring, kept = PictureRing(2000), [picture(k, size) for k, size in enumerate(sizes)]
    for item in kept:
        ring.add(item)
    stamps = ring.stamps_ns()
    assert stamps == [*range(len(kept))][len(kept) - len(stamps) :]
    assert ring.get(-1) is None
    assert [ring.get(stamp) for stamp in stamps] == [kept[stamp] for stamp in stamps]
    size_of = [len(item.jpeg) + len(item.shapes) for item in kept]
    used, largest = sum(size_of[stamp] for stamp in stamps), max(size_of, default=0)
    assert used <= 2000
    assert len(stamps) == len(kept) or used > 2000 - 2 * largest
    ring.close()


def test_a_full_disk_costs_the_pictures_to_go_back_to_and_no_more(monkeypatch, caplog):
    """The video goes on, the log says it once, and with room there are pictures again."""
    with ThreadPoolExecutor(1) as workers:
        feed, jpeg = VideoFeed(workers, KEPT), Pictures().jpeg(0)
        write = os.pwrite
        for answer in (OSError(errno.ENOSPC, "No space left on device"), 100):
            broken = Mock(side_effect=[answer] if isinstance(answer, Exception) else None)
            broken.return_value = answer
            monkeypatch.setattr(picture_ring.os, "pwrite", broken)
            feed.show(1, 1, jpeg)
            assert feed.newest.stamp_ns == 1
            assert feed.stamps_ns() == []
        monkeypatch.setattr(picture_ring.os, "pwrite", write)
        feed.show(2, 2, jpeg)
        assert feed.stamps_ns() == [2]
        assert feed.kept.get(2).jpeg == jpeg
        feed.kept.close()
    message = "no pictures are kept to go back to: No space left on device"
    assert caplog.messages == [message]


def test_the_file_of_pictures_leaves_room_on_the_disk_for_the_targets(monkeypatch):
    """It stays as large as it is, and has the newest pictures."""
    ring, free = PictureRing(10**6), Mock(f_bavail=255, f_frsize=1024**2)
    monkeypatch.setattr(picture_ring, "_LEAST", 2000)
    monkeypatch.setattr(picture_ring.os, "fstatvfs", Mock(return_value=free))
    for stamp in range(100):
        ring.add(picture(stamp, 140))
    assert os.fstat(ring._file.fileno()).st_size <= 2000
    assert ring.stamps_ns()[-1] == 99
    assert len(ring.stamps_ns()) >= 11
    free.f_bavail = 257
    for stamp in range(100, 200):
        ring.add(picture(stamp, 140))
    assert len(ring.stamps_ns()) > 90
    ring.close()


def test_a_disk_that_does_not_say_how_full_it_is_costs_no_video(monkeypatch):
    """As a folder of another computer that is switched off."""
    monkeypatch.setattr(picture_ring, "_LEAST", 0)
    broken = Mock(side_effect=OSError(errno.EIO, "Input/output error"))
    monkeypatch.setattr(picture_ring.os, "fstatvfs", broken)
    with ThreadPoolExecutor(1) as workers:
        feed, woken = VideoFeed(workers, KEPT), Mock()
        feed.waking.add(woken)
        for stamp in (1, 2, 3):
            feed.show(stamp, stamp, Pictures().jpeg(0))
        assert woken.call_count == 3
        assert feed.kept.fault == "Input/output error"
        feed.kept.close()


def test_a_disk_that_fails_costs_a_press_its_picture_and_no_more(monkeypatch):
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers, KEPT)
        feed.show(1, 1, Pictures().jpeg(0))
        broken = Mock(side_effect=OSError(errno.EIO, "Input/output error"))
        monkeypatch.setattr(picture_ring.os, "pread", broken)
        assert feed.cut_out(1, 320, 256)() is None
        assert feed.kept.fault == "Input/output error"
        feed.kept.close()


def test_one_can_go_back_120_s_in_steps_of_a_tenth_of_a_second():
    with ThreadPoolExecutor(1) as workers:
        feed, jpeg, step_ns = VideoFeed(workers, 2 * 10**9), Pictures().jpeg(0), 33_000_000
        assert feed.stamps_ns() == []
        for k in range(4000):
            feed.show(10**18 + k * step_ns, 0, jpeg)
        stamps = np.array(feed.stamps_ns())
        assert stamps[-1] == 10**18 + 3999 * step_ns
        assert 119.8e9 < stamps[-1] - stamps[0] <= 120e9
        assert np.diff(stamps).min() >= 100_000_000
        feed.show(5, 0, jpeg)  # a new flight, of an older clock
        assert feed.stamps_ns() == [5]
        feed.kept.close()


def test_a_picture_of_four_billion_pixels_is_counted_and_logged_once(caplog):
    jpeg = bytearray(Pictures().jpeg(0))
    at = jpeg.index(b"\xff\xc0") + 5
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers, KEPT)
        for size in (b"\xff" * 4, b"\x20\x00\x20\x00"):  # and 67 million, with a warning of 200 MB
            jpeg[at : at + 4] = size
            for _ in range(3):
                feed.show(1, 1, bytes(jpeg))
        assert (feed.damaged, feed.newest) == (6, None)
    (message_text,) = caplog.messages
    assert message_text == "a picture that is no JPEG of up to 8.4 million pixels is not shown"


def test_pictures_are_made_smaller_once_for_all_who_want_them():
    async def look():
        with ThreadPoolExecutor(1) as workers:
            feed = VideoFeed(workers, KEPT)
            feed.show(1, 1, jpeg)
            result = [feed.bytes_at(feed.newest, level) for level in range(len(LEVELS))]
            again = [feed.bytes_at(feed.newest, level) for level in range(len(LEVELS))]
            return await asyncio.gather(*result), await asyncio.gather(*again)

    jpeg = Pictures().jpeg(0)
    result, again = asyncio.run(look())
    assert result[0].jpeg is jpeg
    assert all(item.jpeg is other.jpeg for item, other in zip(result, again, strict=True))
    sizes = [len(item.jpeg) for item in result]
    assert sizes == sorted(sizes, reverse=True)
    for made, level in zip(result, LEVELS, strict=True):
        size = cv2.imdecode(np.frombuffer(made.jpeg, np.uint8), 1).shape[:2]
        assert size == (HEIGHT // level.divisor, WIDTH // level.divisor)


def test_damaged_shapes_cost_the_map_of_a_thin_link_alone():
    async def look():
        with ThreadPoolExecutor(1) as workers:
            feed = VideoFeed(workers, KEPT)
            feed.show(1, 1, Pictures().jpeg(0), os.urandom(6000))
            return await feed.bytes_at(feed.newest, 4)

    sizes = asyncio.run(look())
    assert sizes.shapes == b""
    assert sizes.jpeg


def test_damaged_pictures_are_counted_and_the_last_stays():
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers, KEPT)
        jpeg = Pictures().jpeg(0)
        feed.show(1, 1, jpeg)
        for damaged in (b"", b"no picture", jpeg[:100], b"\x89PNG" + jpeg):
            feed.show(2, 2, damaged)
        assert feed.damaged == 4
        assert feed.newest.stamp_ns == 1


@pytest.mark.parametrize(
    ("u", "v", "size"), [(320, 256, (160, 160)), (0, 0, (160, 160)), (639, 511, (81, 81))]
)
def test_a_cut_out_is_around_the_pixel(u, v, size):
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers, KEPT)
        feed.show(7, 7, Pictures().jpeg(0))
        result = feed.cut_out(7, u, v)()
        assert cv2.imdecode(np.frombuffer(result, np.uint8), 1).shape[:2] == size
        assert feed.cut_out(8, u, v)() is None
        assert feed.cut_out(7, 5000, -5000)() is None


#: Bytes of an untouched picture, and of the map of a town on it.
FULL, MAP = 38_000, 8_000
HZ = 30.0


def bytes_at(level):
    size, is_coarse = FULL * LEVELS[level].share, LEVELS[level].coarse
    return round(size) + (5000 if is_coarse else MAP)


class Link:
    """A link in simulated time: so many bytes a second, after one another, and a delay."""

    def __init__(self, bytes_a_s, delay_s=0.02):
        self.bytes_a_s, self.delay_s = bytes_a_s, delay_s
        self._free_s = 0.0

    def arrival(self, now_s, size):
        self._free_s = max(self._free_s, now_s) + size / self.bytes_a_s
        return self._free_s + self.delay_s


def watched(link, seconds, change=None, begins_s=0.0):
    """(time, age, level) of each picture as it is shown; the page is late with the first two."""
    pace, answers, shown, last = Pace(), [], [], 0
    for step in range(round(seconds * 1000)):
        now_s = step * 1e-3
        if change and now_s >= change[0]:
            link.bytes_a_s, change = change[1], None
        while answers and answers[0][0] <= now_s:
            at_s, number, taken_s, level = heapq.heappop(answers)
            assert pace.shown(number, at_s)
            shown.append((now_s, now_s - taken_s - link.delay_s, level))
        newest = int(now_s * HZ) + 1
        if newest != last and pace.may_send(now_s):
            last, level, size = newest, pace.level, bytes_at(pace.level)
            pace.sent(newest, size, now_s)
            at_s = link.arrival(now_s, size) + link.delay_s  # the answer's way back
            at_s += begins_s if newest <= 2 else 0.0
            heapq.heappush(answers, (at_s, newest, (newest - 1) / HZ, level))
    return np.array(shown)


def test_a_good_link_has_untouched_pictures_at_full_rate_at_once():
    observed = watched(Link(50e6, 0.002), 10)
    assert (observed[observed[:, 0] > 0.2][:, 2] == 0).all()
    assert len(observed) > 290


# The ages asked for, of 500 ms, with room for what the simulated link leaves out.
@pytest.mark.parametrize("megabits", [0.5, 1.0, 2.0, 4.0])
def test_a_thin_link_has_young_pictures_that_use_it(megabits):
    observed = watched(Link(megabits * 125e3), 60)
    settled = observed[observed[:, 0] > 3]
    assert np.percentile(settled[:, 1], 95) < 0.4
    assert len(settled) / 57 > 3
    used = sum(bytes_at(int(level)) for level in settled[:, 2]) / 57
    assert used > 0.5 * megabits * 125e3
    if megabits >= 1:
        assert np.median(settled[:, 2]) <= 5  # a person can be seen


def test_a_long_way_alone_makes_no_small_pictures():
    observed = watched(Link(10e6, 0.06), 30)
    assert np.median(observed[observed[:, 0] > 10][:, 2]) == 0


def test_pictures_follow_a_link_that_breaks_down_and_one_that_recovers():
    down = watched(Link(10e6), 20, change=(10, 125e3))
    assert (down[(down[:, 0] > 5) & (down[:, 0] < 10)][:, 2] == 0).all()
    assert (down[down[:, 0] > 12.5][:, 1] < 0.5).all()
    up = watched(Link(125e3), 60, change=(20, 10e6))
    assert (up[up[:, 0] > 55][:, 2] == 0).all()


class LongerWay(Link):
    """A wide link whose way becomes longer after 20 s, as over one more hop of a mesh."""

    def arrival(self, now_s, size):
        self.delay_s = 0.02 if now_s < 20 else 0.15
        return super().arrival(now_s, size)


class JitteryLink(Link):
    """A wide link whose way is at times much longer, as of a radio that repeats."""

    def __init__(self, seed):
        super().__init__(10e6, 0.1)
        self._rng, self._newest_s = np.random.default_rng(seed), 0.0

    def arrival(self, now_s, size):
        arrives_s = super().arrival(now_s, size) + self._rng.exponential(0.1)
        self._newest_s = max(self._newest_s, arrives_s)  # in order
        return self._newest_s


@pytest.mark.parametrize("seed", range(3))
def test_unlucky_first_pictures_make_no_small_ones_for_ever(seed):
    settled = watched(JitteryLink(seed), 150)
    settled = settled[settled[:, 0] > 20]
    assert (settled[:, 2] <= 2).mean() > 0.5


def test_a_way_that_becomes_longer_makes_no_small_pictures_for_ever():
    observed = watched(LongerWay(10e6), 90)
    settled = observed[observed[:, 0] > 60]
    assert np.median(settled[:, 2]) == 0
    assert len(settled) / 30 > 9


@pytest.mark.parametrize("begins_s", [0.0, 1.0])
def test_a_thin_link_of_a_long_way_has_six_pictures_a_second_of_half_the_size(begins_s):
    """1 Mbit/s, 200 ms there and back, also on a tablet that begins slowly."""
    observed = watched(Link(125e3, 0.1), 60, begins_s=begins_s)
    settled = observed[observed[:, 0] > 5]
    assert len(settled) / 55 >= 6
    assert np.percentile(settled[:, 1], 95) < 0.4
    assert {LEVELS[int(level)].divisor for level in settled[:, 2]} <= {1, 2}


def test_attempts_at_larger_pictures_become_rare():
    observed = watched(Link(125e3), 100)
    late = observed[observed[:, 0] > 50]
    assert (late[:, 1] > 0.4).mean() < 0.01


def test_fewer_than_two_are_on_the_way_and_lost_ones_are_given_up():
    pace = Pace()
    pace.sent(1, 100, 0.0)
    assert pace.may_send(0.0)
    pace.sent(2, 100, 0.0)
    assert not pace.may_send(1.0)
    assert pace.may_send(4.0)


def test_an_answer_counts_for_those_before_it_and_only_once():
    pace = Pace()
    pace.sent(1, 100, 0.0)
    pace.sent(2, 100, 0.01)
    assert pace.shown(2, 0.02)
    assert not pace.shown(1, 0.02)
    assert not pace.shown(2, 0.02)
    assert not pace.shown(77, 0.02)
