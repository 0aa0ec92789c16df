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
"""A measurement that is sent again at a polling rate is one measurement."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import fix, heading, ns, velocity

from tirgeo_ros.core.navigation.timeline.aid_stamps import DuplicateDetector, Same
from tirgeo_ros.core.types.measurements import FixStatus, Source

NEW, AGAIN, VALUE = Same.NOTHING, Same.MEASUREMENT, Same.VALUE


def position(t_s, north_m, source=Source.RTK_POSITION):
    return fix(t_s, (north_m, 0.0, 0.0), source)


def moving(t_s, north_m_s, source=Source.RTK_VELOCITY):
    return velocity(t_s, (north_m_s, 0.0, 0.0), source)


def polled(seconds, poll_hz=50.0, receiver_hz=5.0, jitter_s=0.0, seed=1):
    """(poll time, epoch of the receiver) of a driver that polls faster than the receiver."""
    rng = np.random.default_rng(seed)
    for k in range(round(seconds * poll_hz)):
        t_s = k / poll_hz
        yield t_s + jitter_s * rng.uniform(-1, 1), math.floor(t_s * receiver_hz + 1e-6)


@pytest.mark.parametrize("jitter_s", [0.0, 0.005])
@pytest.mark.parametrize(
    ("make", "source"),
    [
        (position, Source.RTK_POSITION),
        (position, Source.GPS_POSITION),
        (moving, Source.RTK_VELOCITY),
        (moving, Source.GPS_VELOCITY),
    ],
)
def test_polled_positions_and_velocities_are_taken_once(make, source, jitter_s):
    repeats = DuplicateDetector()
    result = [
        repeats.compared(make(t_s, 0.6 * epoch, source))
        for t_s, epoch in polled(10.0, jitter_s=jitter_s)
    ]
    # With the first stamp, which is the one nearest to the measurement.
    assert result == [NEW, *[AGAIN] * 9] * 50


@pytest.mark.parametrize(("jitter_s", "burst"), [(0.0, False), (0.004, False), (0.0, True)])
def test_polled_headings_in_whole_degrees_are_taken_once(jitter_s, burst):
    """They repeat for many epochs; the positions beside them show when a measurement is new.

    A burst is a serial line that held one fix back: it does not make a fast receiver.
    """
    repeats, taken = DuplicateDetector(), []
    for t_s, epoch in polled(20.0, jitter_s=jitter_s):
        repeats.compared(position(t_s, 0.6 * epoch))
        if burst and t_s == pytest.approx(10.06):
            repeats.compared(position(t_s + 0.005, 0.6 * epoch + 0.3))  # one in between
            repeats.compared(position(t_s + 0.006, 0.6 * epoch))
        same = repeats.compared(heading(t_s, 20.0 + epoch // 7))
        if epoch >= 10 and same is not AGAIN:  # eight positions tell the receiver's rate
            taken.append(epoch)
    assert taken == list(range(10, 100))


def test_at_rest_with_constant_values_something_is_taken():
    """On a test bench, or with rounding: about one a second is used, so no aid is missing."""
    repeats = DuplicateDetector()
    taken = [t for t, _ in polled(20.0) if repeats.compared(position(t, 0.0)) is not AGAIN]
    gaps = np.diff(taken)
    assert 0.8 < gaps.min() <= gaps.max() <= 1.0


@pytest.mark.parametrize("worse", [FixStatus.FLOAT, FixStatus.SINGLE, FixStatus.NONE])
def test_the_same_position_with_a_worse_fix_is_news(worse):
    """Else the filter would trust centimetres until the next position."""
    repeats, fixed = DuplicateDetector(), position(0.0, 1.0)
    repeats.compared(fixed)
    fallen = replace(fixed, stamp_ns=ns(0.02), status=worse)
    assert repeats.compared(fallen) is NEW
    assert repeats.compared(replace(fallen, stamp_ns=ns(0.04))) is AGAIN
    # Fixed again with the old position: that was not measured when fixed.
    assert repeats.compared(replace(fixed, stamp_ns=ns(0.06))) is AGAIN


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        ([position(0.0, 1.0), position(0.2, 2.0), position(0.4, 1.0)], [NEW, NEW, NEW]),
        # Each source by itself.
        (
            [position(0.0, 1.0), position(0.01, 1.0, Source.GPS_POSITION), position(0.02, 1.0)],
            [NEW, NEW, AGAIN],
        ),
        # The same stamp: what was held or refused may come again; the time line judges that.
        ([position(0.0, 1.0), position(0.0, 1.0)], [NEW, VALUE]),
        ([heading(0.0, 20.0), heading(0.02, 20.0 + 1e-9)], [NEW, NEW]),
        # Whole degrees of a receiver that is not polled: every heading is a new one.
        (
            [item for k in range(9) for item in (position(0.2 * k, k), heading(0.2 * k, 20.0))],
            [NEW, NEW, *[NEW, VALUE] * 8],
        ),
    ],
)
def test_sequences(samples, expected):
    repeats = DuplicateDetector()
    assert [repeats.compared(sample) for sample in samples] == expected
