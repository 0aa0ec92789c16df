"""The sentence on an evaluation: what it says of honest, shared and scattered errors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from planted_offsets import COUNT, flight

from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.tools.evaluate.result import LocatedPoint, ground_errors
from tirgeo_ros.tools.evaluate.verdict import is_honest, verdict


def method(moves, *, sigma_m, pictures=COUNT, error_m=3.0):
    """A method's points, each as far off as told, with circles of a sigma."""
    located = [
        LocatedPoint(
            *(f"P{k}", k % pictures, (0.0, 0.0), 0.0, 0.0, 0.0),
            np.array([error_m, 0.0]),
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
    assert told == "24 of 24 lie in their ellipse of 95 %, 3.0 m off on average (ekf)"


@pytest.mark.parametrize(
    ("planted", "words"),
    [
        ({"boresight": (0.0, 0.04, 0.0)}, r"fixed in the picture ("),
        ({"boresight": (0.0, 0.04, 0.0)}, "systematic; run calibrate boresight (ekf)"),
        ({"latency": 0.2}, "as if video_latency_s were 0."),
        ({"latency": 0.2}, " s too small: systematic; run calibrate boresight"),
        ({"latency": -0.2}, " s too large: systematic"),
        ({"datum": (2.0, 2.0)}, "to the north-east: systematic; are the survey and"),
        ({"datum": (-2.0, 0.0)}, "m to the west: systematic"),
        ({"datum": (0.0, -2.0)}, "m to the south: systematic"),
        ({"height": 2.0}, "as if the ground were "),
        ({"height": 2.0}, " m too high: systematic; look at ground_height_m"),
    ],
)
def test_errors_that_are_alike_say_how_and_what_to_do(planted, words):
    told = verdict([method(flight(**planted), sigma_m=0.1)])
    assert told.startswith("0 of 24 lie in their ellipse of 95 %, ")
    assert words in told


def test_errors_of_all_directions_are_the_sensors():
    told = verdict([method(flight(scatter_px=15.0), sigma_m=0.1)])
    assert "each in another direction" in told
    assert "systematic" not in told


def test_two_pictures_are_too_few():
    told = verdict([method(flight(datum=(3.0, 0.0)), sigma_m=0.1, pictures=2)])
    assert told.endswith("3.0 m off on average: too few pictures to tell what they share (ekf)")


def test_a_survey_of_another_place_is_told_before_all_else():
    told = verdict([method(flight(), sigma_m=0.1, error_m=430e3)])
    assert told.startswith("the observed points lie 430 km from where the survey has them")


def test_shares_that_are_chance_with_ellipses_of_95_percent():
    # binomial with 0.95: at most 54 of 60 in 8 of 100 experiments, at most 50 in 1 of 900
    assert is_honest(57 / 60, 60)
    assert is_honest(54 / 60, 60)
    assert not is_honest(50 / 60, 60)
    assert not is_honest(0 / 60, 60)
    assert is_honest(50 / 60, 6)  # all of one picture share its pose
    assert is_honest(1.0, 1)
