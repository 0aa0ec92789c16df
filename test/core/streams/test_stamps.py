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
"""Which stamps are due at a rate, and when a stream counts as steady or gone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.streams.stamps import RateLimit, StreamPresence

MS = 1_000_000


def due(rate_hz: float, stamps: list[int]) -> list[int]:
    limit = RateLimit(rate_hz)
    return [stamp for stamp in stamps if limit.due(stamp)]


@pytest.mark.parametrize(("rate_hz", "expected"), [(100, 1000), (50, 500), (30, 300), (10, 100)])
def test_share_of_a_hundred_hertz(rate_hz, expected):
    jitter = np.random.default_rng(1).integers(-MS, MS, 1000)
    stamps = [10 * MS * k + int(jitter[k]) for k in range(1000)]
    assert len(due(rate_hz, stamps)) == pytest.approx(expected, abs=1)


def test_schedule_begins_anew_after_a_pause_and_when_stamps_go_back():
    first = [10 * MS * k for k in range(50)]
    later = [5_000 * MS + stamp for stamp in first]
    result = due(10.0, [*first, *later, *first])
    # In each run of half a second: the first stamp, then one after 80 ms (the schedule's 100 ms
    # less the allowed jitter), then one each 100 ms.
    run = [0, 80 * MS, 180 * MS, 280 * MS, 380 * MS, 480 * MS]
    assert result == [*run, *(5_000 * MS + stamp for stamp in run), *run]


def steady(period_ms=20, from_ms=0):
    presence = StreamPresence()
    t_ms = from_ms
    while not presence.add(t_ms * MS):
        assert t_ms - from_ms < 20_000
        t_ms += period_ms
    return presence, t_ms


@pytest.mark.parametrize(("period_ms", "after_ms"), [(20, 2000), (500, 2000), (1000, 4000)])
def test_steady_after_two_seconds_and_five_samples(period_ms, after_ms):
    presence, at_ms = steady(period_ms)
    assert at_ms == after_ms
    assert presence.steady
    assert not presence.add((at_ms + period_ms) * MS)  # it is steady already


def test_gone_after_two_seconds_of_silence_and_steady_again():
    presence, at_ms = steady()
    assert not presence.gone((at_ms + 1999) * MS)
    assert presence.gone((at_ms + 2000) * MS)
    assert not presence.gone((at_ms + 5000) * MS)  # reported only once
    assert not presence.add((at_ms + 5000) * MS)
    _, again_ms = steady(from_ms=at_ms + 5000)
    assert again_ms == at_ms + 7000


@given(st.lists(st.tuples(st.booleans(), st.integers(-3000, 3000)), max_size=60))
def test_becoming_and_ending_take_turns(events):
    presence, now_ms, reports = StreamPresence(), 0, []
    for is_sample, elapsed_ms in events:
        now_ms += elapsed_ms
        if is_sample and presence.add(now_ms * MS):
            reports.append("there")
        elif not is_sample and presence.gone(now_ms * MS):
            reports.append("gone")
    assert reports == [("there", "gone")[k % 2] for k in range(len(reports))]
    assert presence.steady == (len(reports) % 2 == 1)
