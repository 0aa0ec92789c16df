"""Polylines in one block: selecting, cutting, subdividing, against plain loops."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.map.polylines import Polylines

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
    got = lines.cut(enter, leave)
    wanted, owners = cut_by_loop(lines, enter, leave)
    assert got.owner.tolist() == owners
    assert len(got.split()) == len(wanted)
    for line, other in zip(got.split(), wanted, strict=True):
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
