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
from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.dji.clocks.capture_clock import (
    RESTART_NS,
    CaptureTimeline,
    WholeSeconds,
    guess_utc_offset,
    time_of_words,
)

MS = 1_000_000
SECOND = 1_000_000_000
HOUR = 3600 * SECOND
UTC_NS = 1_750_000_000 * SECOND


def test_after_a_reset_stamps_continue_a_second_later():
    clock = CaptureTimeline(start_ns=UTC_NS).clock()
    for tick in range(500_000, 501_000, 10):
        newest = clock.stamp_ns(tick)
    first = clock.stamp_ns(20)  # it could be a wrong count
    second = clock.stamp_ns(30)
    assert first == newest
    assert second == newest + RESTART_NS
    assert clock.stamp_ns(40) == second + 10 * MS


@pytest.mark.parametrize("wrong", [3, 10**6, 2**32 - 1])
def test_a_wrong_count_alone_changes_nothing(wrong):
    clock = CaptureTimeline().clock()
    stamps = [clock.stamp_ns(tick) for tick in (500_000, 500_010, wrong, 500_030)]
    assert stamps == [500_000 * MS, 500_010 * MS, 500_010 * MS, 500_030 * MS]


def test_the_order_of_messages_gives_the_offset_of_another_counter():
    # Two clocks 24.6 s apart, at 100 and 50 Hz: the messages of the second are sent at random
    # within periods of the first. The one that most closely follows one of the first is decisive.
    rng = np.random.default_rng(1)
    timeline = CaptureTimeline()
    clock, other = timeline.clock(), timeline.clock()
    events = [(1000 + 10 * n, clock, 0) for n in range(500)]
    events += [(1003 + 20 * n + int(rng.integers(-9, 9)), other, 24_600) for n in range(1, 240)]
    errors, stamps = [], []
    for sent, each, ahead in sorted(events, key=lambda event: event[0]):
        stamp = each.stamp_ns(sent + ahead)
        if each is other:
            stamps.append(stamp)
            errors.append((stamp - sent * MS) / MS)
    assert np.all(np.diff(stamps) > 0)
    assert min(errors) >= -10  # a period of the first clock
    assert max(errors) <= 0
    assert errors[-1] == 0  # one of 240 messages came in the same ms as one of the first


def test_all_counters_start_again_together():
    timeline = CaptureTimeline()
    clock, other = timeline.clock(), timeline.clock()
    for tick in range(50_000, 51_000, 10):
        clock.stamp_ns(tick)
        newest = other.stamp_ns(tick + 3)
    stamps = [
        each.stamp_ns(tick + late)
        for tick in range(100, 200, 10)
        for each, late in ((clock, 0), (other, 3))
    ]
    assert stamps[2] == newest + RESTART_NS
    assert np.all(np.diff(stamps[2:]) > 0)
    assert stamps[3] - stamps[2] == 3 * MS


def test_a_counter_that_resets_alone_keeps_the_time_of_the_others():
    timeline = CaptureTimeline()
    clock, sync = timeline.clock(), timeline.clock(tick_ns=2_500_000, resets_alone=True)
    errors = []
    for sent in range(10_000, 20_000, 10):
        errors.append(clock.stamp_ns(sent) / MS - sent)
        for part in range(4):  # 400 Hz; the counter is set to zero in the middle
            tick = 4 * (sent - (15_000 if sent >= 15_000 else 0)) // 10 + part
            errors.append(sync.stamp_ns(tick) / MS - sent - 2.5 * part)
    # A single wrong count is not used: it and the next message get the newest stamps.
    assert min(errors) >= -5.0
    assert max(errors) <= 0.0
    assert timeline.restarts == 0
    assert errors[-1] == 0.0


@given(
    st.lists(
        st.tuples(
            st.integers(0, 2),
            st.one_of(st.integers(0, 2**32 - 1), st.integers(0, 3000)),
            st.integers(-10, 2**32),
        ),
        max_size=80,
    )
)
def test_stamps_of_random_messages(messages):
    timeline = CaptureTimeline()
    clocks = [timeline.clock(), timeline.clock(), timeline.clock(2_500_000, resets_alone=True)]
    for which, ticks, extra_ns in messages:
        assert isinstance(clocks[which].stamp_ns(ticks, 0, extra_ns), int)


@pytest.mark.parametrize(
    ("date", "time"),
    [
        (0, 0),
        (20240611, 240000),
        (20240611, 120060),
        (20230229, 120000),
        (20241301, 120000),
        (19800106, 120000),
        (2**32 - 1, 120000),
        (20240611, 2**32 - 1),
    ],
)
def test_invalid_words_give_no_time(date, time):
    assert time_of_words(date, time) is None


def as_words(utc_ns, offset_h):
    local = datetime.fromtimestamp(utc_ns // SECOND, timezone(timedelta(hours=offset_h)))
    return int(local.strftime("%Y%m%d")), int(local.strftime("%H%M%S"))


def five_a_second(seconds, offset_h, wrong=0):
    """Return stamps and words of epochs at fifths of a second, sent 20 to 60 ms later."""
    rng = np.random.default_rng(2)
    powered_ns = UTC_NS - 77 * SECOND - 123 * MS
    messages = []
    for n in range(seconds * 5):
        epoch_ns = UTC_NS + n * SECOND // 5
        sent_ns = epoch_ns + int(rng.integers(20 * MS, 60 * MS))
        words = (20200101, 0) if n < wrong else as_words(epoch_ns, offset_h)
        messages.append((sent_ns - powered_ns, *words))
    return powered_ns, messages


@pytest.mark.parametrize("offset_h", [0, 8])
def test_whole_seconds_give_a_captures_civil_time(offset_h):
    powered_ns, messages = five_a_second(60, offset_h, wrong=30)
    seconds = WholeSeconds()
    assert seconds.shift_ns is None
    for message in messages:
        seconds.take(*message)
    assert seconds.tick_ns == MS
    modified_ns = UTC_NS + 61 * SECOND
    newest_ns = seconds.newest_ns + seconds.shift_ns
    assert guess_utc_offset(newest_ns, modified_ns) == offset_h
    assert guess_utc_offset(newest_ns, modified_ns + 900 * HOUR) is None
    late_ms = (powered_ns - (seconds.shift_ns - offset_h * HOUR)) / MS
    # The earliest of 54 first messages of a second was sent 20 to 21 ms after its epoch.
    assert 20 <= late_ms < 23
