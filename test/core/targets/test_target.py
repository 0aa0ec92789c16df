# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The average of clicks: errors over sigmas, errors common to clicks, their correlation time."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from flights import config_for, errors, flight, solutions
from hypothesis import given, strategies as st
from target_samples import COVARIANCE, PLACE, click, east_north_up, target

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.targets.target import (
    COMMON,
    MEMORY_S,
    averaged,
    disagreement,
    known_status,
    near,
)
from tirgeo_ros.core.types.errors import TargetError

CHI2_95 = 5.991464547  # two degrees of freedom
RUNS = 1000

sizes = st.floats(0.0, 100.0)
covariances = st.builds(
    lambda semi, vectors: (
        np.linalg.qr(np.array(vectors).reshape(3, 3) + 2 * np.eye(3))[0]
        @ np.diag(np.square(semi))
        @ np.linalg.qr(np.array(vectors).reshape(3, 3) + 2 * np.eye(3))[0].T
    ),
    st.tuples(sizes, sizes, sizes),
    st.lists(st.floats(-1, 1), min_size=9, max_size=9),
)
offsets = st.floats(-300.0, 300.0)
planes = st.builds(
    lambda latitude, longitude: TangentPlane(
        math.radians(latitude), math.radians(longitude), 80.0
    ),
    st.floats(-90, 90),
    st.floats(-179, 179),
)
clicks = st.builds(
    lambda plane, e, n, u, s, c: click(e, n, u / 10, after_s=s, covariance=c, plane=plane),
    st.just(PLACE),
    *(offsets, offsets, offsets),
    st.floats(0, 2000),
    covariances,
)


def mahalanobis(result, place=(0.0, 0.0, 0.0)):
    """The squared distance from a true place, horizontally, over the covariance."""
    off = (east_north_up(result) - place)[:2]
    return off @ np.linalg.solve(np.reshape(result.covariance_enu, (3, 3))[:2, :2], off)


@given(clicks)
def test_one_click_is_returned_as_it_is(one):
    assert averaged([one]) == one
    assert disagreement([one]) == 0


@given(st.lists(clicks, min_size=2, max_size=4))
def test_the_order_of_the_clicks_does_not_matter(some):
    expected = averaged(some), disagreement(some)
    for order in itertools.permutations(some):
        assert (averaged(order), disagreement(order)) == expected


@given(planes, st.lists(st.tuples(offsets, offsets, covariances), min_size=1, max_size=8))
def test_the_average_is_always_a_place_with_a_covariance(plane, parts):
    some = [click(e, n, covariance=c, plane=plane) for e, n, c in parts]
    result = averaged(some)
    covariance = np.reshape(result.covariance_enu, (3, 3))
    numbers = [result.latitude_deg, result.longitude_deg, result.height_m, *result.covariance_enu]
    assert np.isfinite(numbers).all()
    assert math.isfinite(disagreement(some))
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-9)
    # eigenvalues to the rounding of the largest
    assert np.linalg.eigvalsh(covariance).min() >= -1e-12 * max(1.0, np.abs(covariance).max())
    assert np.isfinite(result.ellipse).all()
    assert np.isfinite(result.outline()).all()


@given(clicks, st.integers(2, 6))
def test_clicks_of_the_same_moment_are_no_better_than_one(one, number):
    result = averaged([one] * number)
    np.testing.assert_allclose(result.covariance_enu, one.covariance_enu, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(east_north_up(result), east_north_up(one), atol=1e-6)


def test_many_clicks_far_apart_in_time_leave_the_common_error():
    def variance(number):
        some = [click(after_s=50 * MEMORY_S * k, covariance=np.eye(3)) for k in range(number)]
        return averaged(some).covariance_enu[0]

    for number in (2, 5, 40):
        assert variance(number) == pytest.approx(COMMON + (1 - COMMON) / number, rel=1e-6)


def test_a_hurried_series_counts_as_one_click():
    """Ten clicks in a second and one from another pass: the mean is between the two."""
    series = [click(0.0, 0.0, after_s=k / 1000, covariance=np.eye(3)) for k in range(10)]
    other = click(1.0, 0.0, after_s=500, covariance=np.eye(3))
    assert east_north_up(averaged([*series, other]))[0] == pytest.approx(0.5, abs=1e-3)


def test_errors_over_sigma_of_clicks_with_the_assumed_common_error():
    """Clicks from several sides, of unlike quality: the error is as the covariance says."""
    rng = np.random.default_rng(4)
    axes = [turned(COVARIANCE * scale, angle) for scale, angle in ((1, 0), (4, 70), (2, 160))]
    times_s = np.array([0.0, 4.0, 300.0])
    shares = COMMON + (1 - COMMON) * np.exp(-abs(times_s[:, None] - times_s) / MEMORY_S)
    roots = np.array([root(one) for one in axes])
    mix = np.linalg.cholesky(shares)
    squares = []
    for _ in range(RUNS):
        errors = np.einsum("nij,nj->ni", roots, mix @ rng.standard_normal((3, 3)))
        some = [
            click(*error, after_s=t, covariance=c)
            for error, t, c in zip(errors, times_s, axes, strict=True)
        ]
        squares.append(mahalanobis(averaged(some)))
    # a chi-square of two degrees of freedom has the mean 2 and the standard deviation 2
    assert np.mean(squares) == pytest.approx(2, abs=4 * 2 / math.sqrt(RUNS))
    inside = np.mean(np.array(squares) < CHI2_95)
    assert inside == pytest.approx(0.95, abs=4 * math.sqrt(0.05 * 0.95 / RUNS))


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_clicks_that_share_less_stay_within_the_ellipse(share):
    """If the common error is smaller than assumed, 95 % or more are inside."""
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(RUNS):
        common = math.sqrt(share) * rng.standard_normal(3)
        own = math.sqrt(1 - share) * rng.standard_normal((4, 3))
        some = [
            click(*(root(COVARIANCE) @ (common + one)), after_s=100.0 * k)
            for k, one in enumerate(own)
        ]
        inside += mahalanobis(averaged(some)) < CHI2_95
    assert inside / RUNS >= 0.95 - 4 * math.sqrt(0.05 * 0.95 / RUNS)


@pytest.mark.parametrize("number", [2, 3, 8])
def test_clicks_of_one_place_rarely_disagree(number):
    """Independent errors: one in a thousand by the limit, 1 % of which is the approximation."""
    rng = np.random.default_rng(6)
    ratios = [
        disagreement(
            [
                click(*(root(COVARIANCE) @ rng.standard_normal(3)), after_s=200.0 * k)
                for k in range(number)
            ]
        )
        for _ in range(RUNS)
    ]
    # of 1000 runs one on average; more than eight happen once in 10^6 times
    assert np.sum(np.array(ratios) > 1) <= 8


def test_clicks_of_two_places_disagree_and_the_ellipse_holds_both():
    near = averaged([click(0, 0), click(0, 1, after_s=100)])
    some = [click(0, 0), click(0, 20, after_s=100)]
    result = averaged(some)
    assert disagreement(some) > 1
    assert result.ellipse.major_m > 2 * near.ellipse.major_m
    for one in some:
        assert mahalanobis(result, east_north_up(one)) < CHI2_95
    assert not target(1, *some).clicks_agree
    assert target(1, some[0]).clicks_agree


def test_a_poor_click_hardly_moves_a_good_one():
    good, poor = click(covariance=np.eye(3)), click(30, after_s=99, covariance=900 * np.eye(3))
    assert abs(east_north_up(averaged([good, poor]))[0]) < 0.05
    assert averaged([good, poor]).covariance_enu[0] < 1.15


def test_the_outline_is_the_ellipse():
    """Closed, anticlockwise on a map, its longest towards 30 deg."""
    ring = click().outline()
    assert ring[0] == ring[-1]
    lat, lon = np.radians(ring).T
    corners_n = PLACE.ned_from_geodetic(lat, lon, 11.5)[:-1, :2]
    inverse = np.linalg.inv(click().covariance_n[:2, :2])
    squares = np.einsum("ni,ij,nj->n", corners_n, inverse, corners_n)
    # nine decimals of a degree are 0.1 mm, of 1.2 m at the least
    np.testing.assert_allclose(squares, CHI2_95, rtol=5e-4)
    north, east = corners_n[np.argmax(np.hypot(*corners_n.T))]
    assert math.degrees(math.atan2(east, north)) % 180 == pytest.approx(30, abs=0.1)
    area = np.sum(
        corners_n[:, 1] * np.roll(corners_n[:, 0], -1)
        - corners_n[:, 0] * np.roll(corners_n[:, 1], -1)
    )
    assert area > 0


@pytest.mark.parametrize(
    "changed",
    [
        {"latitude_deg": math.nan},
        {"latitude_deg": 91.0},
        {"longitude_deg": math.inf},
        {"height_m": math.nan},
        {"stamp_ns": 1 << 63},
        {"covariance_enu": (1.0,) * 8},
        {"covariance_enu": (math.nan,) * 9},
        {"covariance_enu": (1.0, 0, 0, 0, -1.0, 0, 0, 0, 1.0)},
        {"covariance_enu": (1e9, 0, 0, 0, 1.0, 0, 0, 0, 1.0)},
    ],
)
def test_an_impossible_point_is_refused(changed):
    with pytest.raises(TargetError, match="not a located point"):
        target(1, click(), dataclasses.replace(click(), **changed))


def turned(covariance, angle_deg):
    """A covariance turned about the vertical."""
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
    return turn @ covariance @ turn.T


def root(covariance):
    """The symmetric root."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T


STEP_S = 1.0
RAYS_N = np.array([[60.0, 0, 60.0], [0, 60.0, 60.0]])  # 45 deg down, from 60 m up


def ground_errors(seed):
    """The errors (4, N) of two ground points, north and east, each second of a flight."""
    flown = flight(seed, 200.0)
    result = errors(flown, solutions(flown, config_for(flown))).after(40.0)
    times_s = np.arange(41.0, 198.0, STEP_S)
    rows = []
    for ray_n in RAYS_N:
        ends_n = result.state[:, :3] - np.cross(result.state[:, 3:6], ray_n)
        on_ground_n = ends_n - ends_n[:, 2:] / ray_n[2] * ray_n
        rows += [np.interp(times_s, result.t_s, on_ground_n[:, axis]) for axis in (0, 1)]
    return np.array(rows)


@pytest.mark.slow
def test_the_filter_s_error_on_the_ground_lasts_no_longer_than_assumed():
    every = np.array([ground_errors(seed) for seed in (1, 2, 3, 4)])

    def correlation(lag_s):
        lag = round(lag_s / STEP_S)
        both = every[..., : every.shape[-1] - lag] * every[..., lag:]
        return float((both.mean((0, 2)) / np.square(every).mean((0, 2))).mean())

    result = {lag_s: correlation(lag_s) for lag_s in (8, 15, 30, 60)}
    # four flights of 160 s hold some 20 spans of half a minute: a correlation is known to 0.2
    for lag_s, share in result.items():
        assert share <= COMMON + (1 - COMMON) * np.exp(-lag_s / MEMORY_S), result
    assert result[8] > 0.4, result  # clicks in a row are not independent


def test_near_is_what_both_covariances_allow_and_the_nearest_comes_first():
    """The sum of both covariances is 8 m2 towards 30 deg, 0.5 m2 across; up does not count."""
    turn, limit = math.radians(30), math.sqrt(-2 * math.log(0.01))  # chi-square, 2 degrees, 99 %
    along = np.array([math.sin(turn), math.cos(turn)]) * math.sqrt(8) * limit
    across = np.array([math.cos(turn), -math.sin(turn)]) * math.sqrt(0.5) * limit
    places = [0.99 * along, 1.01 * along, 0.99 * across, 1.01 * across, [0.1, 0.0]]
    targets = [target(k, click(*place, 50.0)) for k, place in enumerate(places, 1)]
    assert [each.number for each in near(click(), targets)] == [5, 3, 1]
    assert near(click(), []) == []


@pytest.mark.parametrize(
    ("text", "status"), [("found", "found"), (None, "new"), ("Cow", "new"), (3, "new")]
)
def test_a_status_that_is_not_known_is_new(text, status):
    assert known_status(text) == status
