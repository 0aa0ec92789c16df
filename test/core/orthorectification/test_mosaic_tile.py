"""The mosaic of a tile: best view on top, feathered, in any order, grey levels matched to it."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.orthorectification.ground_tiles import TILE_PX
from tirgeo_ros.core.orthorectification.orthophoto import LevelMatch, MosaicTile, Patch

WHOLE = slice(0, TILE_PX)


def patch_of(value, score, rows=WHOLE, columns=WHOLE):
    shape = rows.stop - rows.start, columns.stop - columns.start
    scores = np.broadcast_to(np.asarray(score, np.float32), shape).copy()
    values = np.broadcast_to(np.asarray(value), shape).astype(np.uint16)
    return Patch(rows, columns, values, np.isfinite(scores), scores)


@pytest.fixture
def patches():
    """Two views whose scores cross in the middle column, and a third over a corner."""
    across = np.linspace(0.5, 1.5, TILE_PX)
    corner = slice(0, 100), slice(0, 50)
    return [patch_of(100, across), patch_of(200, across[::-1]), patch_of(900, 0.2, *corner)]


@pytest.mark.parametrize("hard", [False, True], ids=["feathered", "hard"])
def test_the_order_does_not_matter(patches, hard):
    tiles = [MosaicTile.empty(1), MosaicTile.empty(1)]
    for tile, order in zip(tiles, ([0, 1, 2], [2, 1, 0]), strict=True):
        for number in order:
            tile.add(patches[number], hard=hard)
    # Single precision, and a handful of sums: 1e-6 of the value.
    np.testing.assert_allclose(tiles[0].values()[0], tiles[1].values()[0], rtol=3e-6)


def test_the_best_view_is_on_top_and_the_seam_is_feathered(patches):
    tile = MosaicTile.empty(1)
    for patch in patches:
        tile.add(patch)
    values, seen = tile.values()
    assert seen.all()
    row = values[300, :, 0]
    assert row[:200] == pytest.approx(100, abs=0.1)
    assert row[-200:] == pytest.approx(200, abs=0.1)
    assert np.diff(row).min() > -1e-4  # rounding
    assert np.diff(row).max() < 10  # a hard seam were 100
    assert row[TILE_PX // 2 - 1 : TILE_PX // 2 + 1].mean() == pytest.approx(150, abs=0.5)
    # A view 10 % worse has 1.1^-32 = 5 % of the weight.
    worse = int(np.searchsorted(np.linspace(0.5, 1.5, TILE_PX), 1.0 - 0.5 / 10.5))
    assert row[worse] == pytest.approx(100 + 100 * 0.045, abs=1)
    assert values[50, 20, 0] == pytest.approx(900)


def test_hard_values_are_those_of_the_best_view(patches):
    tile = MosaicTile.empty(1)
    for patch in patches:
        tile.add(patch, hard=True)
    values, _ = tile.values()
    assert set(np.unique(values)) == {100.0, 200.0, 900.0}
    assert (values[300, : TILE_PX // 2, 0] == 100).all()
    assert (values[:100, :50] == 900).all()


def test_what_nobody_sees_is_unknown():
    tile = MosaicTile.empty(3)
    values, seen = tile.values()
    assert not seen.any()
    assert np.isfinite(values).all()
    part = patch_of(7, 1.0, slice(10, 20), slice(30, 50))
    tile.add(part._replace(values=np.dstack([part.values] * 3)))
    values, seen = tile.values()
    assert seen.sum() == 200
    assert (values[seen] == 7).all()


GROUND = np.random.default_rng(4).normal(100.0, 20.0, 50_000)


def matched(picture, mosaic):
    match = LevelMatch()
    for part in (slice(0, 20_000), slice(20_000, None)):
        match.add(picture[part], mosaic[part])
    return match.matched(picture)


def test_nine_tenths_of_the_way():
    found = matched(1.5 * GROUND - 30.0, GROUND)
    assert found.dtype == np.float32
    # The mean is off by 20 and the contrast by 1.5: a tenth of both is left.
    assert found.mean() - GROUND.mean() == pytest.approx(
        0.1 * (0.5 * GROUND.mean() - 30), abs=0.02
    )
    assert found.std() / GROUND.std() == pytest.approx(1.5**0.1, rel=1e-4)


def test_what_cannot_be_matched_is_left():
    same = np.full(2000, 7.0)
    np.testing.assert_array_equal(LevelMatch().matched(same), same)  # nothing in common
    np.testing.assert_array_equal(
        matched(GROUND[:900], GROUND[:900] + 9), GROUND[:900].astype("f4")
    )
    assert matched(same, GROUND[:2000]) == pytest.approx(7 + 0.9 * (GROUND[:2000].mean() - 7))
    assert matched(GROUND, same.repeat(25)).std() == pytest.approx(GROUND.std(), rel=1e-4)


def test_errors_do_not_add_up():
    """A thousand pictures, each with noise that the mosaic does not have: contrast stays."""
    rng, mosaic = np.random.default_rng(5), GROUND[:5000]
    for _ in range(1000):
        match = LevelMatch()
        match.add(GROUND[:5000] + rng.normal(0.0, 3.0, 5000), mosaic)
        mosaic = match.matched(GROUND[:5000])
    # The noise adds 1.1 % to the picture's sigma: nine tenths of it, ten times over.
    assert mosaic.std() / GROUND[:5000].std() == pytest.approx(1.011**-9, rel=0.03)
