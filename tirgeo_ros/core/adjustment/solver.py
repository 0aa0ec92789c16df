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
"""Solve a bundle adjustment: robust Gauss-Newton steps, and the noise along with it.

Cauchy weights first keep wrong ties from dominating; then least squares over the sightings that
agree. The noise of the ties comes from their residuals, clicks on surveyed points have their own.
That of the camera's attitudes (sigma and correlation time) is the most likely one, with everything
else integrated out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.adjustment.normal_equations import Noise, Reduced, prior, reduced
from tirgeo_ros.core.adjustment.tied_views import PARAMETERS, TiedFlight
from tirgeo_ros.core.calibration.boresight_model import CLICK_SIGMA_PX, SURVEY_SIGMA_M
from tirgeo_ros.core.ties.tie_config import RELIEF
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed

_MOST_SIGMAS = 4.5  # as for clicks: one of 2000 good sightings exceeds it with 8 % probability
_MEDIAN_SIGMAS = math.sqrt(2 * math.log(2))  # median distance of a two-dimensional normal error
_CAUCHY_SIGMAS = 2.4  # 95 % of the efficiency of least squares if no tie is wrong
_CELL_M = 50.0  # over which relief is alike: crowns, slopes, roofs
_LEAST_SHARE = 0.5  # of the sightings that must agree
#: Weight of a sighting that is left out: its point still follows the pictures.
_LEFT_OUT = 1e-6
_ROBUST_STEPS, _MOST_STEPS = 15, 30
#: A last step of the parameters and of the poses, in prior sigmas. Points seen at small angles
#: keep the poses moving a little.
_SETTLED, _POSES_SETTLED = 2e-3, 0.05
_DIVERGED = 20.0  # of these
#: Velocity of a cell's ties: its prior sigma, the least one that counts, as a fit to still ground
#: may seem to move by mm/s, and by how many sigmas: errors alone exceed them once in 3e5 cells.
_SPEED_MPS, _STILL_MPS, _STILL_SIGMAS = 1.0, 0.01, 5.0
_MOST_FACTOR = 15.0  # 64 stills of an H20T without RTK need 9.8, waves up to 30
#: Noise of the ties over the assumed one: the least that is believed, and the most that is a fit.
_PIXEL_FACTORS = (0.3, 8.0)
#: Prior sigmas of the logarithms of the attitudes' noise factor and correlation time.
_SPREAD = np.array([0.7, 1.0])


@dataclass(frozen=True)
class AdjustmentConfig:
    """Hold what is assumed of ties, relief and the poses' noise."""

    pixel_sigma: float = 0.7  # of a tie, px, per axis; scaled by the residuals
    relief: float = RELIEF  # of the ties' heights about the ground's
    tau_position_s: float = 60.0  # correlation time of the positions' errors
    #: Of the attitudes' errors, at least; estimated. Errors of several such times sum up, and the
    #: slow ones count for the set-up: one short time would make it twice too sure.
    tau_attitude_s: float = 5.0


class Solver:
    """Hold the state of a bundle adjustment; each method improves it, or returns a part."""

    def __init__(self, flight: TiedFlight, config: AdjustmentConfig) -> None:
        self._flight, self._config = flight, config
        taus_s = np.repeat([config.tau_position_s, config.tau_attitude_s], 3)
        self.noise = Noise(config.pixel_sigma, 1.0, taus_s)
        self.x = np.zeros(8 + 6 * len(flight.views))
        self.free = np.ones(len(self.x), bool)
        self.free[:8] = flight.prior_sigma > 0
        np.divide(flight.applied, flight.prior_sigma, out=self.x[:8], where=self.free[:8])
        self.points_n = flight.first_points()
        #: (M,) m-2: heights near each other have one error, so a cell's tell as much as one.
        cells = np.floor(np.nan_to_num(self.points_n[:, :2]) / _CELL_M)
        _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        self._cell, self._cells = cell.ravel(), len(counts)
        relief_m = config.relief * self._height_m()
        self._by_height = 1 / (relief_m**2 * counts[self._cell])
        self._by_height[flight.surveyed] = SURVEY_SIGMA_M**-2
        self.used: BoolArray = np.zeros(len(flight.tracks.uv), bool)
        self._normal: Reduced
        self._at: Array  # x at which the normal equations are

    def _height_m(self) -> float:
        """Return the usual height of the cameras above the points, m."""
        cameras = [tied.view.pose.position_n[2] for tied in self._flight.views]
        return float(np.nanmedian(self.points_n[:, 2]) - np.median(cameras))

    @property
    def residual(self) -> Array:
        """Return the residuals (N, 2), px, at the present state; nan if not in view."""
        return self._flight.linearised(self.x, self.points_n)[0][: len(self.used)]

    def hold(self, names: Iterable[str]) -> None:
        """Hold parameters at their present values in the aircraft's set-up."""
        held = np.flatnonzero(np.isin(PARAMETERS, list(names)))
        self.free[held], self.x[held] = False, 0.0

    def solve(self, *, robust: bool = False) -> None:
        """Iterate until the steps are small.

        Raises CalibrationError if the ties do not agree, or the iteration diverges.
        """
        for _ in range(_ROBUST_STEPS if robust else _MOST_STEPS):
            step = self._step(robust)
            if step < 1:
                return
        if not robust and step > _DIVERGED:
            raise CalibrationError(
                f"the fit to {len(self.points_n)} tied places does not converge: check stamps, "
                "focal length and mounting, and fly over ground with texture that does not move"
            )

    def _step(self, robust: bool) -> float:
        """Make one step; return its largest element of x, in those that count as settled."""
        point, clicks = self._flight.tracks.point, self._flight.clicks
        residual, slopes = self._flight.linearised(self.x, self.points_n)
        # A tie's residual is smaller than its error, as its point is fitted to it.
        seen = np.where(clicks, np.inf, np.bincount(point)[point])
        sigmas = np.hypot(*residual[: len(point)].T) / self._sigmas_px()
        sigmas = np.nan_to_num(sigmas / np.sqrt(1 - 1.5 / seen), nan=np.inf)
        scale = max(1.0, float(np.median(sigmas[~clicks])) / _MEDIAN_SIGMAS)
        near = sigmas < _MOST_SIGMAS * scale
        self.used = near & (clicks | (np.bincount(point, weights=near)[point] > 1))
        ties = self.used[~clicks]
        if not math.isfinite(scale) or not (robust or ties.mean() >= _LEAST_SHARE):
            raise CalibrationError(
                f"only {ties.sum()} of {len(ties)} sightings of ties agree: check stamps, "
                "focal length and mounting, and fly over ground with texture that does not move"
            )
        weights = 1 / (1 + (sigmas / (_CAUCHY_SIGMAS * scale)) ** 2) if robust else self.used
        self._normal, self._at = self._reduced(residual, slopes, weights), self.x
        step = np.zeros_like(self.x)
        pull = self._normal.gradient - self._prior() @ self.x
        step[self.free] = np.linalg.solve(self._within(self._information()), pull[self.free])
        self.x = self.x + step
        self.points_n = self.points_n + self._normal.point_step(step)
        return float(
            max(np.abs(step[:8]).max() / _SETTLED, np.abs(step[8:]).max() / _POSES_SETTLED)
        )

    def _reduced(
        self, residual: Array, slopes: Array, weights: Array | BoolArray, *, moving: bool = False
    ) -> Reduced:
        """Return the normal equations; ``weights`` (N,) are relative to a sighting's own."""
        tracks, surveyed = self._flight.tracks, self._flight.surveyed
        by_sighting = np.maximum(weights, _LEFT_OUT) / self._sigmas_px() ** 2
        each = np.concatenate([by_sighting, self._by_height, self._by_height[surveyed]])
        point = np.concatenate([tracks.point, np.arange(len(self.points_n)), surveyed])
        picture = np.zeros_like(point)
        picture[: len(tracks.picture)] = tracks.picture
        size = len(self.x) + 2 * self._cells * moving
        group = self._cell[point] if moving else None
        return reduced(np.nan_to_num(residual), slopes, each, picture, point, size, group)

    def check_stillness(self) -> None:
        """Raise CalibrationError if all ties of a cell move alike, or poses follow what moves.

        Waves, smoke, or a herd may look like ground.
        """
        if self.noise.attitude_factor > _MOST_FACTOR:
            raise CalibrationError(
                f"{len(self.points_n)} tied places agree only if attitudes are off by "
                f"{self.noise.attitude_factor:.0f} times their sigmas: check stamps and mounting, "
                "and fly over ground with texture that does not move"
            )
        velocities, covariances = self._velocities()
        speeds = np.hypot(*velocities.T)
        squares = np.einsum("ca,cab,cb->c", velocities, np.linalg.inv(covariances), velocities)
        moves = (speeds > _STILL_MPS) & (squares > _STILL_SIGMAS**2)
        if moves.any():
            raise CalibrationError(
                f"{moves[self._cell].sum()} of {len(self._cell)} tied places move alike, by up to "
                f"{speeds[moves].max():.2f} m/s, as waves, smoke or a herd do: fly over ground "
                "with texture that does not move"
            )

    def _velocities(self) -> tuple[Array, Array]:
        """Return the velocities (C, 2) of the cells' ties, m/s, and their covariances (C, 2, 2).

        They are one more step from the solution, with everything else free: a score test.
        """
        residual, slopes = self._flight.linearised(self.x, self.points_n)
        picture, times_s = self._flight.tracks.picture, self._flight.times_s
        since_s = np.zeros(len(slopes))
        since_s[: len(picture)] = (times_s - times_s.mean())[picture]
        slopes = np.concatenate([slopes[:, :, 14:16] * since_s[:, None, None], slopes], axis=2)
        normal = self._reduced(residual, slopes, self.used, moving=True)
        count = 2 * self._cells
        normal.information[:count, :count] += np.eye(count) / _SPEED_MPS**2
        normal.information[count:, count:] += self._prior()
        normal.gradient[count:] -= self._prior() @ self.x
        free = np.concatenate([np.ones(count, bool), self.free])
        covariance = np.linalg.inv(normal.information[np.ix_(free, free)])
        blocks = covariance[:count, :count].reshape(self._cells, 2, self._cells, 2)
        step = covariance[:count] @ normal.gradient[free]
        return step.reshape(-1, 2), np.einsum("cacb->cab", blocks)

    def _sigmas_px(self) -> Array:
        """Return the sigmas (N,) of the sightings per axis, px."""
        return np.where(self._flight.clicks, CLICK_SIGMA_PX, self.noise.pixel_sigma)

    def _prior(self) -> Array:
        return prior(self._flight.times_s, self.noise)[0]

    def _information(self) -> Array:
        return np.asarray(self._normal.information + self._prior())

    def _within(self, matrix: Array) -> Array:
        """Return the rows and columns of a matrix (n, n) that are estimated."""
        return np.asarray(matrix[np.ix_(self.free, self.free)])

    def covariance(self, considered: Iterable[str] = ()) -> Array:
        """Return the covariance (n, n) of x; held parameters count as exact, or as their prior."""
        covariance = np.zeros((len(self.x),) * 2)
        covariance[np.ix_(self.free, self.free)] = np.linalg.inv(self._within(self._information()))
        others = np.flatnonzero(np.isin(PARAMETERS, list(considered)))
        # An error of a held parameter moves the solution: by -inv(S_ff) S_fh.
        moves = -covariance @ self._information()[:, others]
        moves[others] = np.eye(len(others))
        return np.asarray(covariance + moves @ moves.T)

    def estimate_noise(self) -> None:
        """Estimate the noise of the ties and of the attitudes from the solution.

        Raises CalibrationError if the ties scatter more than ties do.
        """
        used = self.used & ~self._flight.clicks
        fitted = np.bincount(self._flight.tracks.point, weights=used) > 1
        # Each unknown takes up a freedom as far as the ties and not its prior determine it.
        by_prior = ((self._normal.inverse_roots[:, :, 2] ** 2).sum(1) * self._by_height)[
            fitted
        ].sum()
        by_prior += (self.covariance() * self._prior()).sum()
        freedom = 2 * used.sum() - 3 * fitted.sum() - self.free.sum() + by_prior
        residual, slopes = self._flight.linearised(self.x, self.points_n)
        sigma = math.sqrt((residual[: len(used)][used] ** 2).sum() / max(freedom, 1.0))
        least, most = np.multiply(self._config.pixel_sigma, _PIXEL_FACTORS).tolist()
        if sigma > most:
            raise CalibrationError(
                f"the ties scatter by {sigma:.1f} px about any fit: check stamps, focal length "
                "and mounting, and fly over ground with texture that does not move"
            )
        self.noise = self.noise._replace(pixel_sigma=max(sigma, least))
        self._normal, self._at = self._reduced(residual, slopes, self.used), self.x
        self.noise = self._most_likely()

    def _most_likely(self) -> Noise:
        """Return the most likely noise of the attitudes.

        With the sightings' information N and gradient b at x = 0, and the prior information L, the
        likelihood is det(L)^0.5 det(N + L)^-0.5 exp(b' (N + L)^-1 b / 2).
        """
        optimize, linalg = (
            needed(f"scipy.{part}", "adjusting pictures by their ties", CalibrationError)
            for part in ("optimize", "linalg")
        )
        normal, taus_s = self._normal, self.noise.taus_s[:3]
        seen = self._within(normal.information)
        pull = (normal.gradient + normal.information @ self._at)[self.free]

        def noise(logs: Array) -> Noise:
            factor, tau = np.exp(logs).tolist()
            tau_s = np.repeat(max(tau, 1.0) * self._config.tau_attitude_s, 3)
            return Noise(self.noise.pixel_sigma, factor, np.concatenate([taus_s, tau_s]))

        def unlikeliness(logs: Array) -> float:
            information, log_determinant = prior(self._flight.times_s, noise(logs))
            root = np.linalg.cholesky(seen + self._within(information))
            half = linalg.solve_triangular(root, pull, lower=True)  # its square is the exponent
            fit = 2 * np.log(np.diag(root)).sum() - log_determinant - half @ half
            return float(fit + ((logs / _SPREAD) ** 2).sum())

        corners = [[0.0, 0.0], [0.3, 0.0], [0.0, 0.5]]
        options = {"initial_simplex": corners, "xatol": 0.03, "fatol": 0.03}
        found = optimize.minimize(unlikeliness, corners[0], method="Nelder-Mead", options=options)
        return noise(found.x)
