"""What make bench says of clicks: whole ones, on both kinds of ground."""

from __future__ import annotations

import numpy as np
import pytest

from dev import bench, bench_clicks


@pytest.mark.slow
def test_a_thousand_whole_clicks_a_second_on_both_grounds(monkeypatch):
    monkeypatch.setattr(bench_clicks, "_CLICKS", 20)  # short rounds find a quiet moment
    monkeypatch.setattr(bench_clicks, "_ROUNDS", 40)
    level, model = bench_clicks.click_speeds()
    assert (level.what, model.what) == ("level ground", "a DEM of 1 m")
    for one in (level, model):
        # the figure required; a click is a ray and more
        assert 1000 < one.clicks_a_second < one.rays_a_second


def test_the_hills_are_those_that_are_said():
    hills = bench_clicks.hills()
    plane = bench_clicks.PLANE
    assert 15.9 < hills.highest_m - hills.lowest_m <= 16
    assert np.isfinite(hills.height_m(plane.latitude_rad, plane.longitude_rad))


def test_the_table_has_them(monkeypatch):
    speeds = [bench_clicks.ClickSpeeds("hills", 2000.0, 3000.0)]
    monkeypatch.setattr(bench, "click_speeds", lambda: iter(speeds))
    rate, rays, ratio = bench._click_speed()
    assert (rate.what, rate.value, rate.wanted) == ("clicks on hills", 2000.0, ">= 1000")
    assert (rays.value, ratio.value) == (3000.0, 1.5)
