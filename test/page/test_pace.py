"""The pace of pictures over simulated links: age, size and rate, and how they recover."""

from __future__ import annotations

import heapq

import numpy as np
import pytest

from tirgeo_ros.page.video import LEVELS, Pace

FULL = 95_000  # bytes of an untouched picture
HZ = 30.0


class Link:
    """A link in simulated time: so many bytes a second, after one another, and a delay."""

    def __init__(self, bytes_a_s, delay_s=0.02):
        self.bytes_a_s, self.delay_s = bytes_a_s, delay_s
        self._free_s = 0.0

    def arrival(self, now_s, size):
        self._free_s = max(self._free_s, now_s) + size / self.bytes_a_s
        return self._free_s + self.delay_s


def watched(link, seconds, change=None):
    """(time, age, level) of each picture as it is shown."""
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
            last, size = newest, FULL * LEVELS[pace.level].share
            pace.sent(newest, now_s)
            at_s = link.arrival(now_s, size) + link.delay_s  # the answer's way back
            heapq.heappush(answers, (at_s, newest, (newest - 1) / HZ, pace.level))
    return np.array(shown)


def test_a_good_link_has_untouched_pictures_at_full_rate_at_once():
    seen = watched(Link(50e6, 0.002), 10)
    assert (seen[seen[:, 0] > 0.2][:, 2] == 0).all()
    assert len(seen) > 290


# The ages asked for, of 500 ms, with room for what the simulated link leaves out.
@pytest.mark.parametrize("megabits", [0.5, 1.0, 2.0, 4.0])
def test_a_thin_link_has_young_pictures_that_use_it(megabits):
    seen = watched(Link(megabits * 125e3), 60)
    settled = seen[seen[:, 0] > 3]
    assert np.percentile(settled[:, 1], 95) < 0.4
    assert len(settled) / 57 > 3
    used = sum(LEVELS[int(level)].share for level in settled[:, 2]) * FULL / 57
    assert used > 0.5 * megabits * 125e3
    if megabits >= 1:
        assert np.median(settled[:, 2]) <= 5  # a person can be seen


def test_a_long_way_alone_makes_no_small_pictures():
    seen = watched(Link(10e6, 0.06), 30)
    assert np.median(seen[seen[:, 0] > 10][:, 2]) == 0


def test_pictures_follow_a_link_that_breaks_down_and_one_that_recovers():
    down = watched(Link(10e6), 20, change=(10, 125e3))
    assert (down[(down[:, 0] > 5) & (down[:, 0] < 10)][:, 2] == 0).all()
    assert (down[down[:, 0] > 12.5][:, 1] < 0.5).all()
    up = watched(Link(125e3), 60, change=(20, 10e6))
    assert (up[up[:, 0] > 55][:, 2] == 0).all()


def test_attempts_at_larger_pictures_become_rare():
    seen = watched(Link(125e3), 100)
    late = seen[seen[:, 0] > 50]
    assert (late[:, 1] > 0.4).mean() < 0.01


def test_fewer_than_two_are_on_the_way_and_lost_ones_are_given_up():
    pace = Pace()
    pace.sent(1, 0.0)
    assert pace.may_send(0.0)
    pace.sent(2, 0.0)
    assert not pace.may_send(1.0)
    assert pace.may_send(4.0)


def test_an_answer_counts_for_those_before_it_and_only_once():
    pace = Pace()
    pace.sent(1, 0.0)
    pace.sent(2, 0.01)
    assert pace.shown(2, 0.02)
    assert not pace.shown(1, 0.02)
    assert not pace.shown(2, 0.02)
    assert not pace.shown(77, 0.02)
