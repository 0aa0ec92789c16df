"""The sentence on an evaluation, and the paired t-test on the paper's own columns."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from dev.reproduction.paper import TABLE_6_AVERAGE_M, TABLE_6_M, TABLE_7
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    matrix_from_rotvec,
    quat_from_matrix,
    rotation_y,
    rotation_z,
)
from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.evaluate.result import LocatedPoint, ground_errors, paired_tests, pixel_moves
from tirgeo_ros.tools.evaluate.verdict import find_systematic, is_honest, verdict

CLICK_PX = 0.5
COUNT = 24
HEIGHT_M = 40.0


def pose(position_n, rotation_nc):
    return CameraPose(0, position_n, quat_from_matrix(rotation_nc), np.eye(6))


def flight(*, seed=3, headings=(0, 90, 180, 270), depressions=(35, 80), scatter_px=0.0, **planted):
    """Moves of observations, one a picture, on legs of several headings with a planted cause.

    ``boresight`` rad about the camera's axes, ``latency`` s, ``datum`` m east and north,
    ``height`` m that the ground is taken too high.
    """
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < COUNT:
        heading = math.radians(headings[len(found) % len(headings)])
        speed_m_s = rng.uniform(2, 10)
        velocity_n = speed_m_s * np.array([math.cos(heading), math.sin(heading), 0])
        rate_n = np.array([0, 0, rng.normal(0, 0.15)])
        position_n = np.array([*rng.normal(0, 20, 2), -HEIGHT_M])
        look = (
            rotation_z(heading)
            @ rotation_y(-math.radians(rng.uniform(*depressions)))
            @ BODY_OPTICAL
        )
        late_s = planted.get("latency", 0.0)
        true = matrix_from_rotvec(-late_s * rate_n) @ look
        true = true @ matrix_from_rotvec(np.array(planted.get("boresight", (0, 0, 0))))
        uv = rng.uniform([40, 40], [600, 472])
        ray_n = true @ XT2.rays(uv[None])[0]
        ground_down_m = planted.get("height", 0.0)  # the true one is lower than it is taken
        camera_n = position_n - late_s * velocity_n
        point_n = camera_n + ray_n * (ground_down_m - camera_n[2]) / ray_n[2]
        east, north = planted.get("datum", (0.0, 0.0))
        surveyed_n = np.array([point_n[0] - north, point_n[1] - east, 0.0])
        seen = uv + rng.normal(0, CLICK_PX + scatter_px, 2)
        rates = CameraRates(velocity_n, rate_n)
        moves = pixel_moves(XT2, pose(position_n, look), rates, tuple(seen), surveyed_n)
        if moves is not None:
            found.append(moves)
    return found


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


def test_the_columns_of_table_6_give_table_7():
    found = {(one.first, one.second): one for one in paired_tests(TABLE_6_M)}
    assert len(found) == 6
    assert round(found["raw", "rtk"].p_value, 4) == TABLE_7["raw", "rtk"] == 0.0008
    proposed = ("ekf", "ekf_heading")
    assert round(found[proposed].p_value, 4) == TABLE_7[proposed] == 0.0005
    for pair in (("rtk", "ekf"), ("rtk", "ekf_heading")):  # printed at the printer's smallest
        assert found[pair].p_value < TABLE_7[pair]
    assert all(one.points == 20 and not one.note for one in found.values())
    for method, column in TABLE_6_M.items():
        # printed to two decimals, of values printed to two decimals
        assert np.mean(list(column.values())) == pytest.approx(TABLE_6_AVERAGE_M[method], abs=0.01)


def test_only_points_that_both_have_are_compared():
    first = {"a": 3.0, "b": 5.0, "c": 4.0, "only here": 900.0}
    second = {"c": 2.5, "b": 2.0, "a": 2.0, "only there": 0.0}
    (found,) = paired_tests({"x": first, "y": second})
    # differences 1, 3, 1.5: mean 11/6, standard deviation of 3; t by hand
    differences = np.array([1.0, 3.0, 1.5])
    t = differences.mean() / (differences.std(ddof=1) / math.sqrt(3))
    assert (found.points, found.note) == (3, "")
    assert found.mean_difference_m == pytest.approx(11 / 6)
    assert found.t == pytest.approx(t, rel=1e-12)
    # two degrees of freedom have a closed form
    assert found.p_value == pytest.approx(1 - t / math.sqrt(2 + t * t), rel=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "points", "mean", "note"),
    [
        ({"a": 1.0}, {"b": 1.0}, 0, None, "fewer than 2 points"),
        ({"a": 3.0, "b": 1.0}, {"a": 1.0}, 1, 2.0, "fewer than 2 points"),
        ({"a": 0.3, "b": 0.1}, {"a": 0.2, "b": 0.0}, 2, 0.1, "all differences are alike"),
    ],
)
def test_what_no_test_can_be_made_of_has_no_p_value(first, second, points, mean, note):
    (found,) = paired_tests({"x": first, "y": second})  # a RuntimeWarning is an error here
    assert (found.points, found.t, found.p_value, found.note) == (points, None, None, note)
    assert found.mean_difference_m == (None if mean is None else pytest.approx(mean))
