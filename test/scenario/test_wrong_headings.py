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
"""Antennas that are swapped, or elsewhere than the parameters say, never win by patience."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scenario.faults import turned
from scenario.runs import DURATION_S, calm, faulty, run, sizes

from tirgeo_ros.core.types.verdicts import FilterState

pytestmark = pytest.mark.slow

WRONG_DEG = (90.0, 180.0, 45.0, -90.0)
RIGHT_AGAIN_S = 5.0  # asked


def states_between(done, first_s, last_s):
    """All states from one time to another."""
    before = [state for t, state in done.changes if t <= first_s][-1:]
    return {*before, *(state for t, state in done.changes if first_s < t <= last_s)}


@pytest.mark.parametrize("degrees", WRONG_DEG)
def test_wrong_from_the_start_is_named_and_waited_out(degrees):
    end_s = 30.0
    done = run(calm(), faulty(calm(), turned(degrees), -1.0, end_s))
    starting = {FilterState.WAITING, FilterState.ALIGNING}
    assert states_between(done, 0.0, end_s) <= starting
    assert states_between(done, end_s + RIGHT_AGAIN_S, DURATION_S) == {FilterState.RUNNING}
    heading_deg, _, position_m = sizes(done)
    # Just aligned: three sigmas of one heading of 0.6 deg, and of a position of 2.4 cm in space.
    assert heading_deg.max() < 1.8
    assert position_m.max() < 0.08


@pytest.mark.long
@pytest.mark.parametrize("degrees", WRONG_DEG)
def test_wrong_for_ever_says_what_to_look_at(degrees):
    done = run(calm(), faulty(calm(), turned(degrees), -1.0, 1e3))
    assert not done.published
    assert done.status.state is FilterState.ALIGNING
    assert "aircraft.second_antenna_m" in done.status.reason
    reports = re.search(r"differ by (\d+) deg", done.status.reason)
    # The autopilot's heading errs by 1.8 deg rms: five of these.
    assert float(reports.group(1)) == pytest.approx(abs(degrees), abs=9.0)


@pytest.mark.parametrize("degrees", [*WRONG_DEG, 25.0])
@pytest.mark.parametrize("end_s", [45.0, 1e3])
def test_wrong_in_flight_is_refused_for_as_long_as_it_lasts(degrees, end_s):
    # 1.5 s, the time-out of an aid, are believed to be a silence.
    start_s, noticed_s = 20.0, 1.6
    done = run(calm(), faulty(calm(), turned(degrees), start_s, end_s))
    last_s = min(end_s, DURATION_S)
    assert states_between(done, start_s + noticed_s, last_s) == {FilterState.DEGRADED}
    if end_s < DURATION_S:
        assert states_between(done, end_s + RIGHT_AGAIN_S - 0.1, DURATION_S) == {
            FilterState.RUNNING
        }
    else:
        assert "rtk/heading refused: " in done.status.reason
        assert "antennas swapped?" in done.status.reason
    assert done.resets == 0
    heading_deg, tilt_deg, position_m = sizes(done)
    flown = done.errors.t_s > start_s
    # Gyroscopes alone for 30 s: three sigmas of the 0.15 deg that they make of 0.11.
    assert np.max(heading_deg[flown]) < 0.45
    assert max(np.max(tilt_deg[flown]) / 0.3, np.max(position_m[flown]) / 0.05) < 1
