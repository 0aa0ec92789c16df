"""The sentence on an evaluation: what it says of honest, shared and scattered errors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from planted_offsets import COUNT, flight

from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.tools.evaluate.result import LocatedPoint, ground_errors
from tirgeo_ros.tools.evaluate.verdict import find_systematic, is_honest, verdict


@pytest.mark.parametrize(
    ("cause", "planted"),
    [
        ("boresight", (0.0, 0.0, 0.05)),
        ("boresight", (0.02, -0.03, 0.0)),
        ("latency", (0.15,)),
        ("datum", (1.6, -1.8)),
        ("height", (3.0,)),
        ("height", (-3.0,)),
    ],
)
def test_each_cause_is_found_with_its_size(cause, planted):
    planted_as = planted if len(planted) > 1 else planted[0]
    causes, size = find_systematic(flight(**{cause: planted_as}), COUNT)
    assert causes == [cause]
    # of second order: the planted angles are to 3 deg, the heights 8 % of the camera's
    np.testing.assert_allclose(size, planted, atol=0.1 * np.linalg.norm(planted))


@pytest.mark.parametrize("seed", range(10))
def test_clicks_that_scatter_share_nothing(seed):
    assert find_systematic(flight(seed=seed, scatter_px=8.0), COUNT) is None


def test_what_cannot_be_told_apart_is_not():
    moves = flight(headings=(0,), depressions=(60, 60), scatter_px=15.0, datum=(2.0, 0.0))
    causes, _ = find_systematic(moves, COUNT)
    assert {"datum", "boresight"} <= set(causes)
    moves = [
        one._replace(by={k: v for k, v in one.by.items() if k != "latency"})
        for one in flight(latency=0.15)
    ]
    found = find_systematic(moves, COUNT)  # no rates
    assert found is None or "latency" not in found[0]


def method(moves, *, sigma_m, pictures=COUNT, error_m=3.0):
    """A method's points, each as far off as told, with circles of a sigma."""
    located = [
        LocatedPoint(
            *(f"P{k}", k % pictures, (0.0, 0.0), np.zeros(2), 0.0, np.array([error_m, 0.0])),
            sigma_m**2 * np.eye(2),
            Ellipse(1.0, 1.0, 0.0),
            one,
        )
        for k, one in enumerate(moves)
    ]
    return SimpleNamespace(
        method="ekf", located=located, refused=[], errors=ground_errors(located)
    )


def test_errors_within_their_ellipses_are_told_with_their_mean():
    """Even where all are alike: an ellipse is as wide as what a flight has in common."""
    told = verdict([method(flight(datum=(3.0, 0.0)), sigma_m=2.0)])
    assert told == "24 of 24 lie in their ellipse of 95 %, 3.00 m off on average (ekf)"


@pytest.mark.parametrize(
    ("planted", "words"),
    [
        ({"boresight": (0.0, 0.04, 0.0)}, "turned by 2.3"),
        ({"boresight": (0.0, 0.04, 0.0)}, " deg; run calibrate boresight (ekf)"),
        ({"latency": 0.2}, "pictures were +0."),
        ({"latency": -0.2}, "pictures were -0."),
        ({"datum": (-2.0, 0.0)}, "as if all were -2.0"),
        ({"datum": (2.0, 2.0)}, " m north; are survey and RTK"),
        ({"height": 2.0}, " m too high; look at ground_height_m"),
    ],
)
def test_errors_that_are_alike_say_how_and_what_to_do(planted, words):
    told = verdict([method(flight(**planted), sigma_m=0.1)])
    assert told.startswith("0 of 24 lie in their ellipse of 95 %, 3.00 m off on average: syst")
    assert words in told


def test_errors_that_share_nothing_or_are_too_few():
    told = verdict([method(flight(scatter_px=15.0), sigma_m=0.1)])
    assert "each in a different direction" in told
    told = verdict([method(flight(datum=(3.0, 0.0)), sigma_m=0.1, pictures=2)])
    assert told.endswith("3.00 m off on average: too few pictures to find a common cause (ekf)")
    told = verdict([method(flight(), sigma_m=0.1, error_m=430e3)])
    assert told.startswith("the observed points lie 430 km from where the survey has them")


def test_shares_that_are_chance_with_ellipses_of_95_percent():
    # binomial with 0.95: at most 54 of 60 in 8 of 100 experiments, at most 50 in 1 of 900
    assert is_honest(54 / 60, 60)
    assert not is_honest(50 / 60, 60)
    assert is_honest(50 / 60, 6)  # all of one picture share its pose
