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
"""Find the ties between the pictures of a flight, by their predicted poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ties.features import Features, features_of, nearest, standing
from tirgeo_ros.core.ties.matching import tied
from tirgeo_ros.core.ties.tie_config import TieConfig
from tirgeo_ros.core.ties.tracks import TiedPair
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array, RawPixels

_TURN_RAD = math.radians(10.0)  # a picture is taken after this turn, whatever it shows
OTHER_HEADING_RAD = math.radians(60.0)  # between two pictures
_LEAST_OVERLAP = 0.3  # of a pair
#: Best overlap of two pictures of one heading: the less, the better are heights known; the more,
#: the surer are matches.
_BEST_OVERLAP = 0.6
_TURNED = 2  # pairs of other headings that a picture asks for first
_NO_FEATURES = Features(
    np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 128), np.uint8), np.empty(0)
)


class _Picture(NamedTuple):
    """Hold what is kept of a picture."""

    view: View
    samples_n: Array  # (49, 3)
    features: Features


class TieFinder:
    """Collect the features of pictures, choose pairs of pictures that overlap, and match them.

    ``plane`` is the plane of the poses, ``ground`` the ellipsoidal height of the ground, m,
    or an elevation model.
    The same pictures in the same order give the same ties.
    """

    def __init__(
        self, plane: TangentPlane, ground: Ground, config: TieConfig | None = None
    ) -> None:
        self._plane, self._ground = plane, ground
        self._config = config or TieConfig()
        self._pictures: list[_Picture] = []
        self._last: tuple[View, Array] | None = None  # the last one wanted, and its samples
        self._wanted, self._every = 0, 1

    def wants(self, view: View) -> bool:
        """Return whether a picture differs enough from the last one taken, and shows ground."""
        if not np.isfinite(view.samples(self._plane, self._ground)).any():
            return False
        if self._last is None:
            return True
        last, samples_n = self._last
        turn_rad = turns_rad(np.stack([last.pose.q_nc, view.pose.q_nc]))[0, 1]
        is_soon = view.stamp_ns - last.stamp_ns < self._config.apart_s * 1e9
        most = self._config.most_overlap_soon if is_soon else self._config.most_overlap
        return bool(turn_rad >= _TURN_RAD or view.shows(samples_n).mean() < most)

    def add(self, view: View, pixels: RawPixels | None) -> None:
        """Take the next picture, (h, w) or (h, w, 3) BGR, 8 or 16 bits, if it is wanted.

        Only its features are kept. Without pixels it has none, but it may be ``crossing``.
        """
        if not self.wants(view):
            return
        samples_n = view.samples(self._plane, self._ground)
        self._last = view, samples_n
        self._wanted += 1
        if (self._wanted - 1) % self._every:
            return
        most, features = self._config.features, _NO_FEATURES
        if pixels is not None:
            features = features_of(view, pixels, self._plane, self._ground, most)
        self._pictures.append(_Picture(view, samples_n, features))
        if len(self._pictures) > self._config.most_pictures:
            self._pictures, self._every = self._pictures[::2], 2 * self._every

    def crossing(self, places: int) -> list[View]:
        """Return four views at most of each of some places that were seen in two headings.

        Of each place they are the two pictures that share most, and those that follow them.
        """
        if not self._pictures:
            return []
        turned = turns_rad(np.stack([each.view.pose.q_nc for each in self._pictures]))
        shares = np.triu(self._overlaps() * (turned >= OTHER_HEADING_RAD))
        seen = np.flatnonzero(shares.max(axis=1) >= _LEAST_OVERLAP)
        parts = [part for part in np.array_split(seen, places) if len(part)]
        firsts = [part[shares[part].max(axis=1).argmax()] for part in parts]
        numbers = {k + step for i in firsts for k in (i, shares[i].argmax()) for step in (0, 1)}
        return [each.view for k, each in enumerate(self._pictures) if k in numbers]

    def pairs(self) -> list[TiedPair]:
        """Return the ties of all pairs that have some, in the order of the pictures."""
        if not self._pictures:
            return []
        views, features = [each.view for each in self._pictures], self._moving()
        found = []
        for i, j in sorted(self._chosen()):
            uv = tied((views[i], views[j]), (features[i], features[j]), self._config)
            if len(uv[0]):
                found.append(TiedPair(views[i].stamp_ns, views[j].stamp_ns, *uv))
        return found

    def _moving(self) -> list[Features]:
        """Return the features of each picture that don't stand still in all of them."""
        every = [each.features for each in self._pictures]
        cameras = [each.view.camera for each in self._pictures]
        size = max(each.width for each in cameras), max(each.height for each in cameras)
        mask = standing([each.uv for each in every], *size)
        return [each.only(~mask[nearest(each.uv)]) for each in every]

    def _chosen(self) -> set[tuple[int, int]]:
        """Return the pairs (first, second) of indices of pictures to be matched.

        Each picture asks for the one that follows, two of other headings, and one of its own
        heading from another place; then for more of them.
        """
        turned = turns_rad(np.stack([each.view.pose.q_nc for each in self._pictures]))
        chosen: set[tuple[int, int]] = set()
        for i, overlaps in enumerate(self._overlaps()):
            partners = np.flatnonzero(overlaps >= _LEAST_OVERLAP)
            partners = partners[np.argsort(-overlaps[partners], kind="stable")]
            aside = turned[i, partners] >= OTHER_HEADING_RAD
            others, same = partners[aside].tolist(), partners[~aside]
            following = same[same > i][np.argsort(same[same > i])][:1].tolist()
            near = np.abs(overlaps[same] - _BEST_OVERLAP)
            places = [j for j in same[np.argsort(near, kind="stable")].tolist() if j != i]
            asked = [*following, *others[:_TURNED], *places[:1], *others[_TURNED:], *places[1:]]
            asked = [*dict.fromkeys(asked)][: self._config.pairs_per_picture]
            chosen |= {(min(i, j), max(i, j)) for j in asked}
        return chosen

    def _overlaps(self) -> Array:
        """Return (P, P) the share of each picture that another one shows, the less of the two."""
        samples_n = np.concatenate([each.samples_n for each in self._pictures])
        shown = np.array([each.view.shows(samples_n) for each in self._pictures])
        shares = shown.reshape(len(shown), len(shown), -1).mean(axis=2)
        return np.asarray(np.minimum(shares, shares.T))


def turns_rad(q_nc: Array) -> Array:
    """Return the angles (P, P) between attitudes (P, 4)."""
    rotations = matrix_from_quat(q_nc)
    cosines = (np.einsum("iab,jab->ij", rotations, rotations) - 1) / 2
    return np.asarray(np.arccos(np.clip(cosines, -1, 1)))
