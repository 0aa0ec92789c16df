"""The outlines of the sample's map lie on its mosaic."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.types.arrays import Array

pytest.importorskip("rasterio")

from dev.mosaic_outlines import FINE_M, REACH_M, edge_m, edges, mosaics


def profile(at_m: float, second_m: float | None = None) -> Array:
    """A smooth rise by 60 grey levels at a place of the profile, and perhaps one by 50."""
    across = np.arange(-REACH_M, REACH_M + FINE_M / 2, FINE_M)
    grey = 80 + 60 / (1 + np.exp(-(across - at_m) / 0.05))
    return grey if second_m is None else grey + 50 / (1 + np.exp(-(across - second_m) / 0.05))


def test_the_edge_is_found_where_it_is():
    places = np.array([-0.6, -0.1, 0.0, 0.314, 0.7])
    found = edge_m(np.stack([profile(place) for place in places]))
    assert found == pytest.approx(places, abs=FINE_M)
    flat, twofold = np.full(len(profile(0)), 90.0), profile(-0.4, 0.4)
    assert np.isnan(edge_m(np.stack([flat, twofold]))).all()


@pytest.mark.slow
def test_outlines_lie_on_the_mosaic(sample, tmp_path):
    """With the filter's poses within 0.25 m rms; with the true ones the measurement is left."""
    made = mosaics(sample, tmp_path)
    found, true = (edges(made[name], sample / "map.geojson") for name in ("filter", "truth"))
    for one in (found, true):
        assert one.places > 4000
        assert len(one.offsets_m) > 0.85 * one.cold > 2000  # nearly all, so not the best alone
    assert found.rms_m < 0.25
    assert abs(found.offsets_m.mean()) < 0.05  # outlines shrink or grow by nothing
    # A pixel is 0.05 m; the picture's own are 0.03 to 0.2 m there.
    assert true.rms_m < 0.06
