"""Six seconds of the sample flight as tables and filtered."""

from __future__ import annotations

import pytest
from library_flights import filtered

import tirgeo_ros


@pytest.fixture(scope="session")
def tables(short):
    return tirgeo_ros.read_bag(short)


@pytest.fixture(scope="session")
def flight(tables, params):
    return filtered(tables, config=params)
