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
"""Fit parameters, poses and points to the ties of a flight's pictures, with their priors.

A parameter that this flight cannot tell is held at its prior. Its uncertainty stays in all
covariances (Schmidt's consider parameters: Groves, section 3.4).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.adjustment.normal_equations import Noise
from tirgeo_ros.core.adjustment.solver import AdjustmentConfig, Solver
from tirgeo_ros.core.adjustment.tied_views import FOCAL, GROUND, PARAMETERS, TiedFlight, TiedView
from tirgeo_ros.core.calibration.boresight_fit import LEAST_SHARE
from tirgeo_ros.core.calibration.boresight_model import PointSighting
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ties.tracks import Tracks
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError

#: What is usually known of PARAMETERS before a flight.
PRIOR_SIGMA = np.array([*np.radians([1.5, 1.5, 2.0, 5.0]), 0.03, 0.05, 0.1, 10.0])
#: With less, wrong ties cannot be told from right ones.
LEAST_POINTS, LEAST_PICTURES = 20, 3
#: A parameter is not determined if its sigma stays above this share of its prior sigma, or above
#: the second share if it is as good as one with another parameter (by their correlation).
MOST_SHARE, _MOST_SHARE_OF_ONE, _ONE = 0.7, 0.3, 0.98
_MOST_FOCAL = 3.0  # prior sigmas by which surveyed points may change the focal length
_PARTNER = 0.8  # correlation from which on another parameter is named as the reason
_ALIKE = (
    "it moves pictures of one heading alike, and those of others as their positions' errors do; "
    "fly opposite and crossing strips that overlap by half, with RTK"
)
#: Parameter, or two that are one -> why it cannot be told, and what to fly.
_REASONS = {
    frozenset(("roll", "gimbal_north")): (
        "looking straight down, the yaw of the mounting (its roll, about the optical axis) and "
        "the gimbal's north are one; tilt the camera in a part of the flight"
    ),
    "roll": _ALIKE,
    "pitch": _ALIKE,
    "yaw": _ALIKE,
    "gimbal_north": _ALIKE,
    "focal": (
        "from one height straight down, the focal length and the height of the ground are one; "
        "fly at two heights or tilted, or give the height by an elevation model or a laser"
    ),
    "k1": "the ties don't reach the pictures' corners, or are too few; fly more overlap",
    "latency": (
        "the camera moved alike in all pictures, without turns (and a delay of the gimbal's "
        "stamps acts as the video's latency); take pictures in turns"
    ),
}


@dataclasses.dataclass(frozen=True, eq=False)
class TieFit:
    """Hold what N sightings of M points in P pictures say.

    ``undetermined`` tells why a parameter was held although its prior sigma is not zero, by name;
    its variance is then the prior one.
    """

    flight: TiedFlight
    correction: Array  # (8,) of PARAMETERS: rad, share, 1, s, m; 0 if held
    covariance: Array  # (8, 8)
    undetermined: dict[str, str]
    z: Array  # (P, 6) whitened pose corrections
    joint_covariance: Array  # (8 + 6P, 8 + 6P) of corrections over prior sigmas, and z
    points_n: Array  # (M, 3) m
    residuals: Array  # (N, 2) px; nan if not in view
    used: BoolArray  # (N,)
    noise: Noise

    @property
    def sigma(self) -> Array:
        """Return the sigmas (8,) of the corrections."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @functools.cached_property
    def views(self) -> dict[int, View]:
        """Return each picture with corrected camera and pose, by the stamp of its header.

        The poses' covariances include those of the parameters.
        """
        views = {}
        for k, (_, slopes) in enumerate(self.flight.views):
            view = self.flight.corrected(k, self.correction, self.z[k])
            root = np.hstack([slopes * self.flight.prior_sigma, self.flight.roots[k]])
            own = np.r_[:8, 8 + 6 * k : 14 + 6 * k]
            covariance = root @ self.joint_covariance[np.ix_(own, own)] @ root.T
            pose = dataclasses.replace(view.pose, covariance=covariance)
            views[view.stamp_ns] = view._replace(pose=pose)
        return views


def fit_ties(
    views: Sequence[TiedView],
    tracks: Tracks,
    plane: TangentPlane,
    ground: Ground,
    prior_sigma: Array = PRIOR_SIGMA,
    applied: Array | None = None,
    config: AdjustmentConfig | None = None,
    clicks: Sequence[PointSighting] = (),
) -> TieFit:
    """Fit PARAMETERS, the poses of the pictures with ties or clicks, and the ties' points.

    ``prior_sigma`` (8,) holds a parameter where it is zero. ``ground`` is the ellipsoidal height
    of the ground, m, or an elevation model. The slopes are taken as constant, so after a large
    correction compose poses and cameras again with it, and fit again with it as ``applied`` (8,).
    The correction and the priors are counted from the present values in any case. ``clicks`` on
    surveyed points, in any of ``views``, are the fit's last sightings, in their order.

    Raises CalibrationError if there are too few ties, or they or the clicks do not agree.
    """
    _check_numbers(tracks)
    tracks, surveyed_n = _with_clicks(tracks, clicks)
    by_stamp = {tied.view.stamp_ns: tied for tied in views}
    kept = [by_stamp[stamp] for stamp in tracks.stamps_ns.tolist()]
    applied = np.zeros(8) if applied is None else applied
    flight = TiedFlight(kept, tracks, prior_sigma, plane, ground, applied, surveyed_n)
    solver = Solver(flight, config or AdjustmentConfig())
    solver.solve(robust=True)
    solver.solve()
    solver.estimate_noise()
    solver.solve()
    solver.check_stillness()
    reasons = _undetermined(solver.covariance()[:8, :8])
    solver.hold(reasons)
    solver.solve()
    solver.estimate_noise()
    solver.solve()
    _check_clicks(solver.used[flight.clicks], float(solver.x[FOCAL]), prior_sigma[FOCAL])
    joint = solver.covariance(considered=reasons)
    return TieFit(
        flight=flight,
        correction=prior_sigma * solver.x[:8],
        covariance=joint[:8, :8] * np.outer(prior_sigma, prior_sigma),
        undetermined=reasons,
        z=solver.x[8:].reshape(-1, 6),
        joint_covariance=joint,
        points_n=solver.points_n,
        residuals=solver.residual,
        used=solver.used,
        noise=solver.noise,
    )


def _check_numbers(tracks: Tracks) -> None:
    """Raise CalibrationError if there are too few ties."""
    points, pictures = int(tracks.point.max(initial=-1)) + 1, len(tracks.stamps_ns)
    if points < LEAST_POINTS or pictures < LEAST_PICTURES:
        raise CalibrationError(
            f"{points} tied places in {pictures} pictures: at least {LEAST_POINTS} places and "
            f"{LEAST_PICTURES} pictures are needed; fly strips that overlap by half, over ground "
            "with texture"
        )


def _with_clicks(tracks: Tracks, clicks: Sequence[PointSighting]) -> tuple[Tracks, Array]:
    """Return the tracks with those of clicks at their end, and the places (C, 3) of the latter."""
    if not clicks:
        return tracks, np.empty((0, 3))
    seen_ns = np.concatenate([tracks.stamps_ns[tracks.picture], [c.stamp_ns for c in clicks]])
    stamps, picture = np.unique(seen_ns, return_inverse=True)
    ids = [click.id for click in clicks]
    _, first, number = np.unique(ids, return_index=True, return_inverse=True)
    point = np.concatenate([tracks.point, tracks.point.max() + 1 + number])
    uv = np.concatenate([tracks.uv, [click.uv for click in clicks]])
    return Tracks(stamps, picture, point, uv), np.array([clicks[k].point_n for k in first])


def _check_clicks(used: BoolArray, focal: float, sigma: float) -> None:
    """Raise CalibrationError if too few clicks agree, or if only ``focal`` (in sigmas) does it."""
    # From one height, wrong heights of the survey and another focal length are one.
    if used.sum() < LEAST_SHARE * len(used) or (len(used) and abs(focal) > _MOST_FOCAL):
        raise CalibrationError(
            f"{used.sum()} of {len(used)} observations of surveyed points agree with the ties, at "
            f"{1 + focal * sigma:.2f} of the focal length: check their ids and stamps, the "
            "survey's heights (ellipsoidal) and the camera's calibration"
        )


def _undetermined(covariance: Array) -> dict[str, str]:
    """Return why each parameter cannot be told that the ties do not determine, by name.

    ``covariance`` (8, 8) is in units of the prior sigmas; zero for a held parameter. The least
    determined one is held first: what is one with it may then be determined. The ground's height
    is no part of the set-up, and never named.
    """
    left, reasons = np.flatnonzero(np.diag(covariance)).tolist(), dict[str, str]()
    while left:
        part = covariance[np.ix_(left, left)]
        sigma = np.sqrt(np.diag(part))
        alike = np.abs(part / np.outer(sigma, sigma)) - np.eye(len(left))
        limits = np.where(alike.max(0) > _ONE, _MOST_SHARE_OF_ONE, MOST_SHARE)
        limits[np.equal(left, GROUND)] = np.inf
        worst = int(np.argmax(sigma / limits))
        if sigma[worst] <= limits[worst]:
            break
        name, partner = (PARAMETERS[left[k]] for k in (worst, int(alike[worst].argmax())))
        both = frozenset((name, partner)) if alike[worst].max() > _PARTNER else name
        reasons[name] = _REASONS.get(both, _REASONS[name])
        # As if it had been observed exactly.
        k = left.pop(worst)
        covariance = covariance - np.outer(covariance[k], covariance[k]) / covariance[k, k]
    return reasons
