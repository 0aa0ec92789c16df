"""Fit the set-up errors that explain the pictures' motion, given the camera's poses.

Ground points tracked from one picture to the next should move as predicted from the poses at both
exposures, the lens and the ground. Six errors are fitted by Gauss-Newton over many pairs of
pictures: of the latency, the focal length, the height above ground and the three boresight
angles. Turns show latency and focal length, flight over the ground shows the height.

The noise of a pair's two poses moves all its points together. So the mean of a pair, and the
deviations of its points from that mean, are weighted separately, each by its own spread. The
covariance is computed over pairs (the sandwich estimator; White, Econometrica 48, 1980).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_quat, matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array

#: Range of latency errors on both sides, and interval of the kept poses.
REACH_S, STEP_S = 0.3, 0.025
_BEYOND = 2  # additional intervals on both sides, for the slopes
#: Times, relative to the exposure, at which the poses of a pair are kept.
OFFSETS_S = STEP_S * np.arange(-round(REACH_S / STEP_S) - _BEYOND, round(REACH_S / STEP_S) + 3)

LATENCY, FOCAL, HEIGHT = 0, 1, 2
BORESIGHT = slice(3, 6)
#: Prior sigmas of the errors: s, log, log, rad for the three angles.
_LOOSE = np.array([0.3, 0.3, 1.5, 0.15, 0.15, 0.15])
#: Prior sigmas of errors that a first fit does not observe, so that the others take the motion.
_TIGHT = np.array([0.02, 0.05, 1.5, 0.03, 0.03, 0.03])
_OBSERVED = 0.6  # times _TIGHT: an error with a larger sigma is not observed
_STEPS = np.array([0.005, 0.005, 0.01, 0.002, 0.002, 0.002])
_LARGEST_STEP = np.array([0.05, 0.3, 0.5, 0.1, 0.1, 0.1])
_MOST_STEPS = 10
#: Search grids of each error.
_GRIDS = (
    np.arange(-REACH_S, REACH_S + 0.01, 2 * STEP_S),
    np.arange(-0.5, 0.51, 0.1),
    np.arange(-1.5, 1.51, 0.25),
    *[np.arange(-0.15, 0.16, 0.05)] * 3,
)
_SHARES = (1.0, 0.5, 0.25)
_FITS_PX = 1.5  # cost below which no search is needed before Gauss-Newton
_LEAST_PX = 0.25  # least sigma of a residual: no tracking is better
_HUBER = 2.0


class PicturePair(NamedTuple):
    """Hold points seen in two pictures, and the camera's poses around both exposures."""

    first: Array  # (N, 2) on the camera's plane z = 1
    second: Array  # (N, 2) the same points in the second picture
    above_m: Array  # (N,) height of the camera above the ground at each point
    poses: Array  # (2, K, 7) position and quaternion at OFFSETS_S from each exposure
    height_sigma_m: float  # of the poses


@dataclass(frozen=True)
class MotionFit:
    """Hold the errors of the set-up (true minus assumed), with their standard deviations."""

    values: Array  # (6,) latency s, log of focal length, log of height, boresight rad (FRD)
    sigmas: Array  # (6,)
    assumed: tuple[bool, ...]  # (6,) whether it is not observed and was held near zero
    pairs: int
    before: float  # rms over pairs of measured minus predicted motion, px
    after: float  # the same with the errors corrected
    moved: float  # rms over pairs of the measured motion, px
    without: tuple[float, ...]  # (4,) ``after`` with latency, focal, height or boresight at zero
    above_m: float  # median height above ground, as assumed
    height_sigma_m: float  # median over the pairs' poses


class _Scene:
    """Hold all pairs in arrays."""

    def __init__(self, pairs: Sequence[PicturePair], focal_px: float) -> None:
        self.focal_px = focal_px
        self.pair = np.repeat(np.arange(len(pairs)), [len(one.first) for one in pairs])
        self.counts = np.bincount(self.pair, minlength=len(pairs)).astype(float)
        self.first = np.concatenate([one.first for one in pairs])
        self.second = np.concatenate([one.second for one in pairs])
        self.above_m = np.concatenate([one.above_m for one in pairs])
        self.poses = np.stack([one.poses for one in pairs])  # (P, 2, K, 7)

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
        seen = np.einsum("nij,nj->ni", turn[self.pair], rays)
        seen -= shift[self.pair] * nearness[:, None]
        foretold = seen[:, :2] / np.maximum(seen[:, 2:], 0.1) * scale
        return np.asarray((self.second - foretold) * self.focal_px)

    def means(self, values: Array) -> Array:
        """Return the means over each pair: (N, ...) to (P, ...)."""
        total = np.zeros((len(self.counts), *values.shape[1:]))
        np.add.at(total, self.pair, values)
        return np.asarray(total / self.counts.reshape(-1, *[1] * (values.ndim - 1)))

    def pair_rms(self, residuals: Array) -> float:
        """Return the rms of the pairs' means, px."""
        return float(np.sqrt((self.means(residuals) ** 2).sum(1).mean()))


def fit_motion(pairs: Sequence[PicturePair], focal_px: float) -> MotionFit:
    """Fit the errors to ten or more pairs."""
    scene = _Scene(pairs, focal_px)
    start = np.zeros(6)
    if _cost(scene, start, _LOOSE) > _FITS_PX:
        start = _searched(scene)
    values, sigmas = _fitted(scene, start, _LOOSE)
    assumed = sigmas > _OBSERVED * _TIGHT
    assumed[HEIGHT] = False
    if assumed.any():
        start = np.where(assumed, 0.0, values)
        values, sigmas = _fitted(scene, start, np.where(assumed, _TIGHT, _LOOSE))

    def without(one: int | slice) -> float:
        left = values.copy()
        left[one] = 0.0
        return scene.pair_rms(scene.residuals(left))

    return MotionFit(
        values,
        sigmas,
        tuple(assumed.tolist()),
        len(pairs),
        without(slice(None)),
        scene.pair_rms(scene.residuals(values)),
        scene.pair_rms((scene.second - scene.first) * focal_px),
        tuple(without(one) for one in (LATENCY, FOCAL, HEIGHT, BORESIGHT)),
        float(np.median(scene.above_m)),
        float(np.median([one.height_sigma_m for one in pairs])),
    )


def _searched(scene: _Scene) -> Array:
    """Return (6,) errors near the best ones: search each on its grid in turn, twice."""
    x = np.zeros(6)
    for _ in range(2):
        for one, grid in enumerate(_GRIDS):
            places = [np.where(np.arange(6) == one, value, x) for value in grid]
            x = min([x, *places], key=lambda place: _cost(scene, place, _LOOSE))
    return x


def _fitted(scene: _Scene, x: Array, prior: Array) -> tuple[Array, Array]:
    """Return errors and their sigmas, started at ``x``; ``prior`` (6,) are sigmas about zero."""
    for _ in range(_MOST_STEPS):
        normal, blocks = _normal_equations(scene, x)
        inverse = np.linalg.inv(normal + np.diag(prior**-2))
        step = inverse @ (blocks.sum(0) - x / prior**2)
        step *= min(1.0, float((_LARGEST_STEP / np.maximum(np.abs(step), 1e-12)).min()))
        places = [x + share * step for share in _SHARES]
        for place in places:
            place[LATENCY] = np.clip(place[LATENCY], -REACH_S, REACH_S)
        best = _cost(scene, x, prior)
        better = next((one for one in places if _cost(scene, one, prior) < best), None)
        if better is None or (np.abs(step) < 0.1 * _STEPS).all():
            break
        x = better
    spread = blocks.T @ blocks + np.diag(prior**-2)
    covariance = inverse @ spread @ inverse
    return x, np.sqrt(np.maximum(covariance.diagonal(), inverse.diagonal()))


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
