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
"""Match the features of two pictures near their predicted pixels, and keep what agrees.

The poses of both pictures may be off, so the matches are off their predicted pixels by a small
homography. Moreover, relief moves a point along a known line. A robust fit of such a homography
keeps the matches that agree; it draws its samples with a fixed seed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian
from tirgeo_ros.core.ties.features import Features
from tirgeo_ros.core.ties.tie_config import TieConfig
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

Complex = npt.NDArray[np.complex128]  # vectors in a picture: column + i row

_DETECTION_PX = 1.0  # standard deviation of a feature's place
_SIGMAS = 3.0  # a feature is searched for within these of its predicted pixel
#: Largest ratio of a match's distance to the second best, at another place in the search.
_RATIO, _ONE_PLACE_PX = 0.85, 4.0
#: A match that stays in the picture within the first, though it should move by more than the
#: second, is part of an overlay.
_STAYS_PX, _MOVES_PX = 1.5, 8.0
# The fit.
_TOLERANCE_PX = 3.0  # across the line of relief; along it, the relief's own comes on top
_WIDENED = (2.5, 2.0, 1.5, 1.0, 1.0)  # tolerance of the guess, and of each fit after it
_GUESSES, _APART = 300, 0.1  # of two matches each, of half the picture
_BENT_PX = 5.0  # standard deviation of shear and perspective at the picture's edge
# What would match elsewhere.
_ALIKE = 1.08  # the distance that counts as about the least
_HERE = 2.0  # from the fit, in tolerances
_CELLS, _RANGE = 200, ((-400.0, 400.0), (-400.0, 400.0))  # px; four cells are taken together
_PER_RIVAL = 2.5  # matches here that are needed for each one elsewhere


class Prediction(NamedTuple):
    """Hold where N ground points that one picture shows should be in another one."""

    uv: Array  # (N, 2) px
    relief: Array  # (N, 2) px by which a standard deviation of height moves a point
    covariance: Array  # (N, 2, 2) px2, of both poses, relief and detection


def tied(
    views: tuple[View, View], features: tuple[Features, Features], config: TieConfig
) -> tuple[Array, Array]:
    """Return the pixels (K, 2) of the ties of two pictures in the first and in the second.

    There are none, K = 0, if fewer agree than ``least_ties``, or if about as many would agree with
    another place: in a repeated pattern, or by chance.
    """
    first, second = features
    first = first.only(views[1].shows(first.points_n))
    none = np.empty((0, 2)), np.empty((0, 2))
    if min(len(first.uv), len(second.uv)) < config.least_ties:
        return none
    predicted = _prediction(*views, first.points_n, config)
    distance = _distances(first, second, predicted)
    one, other = _matches(distance, first.uv, second.uv, predicted.uv)
    if len(one) < config.least_ties:
        return none
    places, found = _complex(predicted.uv), _complex(second.uv)
    relief = _complex(predicted.relief)
    kept, shifts = _fitted(places, relief, one, found[other] - places[one])
    if kept.sum() < config.least_ties:
        return none
    if not _is_alone(distance, found - (places + shifts)[:, None], relief):
        return none
    spread = _spread(first.only(one[kept]), views[0].camera, config)
    return first.uv[one[kept]][spread], second.uv[other[kept]][spread]


def _prediction(first: View, second: View, points_n: Array, config: TieConfig) -> Prediction:
    """Predict the pixels of ground points (N, 3) that both pictures show, NED, m.

    The points are those of pixels of the first picture. An error of its pose moves them on the
    ground by as much as it would move their pixels.
    """
    by_first, by_place = pixel_jacobian(first.camera, first.pose, points_n)
    by_second, by_point = pixel_jacobian(second.camera, second.pose, points_n)
    through = by_point[:, :, :2] @ np.linalg.pinv(by_place[:, :, :2])
    offset_n = points_n - first.pose.position_n
    relief = np.einsum("nij,nj->ni", by_point, -config.relief * offset_n)
    covariance = relief[:, :, None] * relief[:, None]
    covariance += _DETECTION_PX**2 * np.eye(2)
    mounting = np.diag([0.0] * 3 + [np.radians(config.mounting_sigma_deg) ** 2] * 3)
    for view, moved in ((first, through @ by_first), (second, by_second)):
        covariance += moved @ (view.pose.covariance + mounting) @ moved.transpose(0, 2, 1)
    return Prediction(second.pixels_of(points_n), relief, covariance)


def _spread(features: Features, camera: Camera, config: TieConfig) -> IntArray:
    """Return the indices of the strongest feature in each cell of a picture."""
    columns, rows = config.cells
    cells = (features.uv + 0.5) * [columns / camera.width, rows / camera.height]
    column, row = cells.astype(np.int64).T
    order = np.argsort(-features.strength, kind="stable")
    return np.sort(order[np.unique((columns * row + column)[order], return_index=True)[1]])


def _distances(first: Features, second: Features, predicted: Prediction) -> Array:
    """Return the squared distances (N, M) of descriptors; infinite outside the search."""
    ours, theirs = (each.descriptors.astype(np.float32) for each in (first, second))
    squares = ((each * each).sum(axis=1) for each in (ours, theirs))
    # Exact, as sums of whole numbers below 2^24.
    distance = np.add.outer(*squares) - 2 * (ours @ theirs.T)
    du, dv = np.moveaxis((second.uv - predicted.uv[:, None]).astype(np.float32), 2, 0)
    weight = np.linalg.inv(predicted.covariance).astype(np.float32)[..., None]
    out = (weight[:, 0, 0] * du + 2 * weight[:, 0, 1] * dv) * du + weight[:, 1, 1] * dv * dv
    distance[~(out <= _SIGMAS**2)] = np.inf
    return np.asarray(distance)


def _matches(
    distance: Array, first_uv: Array, second_uv: Array, predicted_uv: Array
) -> tuple[IntArray, IntArray]:
    """Return the indices (K,) of features of the two pictures that match.

    Each is the other's most similar one, and none at another place is nearly as similar.
    """
    one, other = np.arange(len(distance)), distance.argmin(axis=1)
    mutual = np.isfinite(distance[one, other]) & (distance.argmin(axis=0)[other] == one)
    stays = np.hypot(*(second_uv[other] - first_uv).T) < _STAYS_PX
    overlay = stays & (np.hypot(*(predicted_uv - first_uv).T) > _MOVES_PX)
    one, other = one[mutual & ~overlay], other[mutual & ~overlay]
    u, v = second_uv.T.astype(np.float32)
    away = (u[other, None] - u) ** 2 + (v[other, None] - v) ** 2 > _ONE_PLACE_PX**2
    rival = np.where(away, distance[one], np.inf).min(axis=1)
    sure = distance[one, other] < _RATIO**2 * rival
    return one[sure], other[sure]


def _is_alone(distance: Array, shifts: Complex, relief: Complex) -> bool:
    """Return whether features match where the fit expects them, and not as well elsewhere.

    ``shifts`` (N, M), px, are those of the second picture's features from where the fit expects
    the first one's. All count that are about as similar as the best match.
    """
    alike = np.isfinite(distance) & (distance <= _ALIKE**2 * distance.min(axis=1, keepdims=True))
    one, other = np.nonzero(alike)
    shift = shifts[one, other]
    here = _sizes(shift, relief[one]) < _HERE
    return _most_together(shift[here]) > _PER_RIVAL * _most_together(shift[~here])


def _most_together(shifts: Complex) -> int:
    """Return how many shifts, px, are about the same at most."""
    cells, _, _ = np.histogram2d(shifts.real, shifts.imag, bins=_CELLS, range=_RANGE)
    return int((cells[1:, 1:] + cells[1:, :-1] + cells[:-1, 1:] + cells[:-1, :-1]).max())


def _scaled(shifts: Complex, relief: Complex) -> Array:
    """Return shifts (..., K), px, along and across the lines of relief, in tolerances.

    The result is (..., 2, K). ``relief`` (K,), px, is what one standard deviation of height does.
    """
    high = np.abs(relief)
    turned = shifts * np.where(high > 0, relief.conj() / np.maximum(high, 1e-12), 1.0)
    return np.stack([turned.real / (_TOLERANCE_PX + high), turned.imag / _TOLERANCE_PX], axis=-2)


def _sizes(shifts: Complex, relief: Complex) -> Array:
    """Return the sizes (..., K) of shifts, in tolerances."""
    return np.asarray(np.hypot(*np.moveaxis(_scaled(shifts, relief), -2, 0)))


def _fitted(
    places: Complex, relief: Complex, one: IntArray, shifts: Complex
) -> tuple[BoolArray, Complex]:
    """Return which of K shifts fit one small homography, and its shifts (N,) of all places.

    ``shifts`` (K,), px, are those of places (N,) with the indices ``one``.
    """
    z = (places - places.mean()) / np.abs(places - places.mean()).max()
    linear = np.array([np.ones_like(z), z, z.conj()])
    homography = np.array([*linear, *(1j * linear), z * z.real, z * z.imag])
    model = _scaled(homography[:, one], relief[one]).reshape(8, -1).T
    wanted = _scaled(shifts, relief[one]).ravel()
    # Shear and perspective are small; shift, turn and scale are free.
    prior = np.diag([0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]) / _BENT_PX**2
    off = _sizes(shifts - _guess(z[one], relief[one], shifts), relief[one])
    for widened in _WIDENED:
        both = np.tile(off < widened, 2)
        normal = model[both].T @ model[both] + prior
        fit = np.linalg.lstsq(normal, model[both].T @ wanted[both], rcond=None)[0]
        off = _sizes(shifts - fit @ homography[:, one], relief[one])
    return off < 1.0, fit @ homography


def _guess(z: Complex, relief: Complex, shifts: Complex) -> Complex:
    """Return the shifts (K,) of the similarity, through two of them, that most agree with."""
    one, other = np.random.default_rng(0).integers(len(z), size=(2, _GUESSES))
    across = z[one] - z[other]
    turn = np.where(np.abs(across) > _APART, (shifts[one] - shifts[other]) / (across + 1e-12), 0)
    fitted = shifts[one, None] + turn[:, None] * (z - z[one, None])
    cost = np.minimum(_sizes(shifts - fitted, relief) ** 2, _WIDENED[0] ** 2).sum(axis=1)
    return np.asarray(fitted[cost.argmin()])


def _complex(vectors: Array) -> Complex:
    """Return vectors (K, 2) as complex numbers (K,)."""
    return np.asarray(vectors[:, 0] + 1j * vectors[:, 1])
