"""Levels of detail: within their tolerance, whole in every combination, and few where far."""

import numpy as np
import pytest

from tirgeo_ros.core.map.level_of_detail import (
    PIECE_VERTICES,
    TOLERANCES_M,
    Boxes,
    Details,
    cut_in_pieces,
    worths,
)
from tirgeo_ros.core.map.polylines import Polylines


def walks(count, vertices, seed=1, step=1.0):
    rng = np.random.default_rng(seed)
    parts = [
        rng.uniform(-500, 500, 3) + np.cumsum(rng.normal(0, step, (vertices, 3)), axis=0)
        for _ in range(count)
    ]
    starts = np.arange(count + 1) * vertices
    return Polylines(np.concatenate(parts).T, starts, np.arange(count))


def details_of(lines, layer=None):
    return Details.of(lines, np.zeros(len(lines), int) if layer is None else layer)


def distance_to(line, points):
    """(N,) of points (N, k) to the nearest segment of a line (n, k)."""
    a, step = line[:-1], np.diff(line, axis=0)
    off = points[:, None] - a
    squared = np.maximum((step**2).sum(axis=1), 1e-300)
    along = np.clip((off * step).sum(axis=2) / squared, 0, 1)
    return np.linalg.norm(off - along[..., None] * step, axis=2).min(axis=1)


def douglas_peucker(line, tolerance):
    """By recursion, as the textbook has it: which vertices stay."""
    stay = np.zeros(len(line), bool)
    stay[[0, -1]] = True

    def split(a, b):
        if b - a < 2:
            return
        off = distance_to(line[[a, b]], line[a + 1 : b])
        if off.max() > tolerance:
            middle = a + 1 + int(off.argmax())
            stay[middle] = True
            split(a, middle)
            split(middle, b)

    split(0, len(line) - 1)
    return stay


@pytest.mark.parametrize("tolerance", TOLERANCES_M[[1, 5, 8, 9, 10]])
def test_worths_are_those_of_douglas_and_peucker(tolerance):
    lines = walks(5, 50)
    stays = worths(lines) > tolerance
    for number, line in enumerate(lines.split()):
        np.testing.assert_array_equal(
            stays[number * 50 : number * 50 + 50], douglas_peucker(line, tolerance)
        )


def test_every_level_is_within_its_tolerance_and_keeps_its_ends():
    details = details_of(walks(20, 200))
    every = np.arange(len(details.owner))
    full = details.lines(every, np.zeros_like(every)).split()
    for level, tolerance in enumerate(TOLERANCES_M):
        for line, coarse in zip(
            full, details.lines(every, every * 0 + level).split(), strict=True
        ):
            np.testing.assert_array_equal(coarse[[0, -1]], line[[0, -1]])
            assert distance_to(coarse, line).max() <= tolerance + 1e-9
    assert details.count[-1].sum() < 0.1 * details.count[0].sum()


def test_pieces_make_up_their_lines_again():
    lines = walks(7, 3 * PIECE_VERTICES)
    details = details_of(lines, np.arange(7) % 2)
    for number, line in enumerate(lines.split()):
        own = details.place[details.piece_starts[number] : details.piece_starts[number + 1]]
        parts = details.lines(own, np.zeros_like(own)).split()
        again = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        np.testing.assert_array_equal(again, line)
        assert set(details.owner[own]) == {number}


@pytest.mark.parametrize("vertices", [2, 3, PIECE_VERTICES, PIECE_VERTICES + 1, 1000])
def test_pieces_are_short_and_meet(vertices):
    pieces, line = cut_in_pieces(walks(3, vertices))
    assert np.diff(pieces.starts).max() <= PIECE_VERTICES
    assert np.diff(pieces.starts).min() >= 2
    parts = pieces.split()
    for i in np.flatnonzero(np.diff(line) == 0):
        np.testing.assert_array_equal(parts[i][-1], parts[i + 1][0])


def test_culling_by_blocks_finds_what_culling_by_boxes_finds():
    details = details_of(walks(3000, 4))
    normals, offsets = np.array([[1.0, 0, 0], [0.0, 0.6, 0.8]]), np.array([100.0, -50.0])
    found, whole = details.seen(normals, offsets)
    np.testing.assert_array_equal(found, details.boxes.within(normals, offsets))
    least = normals @ details.boxes.centres - np.abs(normals) @ details.boxes.halves
    np.testing.assert_array_equal(whole, (least >= offsets[:, None]).all(axis=0)[found])
    assert 100 < len(found) < 2900


def test_boxes_hold_their_pieces_and_know_their_distance():
    details = details_of(walks(10, 100))
    point = np.array([600.0, -20.0, 5.0])
    every = np.arange(len(details.owner))
    parts = details.lines(every, np.zeros_like(every)).split()
    distance = details.boxes.distance(point)
    for part, near in zip(parts, distance, strict=True):
        assert np.linalg.norm(part - point, axis=1).min() >= near - 1e-9
    low, high = np.array([[0.0], [0], [0]]), np.array([[2.0], [2], [2]])
    box = Boxes.around(low, high, np.array([0, 1]))
    assert box.distance(np.array([5.0, 6.0, 1.0]))[0] == pytest.approx(5.0)
    assert box.distance(np.array([1.0, 1.0, 1.0]))[0] == 0.0


def test_points_on_one_place_and_straight_lines_are_simplified_too():
    still = Polylines(np.zeros((3, 100)), np.array([0, 50, 100]), np.array([0, 1]))
    straight = Polylines(np.arange(300.0).reshape(3, 100), np.array([0, 100]), np.array([0]))
    for lines in (still, straight):
        details = details_of(lines)
        assert (details.count[1] == 2).all()
