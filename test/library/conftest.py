"""Six seconds of the sample flight, as a bag, as tables and filtered."""

from __future__ import annotations

import pytest
from library_flights import filtered
from process_bags import rewritten

import tirgeo_ros


@pytest.fixture(scope="session")
def short(sample, tmp_path_factory):
    target = tmp_path_factory.mktemp("library") / "short.mcap"
    return rewritten(sample / "flight.mcap", target, seconds=6)


@pytest.fixture(scope="session")
def tables(short):
    return tirgeo_ros.read_bag(short)


@pytest.fixture(scope="session")
def params(sample):
    return sample / "params.yaml"


@pytest.fixture(scope="session")
def flight(tables, params):
    return filtered(tables, config=params)
