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
"""Polylines in one block, against plain loops; and their levels of detail."""

import numpy as np
from hypothesis import given, strategies as st

from tirgeo_ros.core.map.polylines import TOLERANCES_M, Details, Polylines

LENGTHS = st.lists(st.integers(2, 6), min_size=1, max_size=8)
SEEDS = st.integers(0, 2**31)


def lines_of(lengths, seed, dimensions=3):
    rng = np.random.default_rng(seed)
    starts = np.cumsum([0, *lengths])
    owner = rng.integers(0, 5, len(lengths))
    return Polylines(rng.normal(size=(dimensions, starts[-1])), starts, owner)


def cut_by_loop(lines, enter, leave):
    out, owners = [], []
    for number, (a, b) in enumerate(zip(lines.starts[:-1], lines.starts[1:], strict=True)):
        joined = False
        for i in range(a, b - 1):
            if enter[i] >= leave[i]:
                joined = False
                continue
            start, end = lines.points[:, i], lines.points[:, i + 1]
            if not joined or enter[i] > 0:
                out.append([start + enter[i] * (end - start)])
                owners.append(lines.owner[number])
            out[-1].append(end if leave[i] == 1 else start + leave[i] * (end - start))
            joined = leave[i] == 1
    return out, owners


@given(lengths=LENGTHS, seed=SEEDS)
def test_cut(lengths, seed):
    lines = lines_of(lengths, seed)
    rng = np.random.default_rng(seed + 1)
    count = lines.points.shape[1] - 1
    enter = np.where(rng.random(count) < 0.6, 0.0, rng.random(count))
    leave = np.where(rng.random(count) < 0.6, 1.0, rng.random(count))
    leave[~lines.links()] = 0.0
    result = lines.cut(enter, leave)
    wanted, owners = cut_by_loop(lines, enter, leave)
    assert result.owner.tolist() == owners
    assert len(result.split()) == len(wanted)
    for line, other in zip(result.split(), wanted, strict=True):
        np.testing.assert_array_equal(line, other)


@given(lengths=LENGTHS, seed=SEEDS)
def test_subdivided_lines_keep_their_points_and_stay_straight(lengths, seed):
    lines = lines_of(lengths, seed)
    rng = np.random.default_rng(seed + 1)
    pieces = np.where(lines.links(), rng.integers(1, 5, lines.points.shape[1] - 1), 1)
    finer = lines.subdivided(pieces)
    np.testing.assert_array_equal(finer.owner, lines.owner)
    for number, (line, other) in enumerate(zip(finer.split(), lines.split(), strict=True)):
        own = pieces[lines.starts[number] : lines.starts[number + 1] - 1]
        wanted = [
            a + k / n * (b - a)
            for a, b, n in zip(other[:-1], other[1:], own, strict=True)
            for k in range(n)
        ]
        np.testing.assert_allclose(line, [*wanted, other[-1]], atol=1e-15)


def walks(count, vertices):
    rng = np.random.default_rng(1)
    parts = [
        rng.uniform(-500, 500, 3) + np.cumsum(rng.normal(0, 1, (vertices, 3)), axis=0)
        for _ in range(count)
    ]
    starts = np.arange(count + 1) * vertices
    return Polylines(np.concatenate(parts).T, starts, np.arange(count))


def distance_to(line, points):
    """(N,) of points (N, k) to the nearest segment of a line (n, k)."""
    a, step = line[:-1], np.diff(line, axis=0)
    off = points[:, None] - a
    squared = np.maximum((step**2).sum(axis=1), 1e-300)
    along = np.clip((off * step).sum(axis=2) / squared, 0, 1)
    return np.linalg.norm(off - along[..., None] * step, axis=2).min(axis=1)


def test_every_level_is_within_its_tolerance_and_keeps_its_ends():
    details = Details.of(walks(20, 200), np.zeros(20, int))
    every = np.arange(len(details.owner))
    full = details.lines(every, np.zeros_like(every)).split()
    for level, tolerance in enumerate(TOLERANCES_M):
        for line, coarse in zip(
            full, details.lines(every, every * 0 + level).split(), strict=True
        ):
            np.testing.assert_array_equal(coarse[[0, -1]], line[[0, -1]])
            assert distance_to(coarse, line).max() <= tolerance + 1e-9
    assert details.count[-1].sum() < 0.1 * details.count[0].sum()


def test_culling_by_blocks_finds_what_culling_by_boxes_finds():
    details = Details.of(walks(3000, 4), np.zeros(3000, int))
    normals, offsets = np.array([[1.0, 0, 0], [0.0, 0.6, 0.8]]), np.array([100.0, -50.0])
    result, whole = details.in_view(normals, offsets)
    np.testing.assert_array_equal(result, details.boxes.in_view(normals, offsets)[0])
    least = normals @ details.boxes.centres - np.abs(normals) @ details.boxes.halves
    np.testing.assert_array_equal(whole, (least >= offsets[:, None]).all(axis=0)[result])
    assert 100 < len(result) < 2900
