"""The figures of ekf_node under load, from what the two ends of the run write."""

from __future__ import annotations

import numpy as np
import pytest

from dev.imu_load import figures, load_of
from tirgeo_ros.core.types.errors import GraphError

START, STEP, MS = 1_700_000_000_000_000_000, 2_500_000, 1_000_000
STAMPS = START + STEP * np.arange(400 * 30)
SENT = np.stack([STAMPS, STAMPS + MS // 10], axis=1)
COUNTED = STAMPS > START + 20_000_000_000


def test_ages_and_losses_are_those_of_the_settled_samples():
    ages_ns = np.where(COUNTED, 2 * MS, 900 * MS)
    ages_ns[-1] = 7 * MS
    came = np.stack([STAMPS, STAMPS + ages_ns], axis=1)
    kept = np.ones(len(came), bool)
    kept[[100, -5, -6, -7]] = False  # one before all has settled
    load = load_of(SENT, came[kept], 0.25)
    assert load.lost == 3
    found = {figure.what.rpartition(": ")[2]: figure.value for figure in figures(load, 400.0)}
    assert found["stamp to odometry, 50 %"] == pytest.approx(2.0)
    assert found["stamp to odometry, 99 %"] == pytest.approx(2.0)
    assert found["stamp to odometry, 100 %"] == pytest.approx(7.0)
    assert found["of this the sender's lateness, 99 %"] == pytest.approx(0.1)
    assert found["one core"] == pytest.approx(25.0)


def test_a_run_without_poses_is_an_error():
    early = np.stack([STAMPS[:10], STAMPS[:10]], axis=1)
    with pytest.raises(GraphError, match="gave no pose"):
        load_of(SENT, early, 0.25)
