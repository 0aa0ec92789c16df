"""Errors of located points that share a cause: found by name and size, and else not found."""

from __future__ import annotations

import numpy as np
import pytest
from planted_offsets import COUNT, flight

from tirgeo_ros.tools.evaluate.systematic import Cause, find_systematic


@pytest.mark.parametrize(
    ("cause", "planted"),
    [
        (Cause.BORESIGHT, (0.0, 0.0, 0.05)),
        (Cause.BORESIGHT, (0.02, -0.03, 0.0)),
        (Cause.LATENCY, (0.15,)),
        (Cause.DATUM, (1.6, -1.8)),
        (Cause.HEIGHT, (3.0,)),
        (Cause.HEIGHT, (-3.0,)),
    ],
)
def test_each_cause_is_found_with_its_size(cause, planted):
    given = planted if len(planted) > 1 else planted[0]
    found = find_systematic(flight(**{cause.value: given}), COUNT)
    assert found is not None
    assert found.causes == (cause,)
    # of second order: the planted angles are to 3 deg, the heights 8 % of the camera's
    np.testing.assert_allclose(found.size, planted, atol=0.1 * np.linalg.norm(planted))
    assert found.share > 0.9


@pytest.mark.parametrize("seed", range(10))
def test_clicks_that_scatter_share_nothing(seed):
    assert find_systematic(flight(seed=seed, scatter_px=8.0), COUNT) is None


def test_one_direction_of_view_does_not_tell_a_datum_from_a_boresight():
    moves = flight(headings=(0,), depressions=(60, 60), scatter_px=15.0, datum=(2.0, 0.0))
    found = find_systematic(moves, COUNT)
    assert {Cause.DATUM, Cause.BORESIGHT} <= set(found.causes)


def test_without_rates_there_is_no_latency():
    moves = [one._replace(by={k: v for k, v in one.by.items() if k is not Cause.LATENCY})
             for one in flight(latency=0.15)]  # fmt: skip
    found = find_systematic(moves, COUNT)
    assert found is None or Cause.LATENCY not in found.causes
