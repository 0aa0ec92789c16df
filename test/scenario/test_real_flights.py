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
"""Recorded flights at default parameters: what the table of ``make real-flights`` asks.

The bags lie beside the project, and tests skip where they are not.
"""

from __future__ import annotations

import math

import pytest

from dev.real_flights import ASKED, bags_in, groups, judge_all, report
from tirgeo_ros.tools.replay.check import check

pytestmark = pytest.mark.slow

P4, WALK = "p4rtk, positions", "walk, positions, velocities"
BAGS = (
    *(f"p4rtk_horizontal_{name}" for name in ("03", "06", "09", "15", "18", "24")),
    *(f"p4rtk_horizontal_{name}_differenced_velocity" for name in ("09", "24")),
    *(f"p4rtk_vertical_{name}" for name in ("03", "15", "24")),
    "walk_0827",
)


def test_recorded_flights_miss_no_figure(shared):
    """Each bag's fixes, poses, resets and moved positions; the groups' tilt, NIS and cuts."""
    folder = shared / "real_flights"
    if not folder.is_dir():
        pytest.skip(f"no {folder}: the recorded flights are absent")
    result = judge_all(bags_in(folder), {}, workers=2)
    assert sorted(each.name for each in result) == sorted(BAGS)
    lines, missed = report(result)
    assert not missed, "\n".join(lines)
    for each in result:
        assert each.flown.fixes > 100  # 10 Hz, or 4 on the walk, for more than 10 s
        assert min(each.moved_m) > 0  # each wrong position was heard
    cuts = {
        name: [cut for each in bags for cut in each.cuts] for name, bags in groups(result).items()
    }
    # Of nine flights at three phases; and of the walk.
    assert (len(cuts[P4]), len(cuts[WALK])) == (44, 27)
    assert not any(math.isnan(cut.error_m) for cut in cuts[P4])
    assert ASKED.keys() == {P4, WALK}  # more is asked of both groups


@pytest.mark.parametrize("name", BAGS)
def test_nothing_is_wrong_with_recorded_flights(name, shared):
    findings = check(shared / "real_flights" / f"{name}.mcap")["findings"]
    assert [item for item in findings if item["severity"] != "note"] == []
