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
"""Fit the set-up errors that explain the pictures' motion, given the camera's poses.

Ground points tracked from one picture to the next should move as predicted from the poses at both
exposures, the lens and the ground. Six errors are fitted by Gauss-Newton over many pairs of
pictures: of the latency, the focal length, the height above ground and the three boresight
angles. Turns show latency and focal length, flight over the ground shows the height.

The noise of a pair's two poses moves all its points together. So the mean of a pair, and the
deviations of its points from that mean, are weighted separately, each by its own spread. The
covariance is computed over pairs (the sandwich estimator; White, Econometrica 48, 1980).

Pictures that are mirrored or upside down are turned back before the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, matrix_from_quat, matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array

#: Range of latency errors (few set more than half a second), and interval of the kept poses.
FROM_S, TO_S, STEP_S = -0.6, 1.1, 0.025
_BEYOND = 2  # additional intervals on both sides, for the slopes
#: Times, relative to the exposure, at which the poses of a pair are kept.
OFFSETS_S = STEP_S * np.arange(
    -round(TO_S / STEP_S) - _BEYOND, 1 - round(FROM_S / STEP_S) + _BEYOND
)

LATENCY, FOCAL, HEIGHT = 0, 1, 2
BORESIGHT = slice(3, 6)
#: Prior sigmas of the errors: s, log, log, rad for the three angles.
_LOOSE = np.array([0.3, 0.3, 1.5, 0.15, 0.15, 0.15])
#: Prior sigmas of errors that a first fit does not observe; the others then explain the motion.
_TIGHT = np.array([0.02, 0.05, 1.5, 0.03, 0.03, 0.03])
#: An error is not observed if its sigma is larger than _OBSERVED times _TIGHT, unless the error
#: is larger than _CLEAR sigmas.
_OBSERVED, _CLEAR = 0.6, 6.0
_STEPS = np.array([0.005, 0.005, 0.01, 0.002, 0.002, 0.002])
_LARGEST_STEP = np.array([0.05, 0.3, 0.5, 0.1, 0.1, 0.1])
_MOST_STEPS = 10
#: Search grids of each error.
_GRIDS = (
    np.arange(FROM_S, TO_S + 0.01, 2 * STEP_S),
    np.arange(-0.5, 0.51, 0.1),
    np.arange(-1.5, 1.51, 0.25),
    *[np.arange(-0.15, 0.16, 0.05)] * 3,
)
_SHARES = (1.0, 0.5, 0.25)
_FITS_PX = 1.5  # cost below which no search is needed before Gauss-Newton
_LEAST_PX = 0.25  # least sigma of a residual: no tracking is better
_STAMPS_S = 0.004  # sigma that all pairs share: poses are stamped to half a sample, 5 ms
_RISE_S = 0.1
#: How pictures may be turned, with the signs that turn their columns and rows back.
_TURNED = {"mirrored": (-1, 1), "upside down": (-1, -1), "upside down and mirrored": (1, -1)}
_HUBER = 2.0


class PicturePair(NamedTuple):
    """Hold points seen in two pictures, and the camera's poses around both exposures."""

    first: Array  # (N, 2) on the camera's plane z = 1
    second: Array  # (N, 2) the same points in the second picture
    above_m: Array  # (N,) height of the camera above the ground at each point
    poses: Array  # (2, K, 7) position and quaternion at OFFSETS_S from each exposure
    height_sigma_m: float  # of the poses
    angle_sigma_rad: float  # of a ground point's direction, by the poses
    step_s: float  # between the pictures


@dataclass(frozen=True)
class MotionFit:
    """Hold the errors of the set-up (true minus assumed), with their standard deviations."""

    values: Array  # (6,) latency s, log of focal length, log of height, boresight rad (FRD)
    sigmas: Array  # (6,)
    assumed: tuple[bool, ...]  # (6,) whether an error is not observed and was kept near zero
    pairs: int
    before: float  # rms over pairs of measured minus predicted motion, px
    after: float  # the same with the errors corrected
    moved: float  # rms over pairs of the measured motion, px
    without: tuple[float, ...]  # (4,) ``after`` with latency, focal, height or boresight at zero
    above_m: float  # median height above ground, as assumed
    height_sigma_m: float  # median over the pairs' poses
    angle_sigma_rad: float  # median over the pairs
    step_s: float  # median over the pairs
    turned: str = ""  # how the pictures are turned, in words; the fit has them turned back


class _Scene:
    """Hold all pairs in arrays."""

    def __init__(self, pairs: Sequence[PicturePair], focal_px: float) -> None:
        self.focal_px = focal_px
        self.pair = np.repeat(np.arange(len(pairs)), [len(pair.first) for pair in pairs])
        self.counts = np.bincount(self.pair, minlength=len(pairs)).astype(float)
        self.first = np.concatenate([pair.first for pair in pairs])
        self.second = np.concatenate([pair.second for pair in pairs])
        self.above_m = np.concatenate([pair.above_m for pair in pairs])
        self.poses = np.stack([pair.poses for pair in pairs])  # (P, 2, K, 7)
        #: Medians over the pairs: sigma of heights and of angles, time between the pictures.
        self.medians: list[float] = np.median([pair[4:] for pair in pairs], axis=0).tolist()

    def residuals(self, x: Array) -> Array:
        """Return (N, 2) px: measured minus predicted, with the errors ``x`` (6,) corrected."""
        # A latency larger than assumed means an earlier exposure.
        place = np.clip((-x[LATENCY] - OFFSETS_S[0]) / STEP_S, 0, len(OFFSETS_S) - 1.001)
        low, share = int(place), place % 1
        pose = self.poses[:, :, low] * (1 - share) + self.poses[:, :, low + 1] * share
        q = pose[..., 3:] / np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
        rotations = matrix_from_quat(q) @ matrix_from_rotvec(BODY_OPTICAL.T @ x[BORESIGHT])
        start, end = rotations[:, 0], rotations[:, 1]  # R_nc (P, 3, 3)
        scale = np.exp(x[FOCAL])
        rays = np.append(self.first / scale, np.ones((len(self.first), 1)), axis=1)
        turn = np.swapaxes(end, 1, 2) @ start
        shift = np.einsum("pji,pj->pi", end, pose[:, 1, :3] - pose[:, 0, :3])
        down = np.einsum("ni,ni->n", start[self.pair, 2], rays)
        nearness = np.maximum(down, 0.0) / (self.above_m * np.exp(x[HEIGHT]))
        points = np.einsum("nij,nj->ni", turn[self.pair], rays)
        points -= shift[self.pair] * nearness[:, None]
        predicted = points[:, :2] / np.maximum(points[:, 2:], 0.1) * scale
        return np.asarray((self.second - predicted) * self.focal_px)

    def means(self, values: Array) -> Array:
        """Return the means over each pair: (N, ...) to (P, ...)."""
        total = np.zeros((len(self.counts), *values.shape[1:]))
        np.add.at(total, self.pair, values)
        return np.asarray(total / self.counts.reshape(-1, *[1] * (values.ndim - 1)))

    def pair_rms(self, residuals: Array) -> float:
        """Return the rms of the pairs' means, px."""
        return float(np.sqrt((self.means(residuals) ** 2).sum(1).mean()))


def fit_motion(pairs: Sequence[PicturePair], focal_px: float) -> MotionFit:
    """Fit the errors to ten or more pairs; turn their pictures back where that fits better."""
    scene = _Scene(pairs, focal_px)
    start = _nearest(scene, np.zeros(6), LATENCY)  # a straight flight fits many latencies a little
    if _cost(scene, start, _LOOSE) > _FITS_PX:
        start = np.zeros(6)
        for error in (*range(6), *range(6)):  # each on its grid in turn, twice
            start = _nearest(scene, start, error)
    upright = best = _fit_of(scene, start)
    for turned, signs in _TURNED.items() if upright.after > _FITS_PX else ():
        back = [p._replace(first=p.first * signs, second=p.second * signs) for p in pairs]
        other = _fit_of(_Scene(back, focal_px), np.zeros(6))
        if other.after < min(best.after, 0.3 * upright.after):
            best = replace(other, turned=turned)
    return best


def _fit_of(scene: _Scene, start: Array) -> MotionFit:
    """Fit the errors, started at ``start`` (6,)."""
    values, sigmas = _fitted(scene, start, _LOOSE)
    assumed = (sigmas > _OBSERVED * _TIGHT) & (np.abs(values) < _CLEAR * sigmas)
    assumed[HEIGHT] = False
    if assumed.any():
        start = np.where(assumed, 0.0, values)
        values, sigmas = _fitted(scene, start, np.where(assumed, _TIGHT, _LOOSE))

    def without(part: int | slice) -> float:
        others = values.copy()
        others[part] = 0.0
        return scene.pair_rms(scene.residuals(others))

    height_sigma_m, angle_sigma_rad, step_s = scene.medians
    return MotionFit(
        values=values,
        sigmas=sigmas,
        assumed=tuple(assumed.tolist()),
        pairs=len(scene.counts),
        before=without(slice(None)),
        after=scene.pair_rms(scene.residuals(values)),
        moved=scene.pair_rms((scene.second - scene.first) * scene.focal_px),
        without=(without(LATENCY), without(FOCAL), without(HEIGHT), without(BORESIGHT)),
        above_m=float(np.median(scene.above_m)),
        height_sigma_m=height_sigma_m,
        angle_sigma_rad=angle_sigma_rad,
        step_s=step_s,
    )


def _nearest(scene: _Scene, x: Array, error: int) -> Array:
    """Return the best of ``x`` (6,) and its copies with ``error`` at each value of its grid."""
    places = [np.where(np.arange(6) == error, value, x) for value in _GRIDS[error]]
    return min([x, *places], key=lambda place: _cost(scene, place, _LOOSE))


def _fitted(scene: _Scene, x: Array, prior: Array) -> tuple[Array, Array]:
    """Return errors and their sigmas, started at ``x``; ``prior`` (6,) are sigmas about zero."""
    for _ in range(_MOST_STEPS):
        normal, blocks = _normal_equations(scene, x)
        inverse = np.linalg.inv(normal + np.diag(prior**-2))
        step = inverse @ (blocks.sum(0) - x / prior**2)
        step *= min(1.0, float((_LARGEST_STEP / np.maximum(np.abs(step), 1e-12)).min()))
        places = [x + share * step for share in _SHARES]
        for place in places:
            place[LATENCY] = np.clip(place[LATENCY], FROM_S, TO_S)
        best = _cost(scene, x, prior)
        better = next((place for place in places if _cost(scene, place, prior) < best), None)
        if better is None or (np.abs(step) < 0.1 * _STEPS).all():
            break
        x = better
    spread = blocks.T @ blocks + np.diag(prior**-2)
    covariance = inverse @ spread @ inverse
    variances = np.maximum(covariance.diagonal(), inverse.diagonal())
    variances[LATENCY] = max(variances[LATENCY], _latency_variance(scene, x)) + _STAMPS_S**2
    return x, np.sqrt(variances)


def _latency_variance(scene: _Scene, x: Array) -> float:
    """Return the latency's variance, from the rise of the residuals over a tenth of a second.

    The slope at one instant would be too large: the noise of the poses has slopes too.
    """
    before, rest, after = (
        scene.pair_rms(scene.residuals(x + step_s * np.eye(6)[LATENCY])) ** 2
        for step_s in (-_RISE_S, 0.0, _RISE_S)
    )
    rise = max((before + after) / 2 - rest, 1e-9)
    return _RISE_S**2 * max(rest / 2, _LEAST_PX**2) / (len(scene.counts) * rise)


def _cost(scene: _Scene, x: Array, prior: Array) -> float:
    """Return the robust cost: mean size of the pairs' means plus mean residual, px, plus prior."""
    residuals = scene.residuals(x)
    sizes = np.linalg.norm(scene.means(residuals), axis=1).mean()
    return float(sizes + np.abs(residuals).mean() + 1e-3 * ((x / prior) ** 2).sum())


def _normal_equations(scene: _Scene, x: Array) -> tuple[Array, Array]:
    """Return the information (6, 6), and each pair's contribution (P, 6) to the right side."""
    residuals = scene.residuals(x)
    slopes = np.stack(
        [(residuals - scene.residuals(x + step)) / step.sum() for step in np.diag(_STEPS)],
        axis=-1,
    )
    mean, mean_slopes = scene.means(residuals), scene.means(slopes)
    rest, rest_slopes = residuals - mean[scene.pair], slopes - mean_slopes[scene.pair]
    weights = np.append(_weights(mean), _weights(rest))
    parts, part_slopes = np.concatenate((mean, rest)), np.concatenate((mean_slopes, rest_slopes))
    normal = np.einsum("n,nij,nik->jk", weights, part_slopes, part_slopes)
    blocks = np.zeros((len(mean), 6))
    pair = np.append(np.arange(len(mean)), scene.pair)
    np.add.at(blocks, pair, np.einsum("n,ni,nij->nj", weights, parts, part_slopes))
    return normal, blocks


def _weights(residuals: Array) -> Array:
    """Return weights (N,): the inverse variance of a coordinate, less for outliers (Huber)."""
    size = np.linalg.norm(residuals, axis=1)
    sigma = max(float(np.median(size)) / 1.18, _LEAST_PX)  # 1.18 sigma: median of Rayleigh
    return np.asarray(np.minimum(1.0, _HUBER * sigma / np.maximum(size, 1e-12)) / sigma**2)
