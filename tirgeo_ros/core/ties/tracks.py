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
"""Join the ties of pairs of pictures to tracks: the sightings of one point in many pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array, IntArray


class TiedPair(NamedTuple):
    """Hold the K ties of two pictures, whose stamps are those of their headers."""

    first_ns: int
    second_ns: int
    first_uv: Array  # (K, 2) px
    second_uv: Array  # (K, 2) px


class Tracks(NamedTuple):
    """Hold N sightings of M ground points in P pictures."""

    stamps_ns: IntArray  # (P,) the pictures that have a sighting, increasing
    picture: IntArray  # (N,) index into stamps_ns
    point: IntArray  # (N,) 0 to M - 1; each point is seen in two pictures or more
    uv: Array  # (N, 2) px


def tracks_of(pairs: Sequence[TiedPair]) -> Tracks:
    """Return the tracks of ties; a point with two sightings in one picture is left out.

    Sightings are one if picture and pixel are the same to the last digit.
    """
    if not sum(len(pair.first_uv) for pair in pairs):
        empty = np.empty(0, np.int64)
        return Tracks(empty, empty, empty, np.empty((0, 2)))
    stamps = np.unique([[pair.first_ns, pair.second_ns] for pair in pairs]).astype(np.int64)
    firsts = [(pair.first_ns, pair.first_uv) for pair in pairs]
    seconds = [(pair.second_ns, pair.second_uv) for pair in pairs]
    ends = [
        np.insert(uv, 0, float(np.searchsorted(stamps, stamp_ns)), axis=1)
        for stamp_ns, uv in [*firsts, *seconds]
    ]
    seen, where = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    point = _joined(len(seen), where.reshape(2, -1).T)
    return _without_contradictions(stamps, seen[:, 0].astype(np.int64), point, seen[:, 1:])


def _joined(count: int, links: IntArray) -> IntArray:
    """Return the number (count,) of each sighting's group, from links (K, 2) between them."""
    parent = list(range(count))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = k = parent[parent[k]]
        return k

    for one, other in links.tolist():
        parent[root(one)] = root(other)
    return np.array([root(k) for k in range(count)], np.int64)


def _without_contradictions(
    stamps: IntArray, picture: IntArray, point: IntArray, uv: Array
) -> Tracks:
    """Return tracks of the points that are seen once in each picture."""
    order = np.lexsort((picture, point))
    picture, point, uv = picture[order], point[order], uv[order]
    twice = point[1:][(np.diff(point) == 0) & (np.diff(picture) == 0)]
    kept = ~np.isin(point, twice)
    used, index = np.unique(picture[kept], return_inverse=True)
    number = np.unique(point[kept], return_inverse=True)[1]
    return Tracks(stamps[used], index.ravel(), number.ravel(), uv[kept])
