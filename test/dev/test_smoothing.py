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
"""``make smoothing``: what it measures, and what it marks; most of it on one short flight."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from project import PROJECT

from dev.consistency import Case
from dev.flight_errors import Squares
from dev.judging import MarkedTable
from dev.real_flights import Miss
from dev.smoothing import (
    FILTER,
    KINDS,
    SMOOTHER,
    Pair,
    fly_hidden,
    fly_outage,
    fly_pair,
    hidden,
    outages,
    ratios,
    shapes,
)

FLIGHT = "p4rtk_vertical_03.mcap"


def lines_of(make, found):
    table = MarkedTable(26, 9)
    return "\n".join(make(table, found)), table.missed


@pytest.mark.slow
def test_the_smoother_is_better_on_every_axis():
    found = fly_pair(Case("lawnmower", 100.0, 5, 45.0))
    for span in (found.whole, found.inner):
        assert (span[SMOOTHER].position < 0.7 * span[FILTER].position).all()
        assert span[SMOOTHER].rpy[:2].sum() < span[FILTER].rpy[:2].sum()
    text, _ = lines_of(shapes, [found])
    assert "smoother, to the end" in text


@pytest.mark.slow
def test_an_outage_is_flown():
    found = [fly_outage(seed) for seed in (1, 2)]  # in some flights the filter itself is good
    by_kind = {kind: sum(each[kind].position.sum() for each in found) for kind in KINDS}
    assert by_kind[SMOOTHER] < 0.25 * by_kind[FILTER]
    assert lines_of(outages, found)[1] <= 1  # of two flights the rms may be above all flights'


@pytest.mark.slow
def test_hidden_fixes_of_a_recorded_flight():
    path = PROJECT.parent / "shared" / "real_flights" / FLIGHT
    if not path.exists():
        pytest.skip(f"there is no {path}")
    found = fly_hidden(path)
    filtered, smoothed = (
        np.median([miss.error_m for miss in found[kind]]) for kind in (FILTER, SMOOTHER)
    )
    assert smoothed < 0.5 * filtered
    assert "smoother" in lines_of(hidden, [found])[0]


def squares(scale):
    ratio = np.full(9, scale**2)
    return Squares(np.full(3, 1e-8) * scale, np.full(3, 1e-6) * scale, ratio)


def test_what_is_missed_is_marked():
    """Of the smoother alone: 1 mm, 0.006 deg and a ratio of 1 are good, 3 times that is not."""
    pair = fly_nothing()
    assert lines_of(ratios, [pair])[1] == 0
    bad = replace(pair, whole=pair.whole | {SMOOTHER: squares(3.0)})
    assert lines_of(ratios, [bad])[1] == 9
    worse = replace(pair, whole=pair.whole | {FILTER: squares(3.0)})
    assert lines_of(ratios, [worse])[1] == 0


def fly_nothing():
    good = {FILTER: squares(1.0), SMOOTHER: squares(1.0)}
    return Pair(Case("hover", 100.0, 1), good, good)


def test_misses_are_judged_at_the_last_fix():
    good, bad = Miss(0.1, 0.1), Miss(2.0, 0.1)
    assert lines_of(hidden, [{FILTER: [bad], SMOOTHER: [good]}])[1] == 0
    assert lines_of(hidden, [{FILTER: [good], SMOOTHER: [bad]}])[1] == 2
    assert not Miss(math.nan, math.nan).within(3)
