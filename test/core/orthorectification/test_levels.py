"""Grey levels of a picture are matched to a mosaic, and errors of many do not add up."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.orthorectification.mosaic_tile import LevelMatch

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
