"""Every fault of the table through the smoother: the filter's verdicts, and numbers that hold."""

from __future__ import annotations

import numpy as np
import pytest
from flights import config_for
from scenario.runs import FLIGHTS, faulty
from scenario.table import TABLE, Row

from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed

pytestmark = [pytest.mark.slow, pytest.mark.long]


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_row(row: Row):
    flown = FLIGHTS[row.flight]()
    fed = list(faulty(flown, row.fault, row.start_s, row.end_s))
    config, samples = config_for(flown), [delivery.sample for delivery in fed]
    steps, smooth = (
        [navigation.process(sample) for sample in samples]
        for navigation in (Navigation(config), smoothed(config, samples))
    )
    assert [step.verdict for step in smooth] == [step.verdict for step in steps]
    for one, other in zip(steps, smooth, strict=True):
        assert (one.solution is None) == (other.solution is None)
        if other.solution is not None:
            assert one.solution.stamp_ns == other.solution.stamp_ns
            check(other.solution)


def check(solution):
    """Finite, a unit quaternion, a covariance that is positive."""
    numbers = np.concatenate([np.ravel(part) for part in solution[1:]])
    assert np.isfinite(numbers).all()
    assert np.linalg.norm(solution.q_nb) == pytest.approx(1.0, abs=1e-12)
    sigma = np.sqrt(solution.covariance.diagonal())
    assert np.linalg.eigvalsh(solution.covariance / np.outer(sigma, sigma))[0] > 0
