"""Levels of detail: within their tolerance, whole in every combination, and few where far."""

import numpy as np

from tirgeo_ros.core.map.level_of_detail import TOLERANCES_M, Details
from tirgeo_ros.core.map.polylines import Polylines


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
    found, whole = details.seen(normals, offsets)
    np.testing.assert_array_equal(found, details.boxes.within(normals, offsets))
    least = normals @ details.boxes.centres - np.abs(normals) @ details.boxes.halves
    np.testing.assert_array_equal(whole, (least >= offsets[:, None]).all(axis=0)[found])
    assert 100 < len(found) < 2900
