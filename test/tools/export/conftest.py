"""The sample flight as every exporter gets it."""

from __future__ import annotations

import pytest
from exported_flight import exported


@pytest.fixture(scope="session")
def flight(sample):
    return exported(sample)
