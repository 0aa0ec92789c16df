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
"""Set up the normal equations of a bundle adjustment without the points, and the poses' prior.

Each point is seen in a few pictures, so its 3x3 block is eliminated by itself (the Schur
complement: Triggs et al., Bundle Adjustment, a Modern Synthesis, 2000, section 6). What remains is
as large as x = (gamma, z), however many points there are, and its inverse is x's covariance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed

#: Least time step over correlation time: pictures of one instant have the same error.
_LEAST_STEP = 5e-7
#: Information on each coordinate of a point, 1/m2: its block has an inverse without ties too.
_POINT_PRIOR = 1e-8


class Noise(NamedTuple):
    """Hold the noise that a fit works with."""

    pixel_sigma: float  # of a tie, px, per axis
    attitude_factor: float  # actual over expected sigma of the attitudes
    taus_s: Array  # (6,) correlation times of z

    @property
    def sigmas(self) -> Array:
        """Return the prior sigmas (6,) of z."""
        return np.repeat([1.0, self.attitude_factor], 3)


class Reduced(NamedTuple):
    """Hold the normal equations of x (n,), and how to find the points from it."""

    information: Array  # (n, n)
    gradient: Array  # (n,)
    inverse_roots: Array  # (M, 3, 3) inverse Cholesky factors of the points' blocks
    coupling: Any  # sparse (3M, n), whitened by them
    pull: Array  # (3M,) the points' gradient, whitened by them

    def point_step(self, step: Array) -> Array:
        """Return the points' step (M, 3), m, that goes with a step (n,) of x."""
        rest = (self.pull - self.coupling @ step).reshape(-1, 3)
        return np.asarray(np.einsum("mij,mi->mj", self.inverse_roots, rest))


def reduced(
    residual: Array,
    slopes: Array,
    weights: Array,
    picture: IntArray,
    point: IntArray,
    size: int,
    group: IntArray | None = None,
) -> Reduced:
    """Return the normal equations of R residuals (R, 2) with slopes (R, 2, 17), weights (R,).

    ``size`` is that of x. Each point needs a residual, if only one without weight. With a
    ``group`` (R,) x starts with two more for each group, and slopes (R, 2, 19) with its own two.
    """
    sparse = needed("scipy.sparse", "adjusting pictures by their ties", CalibrationError)
    rows, roots = np.arange(len(weights) + 1), np.sqrt(weights)
    whitened = slopes * roots[:, None, None]
    r = (residual * roots[:, None]).ravel()
    # Blocks of two columns: the group's, four of gamma, and three of the picture's z.
    own = np.empty((len(weights), 0), int) if group is None else group[:, None]
    first = int(own.max(initial=-1)) + 1
    gammas = np.broadcast_to(first + np.arange(4), (len(weights), 4))
    zs = first + 4 + 3 * picture[:, None] + np.arange(3)
    columns = np.hstack([own, gammas, zs])
    each = columns.shape[1]
    by_x = whitened[:, :, :-3].reshape(-1, 2, each, 2).swapaxes(1, 2).reshape(-1, 2, 2)
    a = sparse.bsr_matrix((by_x, columns.ravel(), each * rows), shape=(len(r), size))
    b = sparse.bsr_matrix((whitened[:, :, -3:], point, rows))

    blocks = (b.T @ b).data + _POINT_PRIOR * np.eye(3)
    inverse_roots = np.linalg.inv(np.linalg.cholesky(blocks))
    whiten = sparse.bsr_matrix((inverse_roots, rows[: len(blocks)], rows[: len(blocks) + 1]))
    coupling, pull = whiten @ (b.T @ a), whiten @ (b.T @ r)
    information = (a.T @ a - coupling.T @ coupling).toarray()
    return Reduced(information, a.T @ r - coupling.T @ pull, inverse_roots, coupling, pull)


def correlations(steps_s: Array, taus_s: Array) -> Array:
    """Return exp(-dt / tau) (..., 6) for time steps (...), s; a little below 1 at most."""
    return np.asarray(np.exp(-np.maximum(np.abs(steps_s)[..., None] / taus_s, _LEAST_STEP)))


def prior(times_s: Array, noise: Noise) -> tuple[Array, float]:
    """Return the prior information (n, n) of x, and the logarithm of its determinant.

    z is a stationary Gauss-Markov process in time: with a = exp(-dt / tau),
    (z_i - a z_{i-1}) / sqrt(1 - a^2) are independent of each other.
    """
    a = correlations(np.diff(times_s), noise.taus_s)
    weights = np.ones((len(times_s), 6))
    weights[1:] /= 1 - a**2
    weights /= noise.sigmas**2
    diagonal, beside = weights.copy(), (-a * weights[1:]).ravel()
    diagonal[:-1] += a**2 * weights[1:]
    information = np.eye(8 + weights.size)
    information[8:, 8:] = np.diag(diagonal.ravel()) + np.diag(beside, 6) + np.diag(beside, -6)
    return information, float(np.log(weights).sum())
