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
"""A flight without end: nothing jumps or grows; the figures of ekf_node under its load."""

from __future__ import annotations

import gc
import itertools
import tracemalloc

import numpy as np
import pytest

from dev.bench.imu_load import figures, load_of
from dev.flights import LoopedFlight
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.core.types.verdicts import Outcome

RATE_HZ = 50.0


@pytest.fixture(scope="module")
def looped():
    return LoopedFlight(RATE_HZ)


def first_minutes(looped, count):
    return list(itertools.islice(looped.minutes(), count))


@pytest.mark.slow
def test_the_filter_sees_no_seam(looped):
    navigation = Navigation(looped.config)
    for minute in first_minutes(looped, 3):
        for sample in minute:
            step = navigation.process(sample)
            assert step.verdict.outcome not in {
                Outcome.GATED,
                Outcome.RESET,
                Outcome.RESTART,
                Outcome.GAP,
                Outcome.OUT_OF_ORDER,
                Outcome.TIME_JUMP,
            }, step.verdict
    assert navigation.status().state.value == "running"


@pytest.mark.slow
@pytest.mark.long
def test_memory_does_not_grow_with_the_flight(looped):
    """The most memory in use is as large in the third minute as in the first.

    A leak of one float (32 bytes with its place in a list) per RTK epoch would be 38 kB by then;
    temporary arrays and the history's length make 5 kB of difference.
    """
    navigation, minutes, peaks = Navigation(looped.config), first_minutes(looped, 3), []
    tracemalloc.start()
    for minute in minutes:
        gc.collect()
        tracemalloc.reset_peak()
        for sample in minute:
            navigation.process(sample)
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[2] - peaks[0] < 15_000, peaks


LENGTH_S = 60.0
START, STEP, MS = 1_700_000_000_000_000_000, 2_500_000, 1_000_000
STAMPS = START + STEP * np.arange(400 * 30)
SENT = np.stack([STAMPS, STAMPS + MS // 10], axis=1)
COUNTED = STAMPS > START + 20_000_000_000


def values_of(load):
    return {figure.what.rpartition(": ")[2]: figure.value for figure in figures(load, 400.0)}


def test_ages_are_those_of_the_settled_samples_and_losses_of_all():
    ages_ns = np.where(COUNTED, 2 * MS, 900 * MS)
    ages_ns[-1] = 7 * MS
    came = np.stack([STAMPS, STAMPS + ages_ns], axis=1)[::4]
    came[-1] = STAMPS[-1], STAMPS[-1] + ages_ns[-1]
    values = values_of(load_of(SENT, came, len(SENT) - 3, LENGTH_S, 0.2, 80.0, 0.25, 0.05))
    assert values["samples lost"] == 3
    assert values["stamp to odometry, 50 %"] == pytest.approx(2.0)
    assert values["stamp to odometry, 99 %"] == pytest.approx(2.0)
    assert values["stamp to odometry, 100 %"] == pytest.approx(7.0)
    assert values["the sender's lateness, 99 %"] == pytest.approx(0.1)
    assert values["over the bare one"] == pytest.approx(5.0)


def test_nobody_who_listens_is_no_age():
    nobody = np.empty((0, 2), np.int64)
    values = values_of(load_of(SENT, nobody, len(SENT), LENGTH_S, 0.1, 80.0, 0.1, 0.05))
    assert not any("odometry" in name for name in values)
    assert values["samples lost"] == 0


def test_too_short_a_run_is_an_error():
    with pytest.raises(GraphError, match="longer than 30 s"):
        load_of(SENT[:10], SENT[:10], 10, LENGTH_S, 0.2, 80.0, 0.25, 0.05)
