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
"""Detect the features of a picture, and find those that stand still in all pictures.

SIFT (Lowe 2004) in a picture with local contrast (CLAHE). Each feature is described as it looks
with north up: the predicted heading is more certain than SIFT's own direction. AKAZE isn't in
every OpenCV from 4.6 to 5. Measured on two real strips without RTK: pairs of opposite headings
that were tied, of those chosen, and their ties, with nothing masked; seconds a picture, one core.

| features | H20T, forest | M2EA, orchards | s |
| --- | --- | --- | --- |
| SIFT, north up | 66 of 73, 5803 | 25 of 26, 4729 | 0.31 |
| SIFT, own directions | 48 of 73, 3861 | 24 of 26, 4214 | 0.23 |
| ORB, at its best ratio, 0.9 | 41 of 73, 3226 | 25 of 26, 4671 | 0.05 |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, locate
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray, Pixels, RawPixels

_CONTRAST, _TILES = 3.0, (8, 8)
_LEAST_SPAN = 16.0  # of values in a 16-bit picture, as in tone mapping
_LENGTH = 128  # of a descriptor
#: A place stands still if by this many standard deviations, and one more, too many pictures have a
#: feature there, to a pixel: by chance it is a place or two of a picture.
_STANDING_SIGMAS = 5.0
_AROUND = (17, 17)  # what stands still is masked with a border of 8 px


class Features(NamedTuple):
    """Hold the N features of a picture."""

    uv: Array  # (N, 2) px
    points_n: Array  # (N, 3) ground points, NED, m, by the predicted pose
    descriptors: Pixels  # (N, 128)
    strength: Array  # (N,) of the detector's response

    def only(self, kept: BoolArray | IntArray) -> Features:
        """Return some features, by a mask (N,) or by indices."""
        points_n, descriptors = self.points_n[kept], self.descriptors[kept]
        return Features(self.uv[kept], points_n, descriptors, self.strength[kept])


def local_contrast(pixels: RawPixels) -> Pixels:
    """Return a picture of 8 or 16 bits, grey or BGR, as grey of 8 bits with local contrast."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
    if grey.dtype != np.uint8:
        low, high = np.percentile(grey, (1.0, 99.0))
        factor = 255.0 / max(high - low, _LEAST_SPAN)
        grey = np.clip((grey - low) * factor, 0, 255).astype(np.uint8)
    return np.asarray(cv2.createCLAHE(_CONTRAST, _TILES).apply(grey))


def features_of(
    view: View, pixels: RawPixels, plane: TangentPlane, ground: Ground, most: int
) -> Features:
    """Return the ``most`` strongest features of a picture, without those that show no ground."""
    sift, grey = cv2.SIFT.create(most), local_contrast(pixels)
    found = sift.detect(grey)
    uv = np.array([each.pt for each in found]).reshape(-1, 2)
    _, first = np.unique(uv, axis=0, return_index=True)  # SIFT repeats a place, by direction
    points_n, _ = locate(view.camera, view.pose, uv[first], plane, ground)
    north = pixel_jacobian(view.camera, view.pose, points_n)[1][:, :, 0]  # px/m, (N, 2)
    kept = np.isfinite(north).all(axis=1)
    upright = [found[k] for k in first[kept]]
    for each, (u, v) in zip(upright, north[kept].tolist(), strict=True):
        each.angle = float(np.degrees(np.arctan2(v, u))) % 360
    descriptors = sift.compute(grey, upright)[1] if upright else np.empty((0, _LENGTH))
    strength = np.array([each.response for each in upright])
    return Features(uv[first[kept]], points_n[kept], descriptors.astype(np.uint8), strength)


def standing(pictures: Sequence[Array], width: int, height: int) -> BoolArray:
    """Return a mask (height, width) of what stands still: labels, lines, bad pixels.

    ``pictures`` are the features' pixels (N, 2) of pictures between which the ground moved.
    """
    count = np.zeros((height, width), np.uint16)
    for uv in pictures:
        here = np.zeros((height, width), np.uint8)
        here[nearest(uv)] = 1
        count += np.asarray(cv2.dilate(here, np.ones((3, 3), np.uint8)), np.uint16)
    mean = count.mean()
    still = count > mean + _STANDING_SIGMAS * np.sqrt(mean) + 1
    return np.asarray(cv2.dilate(still.astype(np.uint8), np.ones(_AROUND, np.uint8)) > 0)


def nearest(uv: Array) -> tuple[IntArray, IntArray]:
    """Return the rows (N,) and columns (N,) of the pixels at ``uv`` (N, 2)."""
    column, row = np.rint(uv).astype(np.int64).T
    return row, column
