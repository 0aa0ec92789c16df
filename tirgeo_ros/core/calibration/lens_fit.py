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
"""Fit a lens to checkerboard views (Zhang, A flexible new technique for camera calibration).

OpenCV solves the least squares. This module adds two things: views that do not fit the others are
removed one by one, and the parameters' covariance allows for different noise in each view.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
    rotation_of,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError, CameraError

#: Three views determine the focal lengths and the principal point; a wrong view needs more.
FEWEST_VIEWS = 4
#: A view is removed if its error is more than this multiple of the median, and more than these px.
_OUTLYING, _OUTLYING_PX = 2.5, 0.15
_MOST_RMS_PX = 1.0  # absolute limit of a view's error
#: Least angle, rad, of some board's normal from their mean: with less the focal length is a guess.
_LEAST_TILT_RAD = np.radians(5.0)
_MOST_FOCAL_SIGMA = 0.02  # relative to the focal length
_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
#: Views with a smaller rms distance of corners, relative to the picture's width, are duplicates.
#: At 640 px this is three pixels, about what a hand-held board still moves.
_SAME = 3 / 640
#: A view is too blurred if its blur exceeds the median of all by this factor and by these pixels.
_BLURRED_TIMES, _BLURRED_PX = 1.8, 0.5


@dataclass(frozen=True)
class LensFit:
    """Hold a calibrated lens."""

    camera: Camera
    names: tuple[str, ...]  # parameter names
    values: Array  # (P,)
    covariance: Array  # (P, P)
    errors_px: dict[str, Array]  # (count, 2) measured minus projected, by view
    tilt_rad: float  # largest angle between a board's normal and the mean normal
    refused: dict[str, Refused] = field(default_factory=dict)

    @property
    def sigma(self) -> Array:
        """Return the standard deviations (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def view_rms_px(self) -> dict[str, float]:
        """Return the rms distance of the corners of each view, px."""
        return {name: _rms(errors) for name, errors in self.errors_px.items()}

    @property
    def rms_px(self) -> float:
        """Return the rms reprojection error, px, as OpenCV defines it: of distances."""
        return _rms(np.concatenate([*self.errors_px.values()]))


def _rms(errors: Array) -> float:
    return float(np.sqrt((errors**2).sum(1).mean()))


def fit_lens(
    views: Mapping[str, BoardSighting],
    board: Checkerboard,
    size: tuple[int, int],
    *,
    with_k3: bool = False,
) -> LensFit:
    """Calibrate from sightings in pictures of ``size`` (width, height).

    Raises CalibrationError if there are too few views, or if they do not determine the parameters.
    """
    remaining = dict(views)
    refused: dict[str, Refused] = {}
    while True:
        if len(remaining) < FEWEST_VIEWS:
            gone = f" after {len(refused)} that do not fit" if refused else ""
            raise CalibrationError(
                f"lens: {len(remaining)} usable views are left{gone}; at least {FEWEST_VIEWS} "
                "are needed, 20 are good. Take more, all over the picture, with the board tilted"
            )
        fit = _fitted(remaining, board, size, with_k3=with_k3)
        rms_px = fit.view_rms_px
        worst = max(rms_px, key=rms_px.__getitem__)
        usual = float(np.median(list(rms_px.values())))
        if rms_px[worst] <= min(max(_OUTLYING * usual, _OUTLYING_PX), _MOST_RMS_PX):
            break
        detail = f"error {rms_px[worst]:.2f} px, usually {usual:.2f}"
        refused[worst] = Refused(RefusalReason.OUTLIER, detail)
        del remaining[worst]
    sigma = (fit.sigma[:2] / fit.values[:2]).max()
    if fit.tilt_rad < _LEAST_TILT_RAD:
        raise CalibrationError(
            f"lens: all views are from one side, within {np.degrees(fit.tilt_rad):.0f} deg: focal "
            "length and distance cannot be separated; tilt the board by 20 to 45 deg"
        )
    if not sigma < _MOST_FOCAL_SIGMA:
        raise CalibrationError(
            f"lens: the focal length is known only to {100 * sigma:.1f} %; "
            "take more views, larger in the picture and with the board tilted by 20 to 45 deg"
        )
    fit.refused.update(refused)
    return fit


def _fitted(
    views: Mapping[str, BoardSighting],
    board: Checkerboard,
    size: tuple[int, int],
    *,
    with_k3: bool,
) -> LensFit:
    points = board.points_m.astype(np.float32)
    corners = [view.corners_px.astype(np.float32)[:, None] for view in views.values()]
    names = _NAMES if with_k3 else _NAMES[:-1]
    flags = 0 if with_k3 else cv2.CALIB_FIX_K3
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    try:
        _, matrix, distortion, turns, places = cv2.calibrateCamera(
            [points] * len(corners), corners, size, None, None, flags=flags, criteria=stop
        )
    except cv2.error:
        raise CalibrationError(
            "lens: the views have no common solution; take more, with the board tilted"
        ) from None
    count = len(names)
    distortion = np.asarray(distortion, float).ravel()
    values = np.array([matrix[0, 0], matrix[1, 1], *matrix[:2, 2], *distortion])
    errors: dict[str, Array] = {}
    slopes: list[tuple[Array, Array]] = []
    for (name, view), turn, place in zip(views.items(), turns, places, strict=True):
        flat, slope = cv2.projectPoints(board.points_m, turn, place, matrix, distortion)
        errors[name] = view.corners_px - np.asarray(flat).reshape(-1, 2)
        by_all = np.asarray(slope, float)
        slopes.append((by_all[:, 6 : 6 + count], by_all[:, :6]))
    normals = np.array([rotation_of(turn)[:, 2] for turn in turns])
    mean = normals.mean(0) / np.linalg.norm(normals.mean(0))
    tilt_rad = float(np.arccos(np.clip(normals @ mean, -1, 1)).max())
    covariance = _covariance(slopes, [error.ravel() for error in errors.values()])
    fx, fy, cx, cy, *coefficients = values[:count].tolist()
    try:
        camera = Camera(*size, fx, fy, cx, cy, tuple(coefficients))
    except CameraError as error:
        raise CalibrationError(
            f"lens: the views give no usable lens ({error}); take more near the picture's "
            "corners, or estimate fewer coefficients"
        ) from None
    return LensFit(camera, names, values[:count], covariance, errors, tilt_rad)


def _covariance(slopes: list[tuple[Array, Array]], errors_px: list[Array]) -> Array:
    """Return the covariance (P, P) of the lens parameters, with the views' poses unknown.

    ``slopes`` of a view are derivatives of its coordinates by the lens (M, P) and by the pose
    (M, 6). With unit weights the estimate is H^-1 sum(J^T e). A view's errors have their own
    empirical variance (White, 1980), corrected for the degrees of freedom that the fit uses.
    """
    count = slopes[0][0].shape[1]
    scale = np.sqrt(sum((lens**2).sum(0) for lens, _ in slopes)) + 1e-300
    total, spread = np.zeros((count, count)), np.zeros((count, count))
    taken = 6 + count / len(slopes)
    for (lens, pose), errors in zip(slopes, errors_px, strict=True):
        unit = np.linalg.qr(pose)[0]
        free = lens / scale
        free = free - unit @ (unit.T @ free)  # project out what the pose can compensate
        part = free.T @ free
        total += part
        spread += part * (errors @ errors) / max(len(errors) - taken, 1.0)
    inverse = np.linalg.pinv(total, rcond=1e-15, hermitian=True)
    covariance = inverse @ spread @ inverse / np.outer(scale, scale)
    return np.asarray((covariance + covariance.T) / 2)


def doubtful_views(views: Mapping[str, BoardSighting], width: int) -> dict[str, Refused]:
    """Return the rejected views: too blurred ones, and all but the sharpest of similar ones."""
    blurs = {name: float(view.blur_px.max()) for name, view in views.items()}
    usual = float(np.median([*blurs.values()])) if blurs else 0.0
    most = max(_BLURRED_TIMES * usual, usual + _BLURRED_PX)
    refused: dict[str, Refused] = {}
    kept: dict[str, BoardSighting] = {}
    for name in _by_sharpness(views):
        same = [k for k, v in kept.items() if _distance_px(v, views[name]) < _SAME * width]
        if blurs[name] > most:
            detail = f"edges blurred by {blurs[name]:.1f} px, usually {usual:.1f}"
            refused[name] = Refused(RefusalReason.BLURRED, detail)
        elif same:
            refused[name] = Refused(RefusalReason.DUPLICATE, f"nothing has moved since {same[0]}")
        else:
            kept[name] = views[name]
    return refused


def _by_sharpness(views: Mapping[str, BoardSighting]) -> list[str]:
    return sorted(views, key=lambda name: (views[name].sigma_px, name))


def _distance_px(first: BoardSighting, second: BoardSighting) -> float:
    """Return the rms distance of corners, px, counted from the ends that make it smaller."""
    a, b = first.corners_px, second.corners_px
    return min(_rms(a - b), _rms(a - b[::-1]))


def most_distinct(views: Mapping[str, BoardSighting], count: int) -> list[str]:
    """Return ``count`` names, the sharpest first, then always the farthest from those chosen."""
    left = _by_sharpness(views)
    if len(left) <= count:
        return left
    chosen, away = [left[0]], dict.fromkeys(left[1:], np.inf)
    while len(chosen) < count:
        newest = views[chosen[-1]]
        away = {name: min(far, _distance_px(newest, views[name])) for name, far in away.items()}
        chosen.append(max(away, key=away.__getitem__))
        del away[chosen[-1]]
    return chosen
