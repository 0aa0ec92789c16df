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
"""Poses between tied pictures, and how far the rays of other ties are apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import PLANE, graticule
from tied_flights import GROUND_M, PLANTED, Course, error_of, fitted, slopes_of, tied_truth

from tirgeo_ros.core.adjustment.adjustment import (
    Adjustment,
    disagreement,
    known_downs,
    shift_sigmas,
)
from tirgeo_ros.core.adjustment.tie_fit import PRIOR_SIGMA
from tirgeo_ros.core.adjustment.tied_views import PARAMETERS
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ties.tracks import TiedPair

NONE = np.zeros(8)
COURSE = Course(leg_m=60, strips=4, spacing_m=12, picture_s=1.0)


def every_second(truth):
    """Leave out the ties of every second picture."""
    tracks = truth.tracks
    kept = np.isin(tracks.stamps_ns, [tied.view.stamp_ns for tied in truth.views[::2]])
    own = kept[tracks.picture]
    own &= np.bincount(tracks.point, weights=own)[tracks.point] > 1
    point = np.unique(tracks.point[own], return_inverse=True)[1]
    picture = (np.cumsum(kept) - 1)[tracks.picture[own]]
    thinned = tracks._replace(
        stamps_ns=tracks.stamps_ns[kept], picture=picture, point=point, uv=tracks.uv[own]
    )
    return truth._replace(tracks=thinned)


def between(truth, adjustment):
    """Return errors over sigma (P, 6) of the pictures without ties, and errors before, after."""
    poses = [tied.view.pose for tied in truth.views[1:-1:2]]
    true = truth.true_poses[1:-1:2]
    before = np.array([error_of(pose, t) for pose, t in zip(poses, true, strict=True)])
    corrected = [adjustment.corrected(pose) for pose in poses]
    after = np.array([error_of(pose, t) for pose, t in zip(corrected, true, strict=True)])
    sigma = np.sqrt([np.diag(pose.covariance) for pose in corrected])
    return after / sigma, before, after


def test_poses_between_pictures_become_better_and_stay_honest():
    truth = every_second(tied_truth((COURSE,), NONE, attitude_deg=0.5, points=800))
    shares, before, after = between(truth, Adjustment(fitted(truth, NONE, again=False)))
    rms = [np.sqrt((each[:, 3:] ** 2).mean()) for each in (before, after)]
    # With a = exp(-1 s / 5 s), known 1 s before and after: sqrt((1 - a^2) / (1 + a^2)) = 0.44.
    assert rms[1] < 0.6 * rms[0]
    assert 0.75 < np.sqrt((shares**2).mean()) < 1.3


def test_the_parameters_corrections_are_applied_where_slopes_are_given():
    truth = every_second(tied_truth((COURSE,), points=800, attitude_deg=0.1))
    fit = fitted(truth, np.where(np.arange(8) == 3, 0.0, PRIOR_SIGMA), again=False)
    flown = {t.view.pose.stamp_ns: f for t, f in zip(truth.views, truth.flown, strict=True)}

    def mounted(pose):
        time_s, course, _ = flown[pose.stamp_ns]
        return pose, slopes_of(course, time_s, pose, NONE)

    shares, before, after = between(truth, Adjustment(fit, mounted))
    assert np.degrees(np.abs(before[:, 3:]).max()) > 1.5
    assert np.degrees(np.sqrt((after[:, 3:] ** 2).mean())) < 0.15
    assert 0.5 < np.sqrt((shares**2).mean()) < 1.5


def test_at_a_picture_it_is_the_fit_and_far_off_the_pose_itself():
    truth = tied_truth((COURSE._replace(picture_s=2.0),), NONE, attitude_deg=0.3, points=400)
    fit = fitted(truth, NONE, again=False)
    adjustment = Adjustment(fit)
    for tied in (truth.views[0], truth.views[7], truth.views[-1]):
        mine, theirs = adjustment.corrected(tied.view.pose), fit.views[tied.view.stamp_ns].pose
        assert np.allclose(mine.position_n, theirs.position_n, atol=1e-4)
        assert np.abs(error_of(mine, theirs)).max() < 1e-4
        assert np.allclose(mine.covariance, theirs.covariance, rtol=0.02, atol=1e-8)
    pose = truth.views[0].view.pose
    late = dataclasses.replace(pose, stamp_ns=pose.stamp_ns + 10**13)
    assert np.abs(error_of(adjustment.corrected(late), late)).max() < 1e-9
    scale = np.repeat([1.0, fit.noise.attitude_factor], 3)
    expected = late.covariance * np.outer(scale, scale)
    assert np.allclose(adjustment.corrected(late).covariance, expected, rtol=1e-3, atol=1e-9)


def pairs_of(truth, most=12):
    """Return pairs of pictures with many common points."""
    tracks, pairs = truth.tracks, []
    for first in range(len(tracks.stamps_ns)):
        for second in range(first + 1, len(tracks.stamps_ns)):
            own, other = (tracks.picture == k for k in (first, second))
            _, a, b = np.intersect1d(tracks.point[own], tracks.point[other], return_indices=True)
            if len(a) > 5 and len(pairs) < most:
                stamps = tracks.stamps_ns[[first, second]].tolist()
                pairs.append(TiedPair(*stamps, tracks.uv[own][a], tracks.uv[other][b]))
    return pairs


@pytest.fixture(scope="module")
def planted_flight():
    truth = tied_truth((Course(leg_m=40, strips=4, spacing_m=12),), points=500)
    return truth, fitted(truth, np.where(np.arange(8) == 3, 0.0, PRIOR_SIGMA))


def test_pictures_disagree_less_after_the_fit(planted_flight):
    truth, fit = planted_flight
    views, pairs = {tied.view.stamp_ns: tied.view for tied in truth.views}, pairs_of(truth)
    ground = GROUND_M + fit.correction[-1]
    before = disagreement(views, pairs, PLANE, ground)
    on_plane = disagreement(fit.views, pairs, PLANE, ground)
    at_heights = disagreement(fit.views, pairs, PLANE, ground, known_downs(fit))
    assert len(before) == sum(len(pair.first_uv) for pair in pairs)
    medians = [float(np.median(each)) for each in (before, on_plane, at_heights)]
    assert medians[0] > 2 * medians[1] > 4 * medians[2]
    # Half a pixel at 40 m and 824 px is 2.4 cm, twice, in two directions.
    assert medians[2] < 0.06


def test_a_ray_without_ground_gives_no_distance(planted_flight):
    truth, _ = planted_flight
    views = {tied.view.stamp_ns: tied.view for tied in truth.views}
    assert np.isnan(disagreement(views, pairs_of(truth, 1), PLANE, GROUND_M + 500)).all()
    assert disagreement(views, [], PLANE, GROUND_M).shape == (0,)


def test_an_elevation_model_is_the_ground_too(planted_flight):
    truth, fit = planted_flight
    degrees = np.degrees([PLANE.latitude_rad, PLANE.longitude_rad])
    level = Terrain(np.full((5, 5), GROUND_M), graticule(tuple(degrees - 0.02), (0.01, 0.01), 5))
    over_terrain = fitted(truth, np.where(np.arange(8) == 3, 0.0, PRIOR_SIGMA), ground_m=level)
    assert np.allclose(over_terrain.correction, fit.correction, atol=1e-3)
    assert fit.correction[:3] == pytest.approx(PLANTED[:3], abs=4 * fit.sigma[:3].max())


def median_shift(planted, raised_m=0.0, sigma_m=0.1, attitude_deg=0.15):
    """Return the median shift, in sigmas, of pairs of opposite headings."""
    truth = tied_truth((COURSE,), np.array(planted), seed=3, attitude_deg=attitude_deg)
    views, shifts = {tied.view.stamp_ns: tied.view for tied in truth.views}, []
    for pair in pairs_of(truth, 10_000):
        both = views[pair.first_ns], views[pair.second_ns]
        if both[0].pose.q_nc @ both[1].pose.q_nc < 0.1:
            given = PLANE, GROUND_M + raised_m, sigma_m
            shifts.append(shift_sigmas(both, pair, *given))
    assert len(shifts) > 20
    return float(np.median(shifts))


def off(**planted_deg):
    return [np.radians(planted_deg.get(name, 0.0)) for name in PARAMETERS]


def test_what_covariances_explain_is_no_disagreement():
    # The median of two normal errors in the worst case is 1.18; attitudes of one flight are few
    # draws, so leave half as much again.
    assert median_shift(off()) < 1.8
    assert median_shift(off(), attitude_deg=1.5) < 1.8
    assert median_shift(off(), raised_m=5.0, sigma_m=5.0) < 1.8


@pytest.mark.parametrize("name", ["pitch", "yaw", "gimbal_north"])
def test_a_wrong_mounting_is_more_than_covariances_explain(name):
    size_deg = 5.0 if name == "gimbal_north" else 2.0
    assert median_shift(off(**{name: size_deg})) > 3.0


def test_rays_without_ground_have_no_shift(planted_flight):
    truth, _ = planted_flight
    views, pair = {tied.view.stamp_ns: tied.view for tied in truth.views}, pairs_of(truth, 1)[0]
    both = views[pair.first_ns], views[pair.second_ns]
    assert np.isnan(shift_sigmas(both, pair, PLANE, GROUND_M + 500, 0.1))
