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
"""The search for silent losses: what it calls silent; a place is damaged again by its seed."""

from __future__ import annotations

import pytest
from foreign_logs import POS

from dev.damaged_logs import KINDS, Found, Kind, place, verdict


def rows(*stamps_ns, value=b"v"):
    return [("/a", at_ns, bytes(12) + value + bytes([k])) for k, at_ns in enumerate(stamps_ns)]


WHOLE = Found(rows(10, 20, 30), "None, None")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (WHOLE, "same"),
        (Found(rows(10, 20), WHOLE.warning), "as damaged"),
        (Found(rows(10, 20, 31), WHOLE.warning), "as damaged"),
        (Found(rows(10), WHOLE.warning), "SILENT: 2 rows"),
        (Found(rows(15, 25, 35), WHOLE.warning), "SILENT: 3 rows"),
        (Found(rows(10, 20, 30, value=b"w"), WHOLE.warning), "SILENT: 3 rows"),
        (Found(rows(10), "refused 2, None"), "told"),
        (Found([], "None, damaged", refused=True), "refused"),
    ],
)
def test_what_is_silent(found, expected):
    assert verdict(WHOLE, found, Kind("")) == expected


def test_the_clock_of_an_autopilot_may_move_all_a_little():
    assert verdict(WHOLE, Found(rows(15, 25, 35), WHOLE.warning), Kind("", step_ns=5)) == "same"


def test_a_place_is_damaged_again_by_its_seed(tmp_path):
    (tmp_path / "rtklib").mkdir()
    (tmp_path / "rtklib" / "a.pos").write_text(POS)
    assert "RTKLIB .pos" in KINDS
    first = [place(tmp_path, "RTKLIB .pos", number, 0) for number in range(20)]
    assert first == [place(tmp_path, "RTKLIB .pos", number, 0) for number in range(20)]
    assert len({where for where, _ in first}) == 20
    assert not any("SILENT" in found for _, found in first)
