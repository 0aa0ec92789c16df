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
"""Anywhere on Earth: over the antimeridian, near the poles, below the ellipsoid."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, errors, navigation_samples, solutions

from tirgeo_ros.core.types.measurements import PositionSample
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

#: Latitude, longitude (deg) and the ground's height (m); first heading (deg), in which 42 m are
#: flown 20 m above the ground, then 15 m across and the way back.
PLACES = {
    "antimeridian, eastwards": (-17.0, 179.9999, 5.0, 90.0),  # 11 m before it
    "antimeridian, westwards": (52.0, -179.9998, 40.0, 270.0),  # 14 m
    "south": (-45.0, 170.5, 300.0, 90.0),
    "latitude and longitude zero": (-0.0001, -0.0001, 10.0, 45.0),  # 11 m before both
    "80 north": (80.0, 20.0, 100.0, 90.0),
    "80 south": (-80.0, -60.0, 2500.0, 90.0),
    "below the ellipsoid": (31.5, 35.5, -400.0, 90.0),
}
SETTLED_S = 15.0


@functools.lru_cache(maxsize=16)
def flown_at(place):
    latitude_deg, longitude_deg, height_m, heading_deg = place
    values = {
        "site.latitude_deg": latitude_deg,
        "site.longitude_deg": longitude_deg,
        "site.ground_height_m": height_m,
        "route.heading_deg": heading_deg,
        "duration_s": 40.0,
    }
    return fly(scenario_from(values), 8)


def config_at(place, **values):
    return config_for(flown_at(place), origin_lat_lon_h=place[:3], **values)


@functools.lru_cache(maxsize=16)
def solutions_at(place):
    return solutions(flown_at(place), config_at(place))


def errors_at(place):
    return errors(flown_at(place), solutions_at(place)).after(SETTLED_S)


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_errors_are_small(place):
    """The limits are those that the filter keeps after a fault."""
    late = errors_at(place)
    assert max(abs(s.longitude_rad) for s in solutions_at(place)) <= math.pi
    assert np.abs(np.degrees(late.rpy)).max() < 0.3
    assert np.abs(late.state[:, :3]).max() < 0.05


def test_longitudes_beyond_180_degrees_are_the_same_places():
    """Some receivers give longitudes from 0 to 360 degrees."""
    place = PLACES["antimeridian, eastwards"]
    flown = flown_at(place)
    moved = [
        replace(s, longitude_rad=s.longitude_rad % (2 * math.pi))
        if isinstance(s, PositionSample)
        else s
        for s in navigation_samples(flown)
    ]
    result = solutions(flown, config_at(place), moved)
    late = errors(flown, result).after(SETTLED_S)
    # 2 pi has the rounding of a double: 1e-15 rad are 6 nm.
    np.testing.assert_allclose(late.state, errors_at(place).state, atol=1e-6)
