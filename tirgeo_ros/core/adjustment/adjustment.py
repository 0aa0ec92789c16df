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
"""Apply a fit to ties to poses of the flight between its pictures, and judge it by other ties."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tirgeo_ros.core.adjustment.normal_equations import correlations
from tirgeo_ros.core.adjustment.tie_fit import TieFit
from tirgeo_ros.core.adjustment.tied_views import moved, pose_root
from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, locate
from tirgeo_ros.core.ties.tracks import TiedPair
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: The height of a place (stamp, u, v) that the fit knows, as down coordinate, m.
Downs = Mapping[tuple[int, float, float], float]

#: Fewest ties of a pair that are judged. Those farther off than the median by this factor are not.
_LEAST_TIES, _FAR = 6, 3.0


class Adjustment:
    """Correct any camera pose of a flight by the fit to its pictures' ties.

    ``mounted`` returns a pose without the variance that it has by PARAMETERS, and its derivatives
    (6, 8) by them. It is needed if the fit estimated any: without it only the poses' own errors
    are corrected, as is right for poses that were composed with the corrected parameters, or
    whose parameters were all held.
    """

    def __init__(
        self,
        fit: TieFit,
        mounted: Callable[[CameraPose], tuple[CameraPose, Array]] | None = None,
    ) -> None:
        self._fit, self._mounted = fit, mounted
        self._start_ns = fit.flight.views[0].view.pose.stamp_ns

    def corrected(self, pose: CameraPose) -> CameraPose:
        """Return the pose corrected, with the covariance that remains.

        Between two pictures the correction is the mean of a Gauss-Markov process that is known at
        both; before the first and after the last one it decays.
        """
        fit, slopes = self._fit, np.zeros((6, 8))
        if self._mounted is not None:
            pose, slopes = self._mounted(pose)
        root = pose_root(pose)
        shares, variance = self._bridge((pose.stamp_ns - self._start_ns) * 1e-9)
        move = slopes @ (fit.correction - fit.flight.applied)
        columns, by_x = list(range(8)), [slopes * fit.flight.prior_sigma]
        for k, share in shares:
            move = move + root @ (share * fit.z[k])
            columns += range(8 + 6 * k, 14 + 6 * k)
            by_x.append(root * share)
        joint, own = fit.joint_covariance[np.ix_(columns, columns)], np.hstack(by_x)
        return moved(pose, move, own @ joint @ own.T + (root * variance) @ root.T)

    def _bridge(self, time_s: float) -> tuple[list[tuple[int, Array]], Array]:
        """Return the shares (6,) of neighbouring pictures' z at a time, and what variance is left.

        With a and b the correlations with the two neighbours: Rasmussen and Williams, Eq. 2.19,
        with the covariance of an Ornstein-Uhlenbeck process.
        """
        times, noise = self._fit.flight.times_s, self._fit.noise
        after = int(np.searchsorted(times, time_s))
        near = [k for k in (after - 1, after) if 0 <= k < len(times)]
        if len(near) == 2 and times[near[0]] == times[near[1]]:
            near = near[:1]
        to_each = correlations(time_s - times[near], noise.taus_s)  # (1 or 2, 6)
        between = correlations(times[near][:, None] - times[near], noise.taus_s)
        between[range(len(near)), range(len(near))] = 1.0
        shares = np.linalg.solve(between.transpose(2, 0, 1), to_each.T[:, :, None])[:, :, 0].T
        left = (1 - (shares * to_each).sum(0)) * noise.sigmas**2
        return list(zip(near, shares, strict=True)), np.maximum(left, 0.0)


def known_downs(fit: TieFit) -> dict[tuple[int, float, float], float]:
    """Return the down coordinates of the fit's places by each of their sightings."""
    tracks = fit.flight.tracks
    stamps = tracks.stamps_ns[tracks.picture].tolist()
    downs = fit.points_n[tracks.point, 2].tolist()
    sightings = zip(stamps, tracks.uv.tolist(), downs, fit.used.tolist(), strict=True)
    return {(stamp, u, v): down for stamp, (u, v), down, used in sightings if used}


def disagreement(
    views: Mapping[int, View],
    pairs: Sequence[TiedPair],
    plane: TangentPlane,
    ground: Ground,
    downs: Downs | None = None,
) -> Array:
    """Return how far the two rays of each tie are apart on the ground (K,), m, all pairs in turn.

    ``views`` are by the stamps of the pictures' headers. A tie is at the height that ``downs`` has
    for either of its sightings, else at the ground's. nan where a ray does not meet the ground.
    """
    apart = [np.empty(0)]
    for pair in pairs:
        sightings = ((pair.first_ns, pair.first_uv), (pair.second_ns, pair.second_uv))
        keys = ([(stamp, u, v) for u, v in uv.tolist()] for stamp, uv in sightings)
        known = downs or {}
        down = [known.get(a, known.get(b, np.nan)) for a, b in zip(*keys, strict=True)]
        first, second = (
            places(views[stamp], uv, np.array(down, float), plane, ground)
            for stamp, uv in sightings
        )
        apart.append(np.hypot(*(first - second)[:, :2].T))
    return np.concatenate(apart)


def shift_sigmas(
    views: Sequence[View], pair: TiedPair, plane: TangentPlane, ground: Ground, sigma_m: float
) -> float:
    """Return by how many standard deviations two views disagree on where their ties are.

    The deviation is that of both poses, of the ground's height (``sigma_m``), and the scatter of
    the ties, which relief causes. Errors of one flight's poses are correlated: those of the two
    count as opposite, the worst case. nan where too few rays meet the ground.
    """
    sights = zip(views, (pair.first_uv, pair.second_uv), strict=True)
    points_n = np.array([locate(v.camera, v.pose, uv, plane, ground)[0] for v, uv in sights])
    points_n = points_n[:, np.isfinite(points_n).all(axis=(0, 2))]
    if points_n.shape[1] < _LEAST_TIES:
        return np.nan
    apart = (points_n[0] - points_n[1])[:, :2]
    shift = np.median(apart, axis=0)
    off = np.hypot(*(apart - shift).T)
    covariance, by_height = np.cov(apart[off <= _FAR * np.median(off)].T), np.zeros(2)
    for sign, view, own_n in zip((1, -1), views, points_n, strict=True):
        by_pose, by_point = pixel_jacobian(view.camera, view.pose, own_n)
        moved = np.linalg.pinv(by_point[:, :, :2]) @ by_pose
        covariance += 2 * np.median(moved @ view.pose.covariance @ moved.swapaxes(1, 2), axis=0)
        offset_n = own_n - view.pose.position_n
        by_height += sign * np.median(offset_n[:, :2] / offset_n[:, 2:], axis=0)
    covariance += sigma_m**2 * np.outer(by_height, by_height)
    return float(np.sqrt(shift @ np.linalg.solve(covariance, shift)))


def places(view: View, uv: Array, down: Array, plane: TangentPlane, ground: Ground) -> Array:
    """Return where pixels (K, 2) lie on the ground (K, 3), m; ``down`` (K,) is nan where unknown.

    nan where a ray meets no ground.
    """
    position_n = view.pose.position_n
    direction_n = view.camera.rays(uv) @ matrix_from_quat(view.pose.q_nc).T
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (down - position_n[2]) / direction_n[:, 2]
    met = position_n + np.where(way > 0, way, np.nan)[:, None] * direction_n
    level = np.isnan(down)
    met[level] = locate(view.camera, view.pose, uv[level], plane, ground)[0]
    return np.asarray(met)
