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
"""What a fit to ties finds of planted errors, how honest it is, and what it cannot tell."""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest
from scenes import PLANE
from tied_flights import (
    GROUND_M,
    PLANTED,
    Course,
    clicked,
    error_of,
    fitted,
    pose_errors,
    tied_truth,
)

from tirgeo_ros.core.adjustment.solver import AdjustmentConfig
from tirgeo_ros.core.adjustment.tie_fit import PRIOR_SIGMA, fit_ties
from tirgeo_ros.core.adjustment.tied_views import PARAMETERS
from tirgeo_ros.core.types.errors import CalibrationError

NONE = np.zeros(8)
NORTH_KNOWN = np.where(np.array(PARAMETERS) == "gimbal_north", 0.0, PRIOR_SIGMA)
SMALL = Course(leg_m=40, strips=4, spacing_m=12)
HIGH = Course(leg_m=80, strips=2, spacing_m=25, height_m=75)
FOCAL, LATENCY = PARAMETERS.index("focal"), PARAMETERS.index("latency")


def over_sigma(fit, planted=PLANTED):
    free = fit.sigma > 0
    return (planted - fit.correction)[free] / fit.sigma[free]


def test_mounting_latency_and_focal_length_are_found_without_a_surveyed_point():
    fit = fitted(tied_truth((SMALL, HIGH), points=500), NORTH_KNOWN)
    assert not fit.undetermined
    assert np.abs(over_sigma(fit)).max() < 3.5  # eight of a normal distribution: 0.4 %
    assert abs(fit.correction - PLANTED)[FOCAL] < 0.003
    assert abs(fit.correction - PLANTED)[LATENCY] < 0.005
    assert fit.correction[3] == fit.sigma[3] == 0.0
    assert fit.noise.pixel_sigma == pytest.approx(0.5, rel=0.1)
    assert fit.used.mean() > 0.99


def test_wrong_ties_do_not_matter():
    clean, spoilt = (
        fitted(tied_truth((SMALL,), points=500, wrong=wrong), NORTH_KNOWN) for wrong in (0.0, 0.2)
    )
    apart = (spoilt.correction - clean.correction)[NORTH_KNOWN > 0]
    assert (np.abs(apart) < clean.sigma[NORTH_KNOWN > 0]).all()
    assert 0.85 < spoilt.used.mean() < 0.97  # one in five places has a wrong sighting, of four
    assert spoilt.noise.pixel_sigma == pytest.approx(0.5, rel=0.1)


def test_a_short_correlation_time_is_taken_as_5_s_which_makes_no_sigma_too_small():
    truth = tied_truth((Course(),), NONE, points=600, attitude_deg=0.2, tau_s=2.0)
    fit = fitted(truth, NONE, again=False)
    assert fit.noise.taus_s[3] == 5.0
    assert 1.0 < fit.noise.attitude_factor < 2.0


@pytest.mark.parametrize(("actual", "reported", "tau_s"), [(0.4, 0.2, 15.0), (0.2, 0.5, 10.0)])
def test_the_attitudes_noise_is_estimated(actual, reported, tau_s):
    truth = tied_truth(
        (Course(),), NONE, points=600, attitude_deg=actual, reported_deg=reported, tau_s=tau_s
    )
    fit = fitted(truth, NONE, again=False)
    assert fit.noise.attitude_factor == pytest.approx(actual / reported, rel=0.25)
    assert fit.noise.taus_s[3] == pytest.approx(tau_s, rel=0.6)
    errors, covariances = pose_errors(fit, truth)
    before = [error_of(v.view.pose, p) for v, p in zip(truth.views, truth.true_poses, strict=True)]
    after = np.sqrt((errors**2).mean(0))[3:]
    assert (after < 0.4 * np.sqrt(np.square(before).mean(0))[3:]).all()
    whole = np.einsum("pi,pij,pj->p", errors, np.linalg.inv(covariances), errors)
    assert 0.6 < np.sqrt(whole.mean() / 6) < 1.5


def test_a_single_strip_names_what_it_cannot_tell():
    fit = fitted(tied_truth((Course(strips=1),), points=400), PRIOR_SIGMA, again=False)
    assert {"focal", "latency", "yaw"} <= fit.undetermined.keys()
    assert "without turns" in fit.undetermined["latency"]
    assert "one heading" in fit.undetermined["yaw"]
    held = [PARAMETERS.index(name) for name in fit.undetermined]
    assert (fit.correction[held] == 0).all()
    assert fit.sigma[held] == pytest.approx(PRIOR_SIGMA[held])
    assert np.abs(over_sigma(fit)).max() < 3.5


def test_straight_down_the_mounting_and_the_gimbals_north_are_one():
    planted = PLANTED * 0
    planted[3] = np.radians(3.0)
    fit = fitted(tied_truth((SMALL,), planted, points=500), PRIOR_SIGMA, again=False)
    assert "gimbal's north are one" in fit.undetermined["roll"]
    assert np.abs(over_sigma(fit, planted)).max() < 3.5
    # What is determined is corrected: the poses are right although the two are not told apart.
    assert fit.correction[3] == pytest.approx(np.radians(3.0), abs=np.radians(0.3))


@pytest.mark.parametrize(
    ("height_sigma_m", "relief", "told"),
    [(10.0, 0.13, False), (0.2, 0.13, False), (0.2, 0.007, True)],
)
def test_from_one_height_the_focal_length_wants_the_height_of_the_ground(
    height_sigma_m, relief, told
):
    sigma = NORTH_KNOWN.copy()
    sigma[-1] = height_sigma_m
    planted = PLANTED * [0, 0, 0, 0, 1, 0, 0, 0]
    course = HIGH._replace(leg_m=150)
    truth = tied_truth((course,), planted, points=500)
    fit = fitted(truth, sigma, again=False, config=AdjustmentConfig(relief=relief))
    assert ("focal" in fit.undetermined) is not told
    assert np.abs(over_sigma(fit, planted)).max() < 3.5
    if told:
        assert fit.sigma[FOCAL] < 0.01
    else:
        assert "ground are one" in fit.undetermined["focal"]


def test_surveyed_points_give_scale_and_heading_that_ties_lack():
    """One strip straight down, without RTK: ties alone leave focal length and yaw."""
    planted = PLANTED * [0, 0, 1, 0, 1, 0, 0, 0]
    course = Course(leg_m=600, strips=1, height_m=60, picture_s=3.0)
    truth, clicks = clicked(tied_truth((course,), planted, points=600, position_m=0.5), 20)
    alone, both = (fitted(truth, NORTH_KNOWN, again=False, clicks=own) for own in ([], clicks))
    assert {"focal", "yaw"} <= alone.undetermined.keys() - both.undetermined.keys()
    assert np.abs(over_sigma(both, planted)).max() < 3.5
    assert both.sigma[FOCAL] < 0.01
    assert both.used[both.flight.clicks].mean() > 0.95
    assert both.noise.pixel_sigma == pytest.approx(alone.noise.pixel_sigma, rel=0.05)


def test_wrong_clicks_are_left_out_and_do_not_matter():
    truth, clicks = clicked(tied_truth((SMALL,), points=500), 10)
    wrong = [dataclasses.replace(click, uv=click.uv + 30) for click in clicks[::5]]
    right = [click for k, click in enumerate(clicks) if k % 5]
    clean = fitted(truth, NORTH_KNOWN, again=False, clicks=right)
    spoilt = fitted(truth, NORTH_KNOWN, again=False, clicks=wrong + right)
    assert (np.abs(spoilt.correction - clean.correction) <= clean.sigma).all()
    assert spoilt.used[spoilt.flight.clicks].tolist() == [False] * len(wrong) + [True] * len(right)


@pytest.mark.parametrize(
    ("shift_n", "message"), [([3, 0, 0], "^0 of 39 obs"), ([0, 0, 9], r"at 1\.26 of the focal")]
)
def test_a_wrong_survey_is_refused(shift_n, message):
    """9 m of 40 m, and the planted 3 %, look like 1.03 * 49 / 40 of the focal length."""
    truth, clicks = clicked(tied_truth((SMALL,), points=500), 10)
    wrong = [dataclasses.replace(click, point_n=click.point_n + shift_n) for click in clicks]
    with pytest.raises(CalibrationError, match=message):
        fitted(truth, NORTH_KNOWN, again=False, clicks=wrong)


def test_a_click_adds_a_picture_that_has_no_ties():
    truth, clicks = clicked(tied_truth((SMALL,), points=500), 10)
    bare = truth.views[-1].view  # after the last picture with ties
    at_ns = bare.stamp_ns + 10**9
    view = bare._replace(stamp_ns=at_ns, pose=dataclasses.replace(bare.pose, stamp_ns=at_ns))
    click = dataclasses.replace(clicks[-1], stamp_ns=at_ns)
    truth.views.append(truth.views[-1]._replace(view=view))
    fit = fitted(truth, NORTH_KNOWN, again=False, clicks=[*clicks, click])
    assert fit.views.keys() == {tied.view.stamp_ns for tied in truth.views}


@pytest.mark.slow
@pytest.mark.parametrize("course", [Course(), Course(pitch_deg=-60.0)], ids=["down", "oblique"])
def test_ten_flights_are_calibrated_and_honest(course):
    errors, shares, squares = [], [], []
    for seed in range(10, 20):
        truth = tied_truth((course,), seed=seed, points=1000, attitude_deg=0.1)
        fit = fitted(truth, NORTH_KNOWN)
        errors.append(fit.correction - PLANTED)
        shares.append(over_sigma(fit))
        off, covariances = pose_errors(fit, truth)
        squares.append(off**2 / np.einsum("pii->pi", covariances))
    angles = np.degrees(np.array(errors)[:, :3])
    assert np.sqrt((angles**2).mean()) < 0.05
    assert np.abs(angles).max() < 0.12
    assert np.abs(np.array(errors)[:, LATENCY]).max() < 0.005
    if course.pitch_deg > -90:
        assert np.abs(np.array(errors)[:, FOCAL]).max() < 0.003
    shares = np.array(shares)
    assert 0.8 < np.sqrt((shares**2).mean()) < 1.25
    assert (np.abs(shares) < 2).mean() > 0.9  # 95 %, of 70
    assert np.abs(shares).max() < 4
    assert 0.8 < np.sqrt(np.mean(squares)) < 1.25


@pytest.mark.slow
def test_200_pictures_take_no_more_than_40_s_of_one_core():
    import time  # noqa: PLC0415

    truth = tied_truth((Course(strips=16),), points=26000, wrong=0.1, most_sightings=4)
    start = time.process_time()
    fitted(truth, PRIOR_SIGMA, again=False)
    assert time.process_time() - start < 40


def test_what_is_too_thin_is_refused():
    truth = tied_truth((SMALL,), points=30)
    tracks = truth.tracks
    few = tracks.point < 5
    thin = tracks._replace(picture=tracks.picture[few], point=tracks.point[few], uv=tracks.uv[few])
    with pytest.raises(CalibrationError, match=r"5 tied places .* fly strips"):
        fitted(truth._replace(tracks=thin), PRIOR_SIGMA, again=False)


@pytest.mark.parametrize("seed", range(3))
def test_ties_that_do_not_agree_are_refused(seed):
    truth = tied_truth((SMALL,), points=300)
    uv = np.random.default_rng(seed).uniform(0, 500, truth.tracks.uv.shape)
    with pytest.raises(CalibrationError, match=r"ties (agree|scatter|lead)|converge"):
        fitted(truth._replace(tracks=truth.tracks._replace(uv=uv)), PRIOR_SIGMA, again=False)


@pytest.mark.parametrize("mounting", [NONE, PRIOR_SIGMA], ids=["held", "free"])
@pytest.mark.parametrize(("speed_mps", "moving"), [(0.05, 1.0), (0.3, 0.4)])
def test_what_moves_alike_is_refused(speed_mps, moving, mounting):
    """A herd that creeps, and land beside drifting waves: the poses would follow both."""
    velocity_n = (0.6 * speed_mps, 0.8 * speed_mps, 0.0)
    truth = tied_truth((SMALL, HIGH), NONE, points=500, velocity_n=velocity_n, moving=moving)
    with pytest.raises(CalibrationError, match=r"places move alike, by .* fly over ground"):
        fitted(truth, mounting, again=False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_what_moves_alike_makes_no_wrong_result(seed):
    """All 20 flights over still ground are taken; over moving ground the fit is right or none.

    What moves fast beside a larger still part is left out as wrong ties are.
    """
    rng = np.random.default_rng(seed)
    angle, speed_mps = rng.uniform(0, 2 * np.pi), 10 ** rng.uniform(-1.3, 0.3)
    velocity_n = speed_mps * np.array([np.cos(angle), np.sin(angle), 0.0])
    given = {"planted": PLANTED * rng.normal(size=8), "points": 500, "attitude_deg": 0.3}
    fitted(tied_truth((SMALL, HIGH), seed=seed, **given), NORTH_KNOWN, again=False)
    given |= {"velocity_n": velocity_n, "moving": rng.uniform(0.3, 1.0)}
    with contextlib.suppress(CalibrationError):
        fit = fitted(tied_truth((SMALL, HIGH), seed=seed, **given), NORTH_KNOWN, again=False)
        assert np.abs(over_sigma(fit, given["planted"])).max() < 4.5


def test_ties_above_the_horizon_are_left_out():
    truth = tied_truth((SMALL._replace(pitch_deg=-15.0),), points=2000)
    uv, above = truth.tracks.uv.copy(), truth.tracks.point % 10 == 0
    uv[above, 1] = -5.0
    fit = fitted(truth._replace(tracks=truth.tracks._replace(uv=uv)), NORTH_KNOWN, again=False)
    assert not fit.used[above].any()
    assert fit.used[~above].mean() > 0.98
    assert np.abs(over_sigma(fit)).max() < 3.5


def test_an_impossible_covariance_is_refused():
    truth = tied_truth((SMALL,), points=300)
    (view, _), *others = truth.views
    pose = view.pose.__class__(view.stamp_ns, view.pose.position_n, view.pose.q_nc, -np.eye(6))
    views = [truth.views[0]._replace(view=view._replace(pose=pose)), *others]
    with pytest.raises(CalibrationError, match="impossible covariance"):
        fit_ties(views, truth.tracks, PLANE, GROUND_M)
