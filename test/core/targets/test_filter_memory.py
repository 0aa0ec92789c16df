"""How long the filter's error on the ground lasts, against what the average of clicks assumes."""

from __future__ import annotations

import numpy as np
import pytest
from flights import config_for, errors, flight, solutions

from tirgeo_ros.core.targets.target import COMMON, MEMORY_S

STEP_S = 1.0
RAYS_N = np.array([[60.0, 0, 60.0], [0, 60.0, 60.0]])  # 45 deg down, from 60 m up


def ground_errors(seed):
    """The errors (4, N) of two ground points, north and east, each second of a flight."""
    flown = flight(seed, 200.0)
    found = errors(flown, solutions(flown, config_for(flown))).after(40.0)
    times_s = np.arange(41.0, 198.0, STEP_S)
    rows = []
    for ray_n in RAYS_N:
        ends_n = found.state[:, :3] - np.cross(found.state[:, 3:6], ray_n)
        on_ground_n = ends_n - ends_n[:, 2:] / ray_n[2] * ray_n
        rows += [np.interp(times_s, found.t_s, on_ground_n[:, axis]) for axis in (0, 1)]
    return np.array(rows)


@pytest.mark.slow
def test_the_filter_s_error_on_the_ground_lasts_no_longer_than_assumed():
    every = np.array([ground_errors(seed) for seed in (1, 2, 3, 4)])

    def correlation(lag_s):
        lag = round(lag_s / STEP_S)
        both = every[..., : every.shape[-1] - lag] * every[..., lag:]
        return float((both.mean((0, 2)) / np.square(every).mean((0, 2))).mean())

    found = {lag_s: correlation(lag_s) for lag_s in (8, 15, 30, 60)}
    # four flights of 160 s hold some 20 spans of half a minute: a correlation is known to 0.2
    for lag_s, share in found.items():
        assert share <= COMMON + (1 - COMMON) * np.exp(-lag_s / MEMORY_S), found
    assert found[8] > 0.4, found  # clicks in a row are not independent
