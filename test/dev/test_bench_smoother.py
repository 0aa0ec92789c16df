"""What make bench says of the smoother, and whether its rival is as good as it can be."""

from __future__ import annotations

import numpy as np
import pytest

from dev import bench_filter, bench_smoother
from dev.bench_pyins import pyins_is_installed, pyins_run
from dev.bench_pyins_smoother import pyins_smoother_errors, smoothed_pyins
from tirgeo_ros.core.accuracy.ground_errors import rms


@pytest.mark.slow
def test_without_pyins_the_smoother_is_measured_alone(monkeypatch):
    monkeypatch.setattr(bench_smoother, "_RUNS", 1)
    monkeypatch.setattr(bench_filter, "_FLIGHT_S", 25.0)
    monkeypatch.setattr(bench_smoother, "pyins_is_installed", lambda: False)
    own, rival = bench_smoother.smoother_times()
    assert rival is None
    assert 1e-6 < own.cost_s < 1e-2  # per sample, not per flight
    assert 0 < own.tilt_deg < 0.2
    assert 0 < own.position_m < 0.03


@pytest.mark.slow
@pytest.mark.long
def test_the_cost_of_an_hour_is_that_of_its_passes():
    cost = bench_smoother._hour_cost(2)
    assert 1e6 < cost.peak_bytes < 1e9
    assert cost.ratio > 1.0  # the second pass alone is the filter and more
    assert 0 < cost.backward_s < cost.first_s


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(not pyins_is_installed(), reason="pyins is not installed: make bench does")
def test_pyins_is_better_smoothed_than_filtered():
    flight = bench_filter.bench_flight()
    run = pyins_run(flight)
    filtered = run.errors(run.run()).after(20.0)
    smoothed = pyins_smoother_errors(run, smoothed_pyins(run)).after(20.0)
    assert len(smoothed.t_s) > 190  # ten a second
    assert (rms(smoothed.state[:, :3]) < 0.8 * rms(filtered.state[:, :3])).all()
    assert np.degrees(rms(smoothed.rpy)).max() < 0.06
