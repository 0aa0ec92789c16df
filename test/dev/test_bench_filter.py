"""What make bench says of the filter: pyins is flown as well as it can, the rest is measured."""

from __future__ import annotations

import numpy as np
import pytest

from dev import bench_filter
from dev.bench_pyins import pyins_is_installed, pyins_run
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from


def test_without_pyins_the_filter_is_measured_alone(monkeypatch):
    monkeypatch.setattr(bench_filter, "_RUNS", 1)
    monkeypatch.setattr(bench_filter, "_FLIGHT_S", 25.0)
    monkeypatch.setattr(bench_filter, "pyins_is_installed", lambda: False)
    own, rival = bench_filter.filter_times()
    assert rival is None
    assert 1e-6 < own.cost_s < 1e-2  # per sample, not per flight
    assert 0 < own.tilt_deg < 0.3
    assert 0 < own.heading_deg < 0.3
    assert 0 < own.position_m < 0.05


@pytest.mark.slow
@pytest.mark.long
def test_a_long_flight_is_measured_at_both_ends(monkeypatch):
    monkeypatch.setattr(bench_filter, "_HOUR_MINUTES", 3)
    monkeypatch.setattr(bench_filter, "_COMPARED_MINUTES", 1)
    told = []
    times = bench_filter.long_times(lambda done, total: told.append((done, total)))
    assert told == [(0, 3), (1, 3), (2, 3)]
    assert 1e-6 < times.first_s < 1e-2
    # Of the same samples; a busy machine makes CPU times differ, though not threefold.
    assert 1 / 3 < times.last_s / times.first_s < 3


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(not pyins_is_installed(), reason="pyins is not installed: make bench does")
def test_pyins_is_given_what_it_needs_to_be_good():
    """What a cost is worth depends on the accuracy: 0.12 deg and 2 cm, as the filter's own."""
    flight = fly(scenario_from({"duration_s": 30.0}), 3)
    rival = pyins_run(flight)
    late = rival.errors(rival.run()).after(20.0)
    assert len(late.t_s) == 1000
    assert np.degrees(rms(late.rpy)).max() < 0.12
    assert rms(late.state[:, :3]).max() < 0.02
