"""Every row of the table, on a flight through the estimator's one door."""

from __future__ import annotations

import pytest
from scenario.complaints import complaints
from scenario.runs import FLIGHTS, faulty, run
from scenario.table import TABLE, Row

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_row(row: Row):
    flown = FLIGHTS[row.flight]()
    done = run(flown, faulty(flown, row.fault, row.start_s, row.end_s))
    assert complaints(row, done) == []
