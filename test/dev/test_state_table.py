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
"""The filter says over the sample flight what it said when its table was made."""

from __future__ import annotations

import pytest
from project import PROJECT

from dev.state_table import COLUMNS, HEADER, changes, main, states_text

TABLE = PROJECT / "test" / "data" / "sample_states.csv"
RENEW = "If the change is meant: 'make states' writes the table anew, and git diff shows it."


@pytest.fixture(scope="module")
def fresh(request):
    folder = request.getfixturevalue("sample")
    return states_text(folder / "flight.mcap", folder / "params.yaml")


def test_the_sample_flight_gives_the_tracked_states(fresh):
    """The tolerance is one in the last digit of each column."""
    moved = changes(TABLE.read_text(encoding="ascii"), fresh)
    assert not moved, "\n".join([f"{TABLE} is not what the filter gives now:", *moved, RENEW])


def with_cell(text, row, name, value):
    """A table with one cell changed; row 0 is the first after the header."""
    lines = [line.split(",") for line in text.splitlines()]
    lines[row + 1][HEADER.index(name)] = value
    return "\n".join(",".join(line) for line in lines) + "\n"


@pytest.mark.parametrize(("name", "decimals"), COLUMNS.items(), ids=COLUMNS)
def test_every_column_is_compared(fresh, name, decimals):
    stamp, *_ = cells = fresh.splitlines()[41].split(",")
    value, step = float(cells[HEADER.index(name)]), 10.0**-decimals
    near, far = (f"{value + digits * step:.{decimals}f}" for digits in (1, -3))
    assert changes(fresh, with_cell(fresh, 40, name, near)) == []
    (line,) = changes(fresh, with_cell(fresh, 40, name, far))
    assert line.startswith(f"{name}: 1 of ")
    assert f"most by -{3 * step:.{decimals}f} at {stamp}, where it was" in line


def test_states_and_rows_are_compared(fresh):
    (line,) = changes(fresh, with_cell(fresh, 200, "state", "lost"))
    assert line.startswith("state: 1 rows, first at ")
    assert line.endswith("running before, lost now")
    shorter = "".join(fresh.splitlines(keepends=True)[:-1])
    (line,) = changes(fresh, shorter)
    assert line.startswith("stamps differ: ")


def test_main_writes_and_tells_what_moved(fresh, sample, tmp_path, capsys):
    table = tmp_path / "states.csv"
    assert main([str(sample), str(table)]) == 0
    assert table.read_text() == fresh
    table.write_text(with_cell(fresh, 10, "height_m", "99.0000"))
    assert main([str(sample), str(table)]) == 0
    assert capsys.readouterr().out.startswith("height_m: 1 of ")
    assert table.read_text() == fresh
    assert main([str(tmp_path), str(table)]) == 1
    assert "states: " in capsys.readouterr().err
