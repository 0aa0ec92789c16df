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
"""The distance and direction of a map, and the likely mistake if it is far away."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from overlays import PLANE, geo

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.vector_map import GeoFeature, MapLayer
from tirgeo_ros.core.map.visibility import likely_mistake, nearest_feature
from tirgeo_ros.core.overlay.map_shapes import drape_layers

HERE = TangentPlane(math.radians(48.1), math.radians(11.5), 500.0)  # UTM zone 32


def map_of(*features):
    return drape_layers([MapLayer("m", features)], PLANE, 25.0).map


def nearest_of_all(features_n, at):
    """Computed independently of the code: points a decimetre apart along every line."""
    best = math.inf
    for points in features_n:
        dense = [points[:1]]
        for a, b in itertools.pairwise(points):
            count = max(int(np.linalg.norm(b - a) * 10), 2)
            dense.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
        best = min(best, np.hypot(*(np.concatenate(dense) - at)[:, :2].T).min())
    return best


def test_the_nearest_feature_of_a_large_map():
    """Lines of all lengths and points, 60 pieces and more; from inside and from beside."""
    rng = np.random.default_rng(3)
    features_n = []
    for _number in range(80):
        steps = rng.normal(0, 30, (int(rng.integers(1, 4)), 3)) * [1, 1, 0]
        middle = np.append(rng.uniform(300, 3000, 2), 0.0)
        features_n.append(middle + np.cumsum(steps, axis=0))
    observed = map_of(*(GeoFeature("", False, geo(p).points) for p in features_n))
    for at in ([0.0, 0, -60], [1500, 1500, -60], [3000, -200, -120], [-5000, 900, -20]):
        result = nearest_feature(observed, np.array(at))
        # the Earth bends by 2 m at 5 km, the dense points are 10 cm apart
        assert result.distance_m == pytest.approx(
            nearest_of_all(features_n, np.array(at)), abs=0.1
        )


def test_a_map_90_degrees_away_is_10_000_km_away():
    """Along the Earth, not through it; a sphere of the equator's radius is wrong by 0.5 %."""
    south_rad = HERE.latitude_rad - math.pi / 2
    point = GeoFeature("", False, np.array([[south_rad, HERE.longitude_rad, 0.0]]))
    draped = drape_layers([MapLayer("m", [point])], HERE, 0.0)
    result = nearest_feature(draped.map, np.zeros(3))
    assert nearest_feature(map_of(), np.zeros(3)) is None
    assert result.distance_m == pytest.approx(10_002_000, rel=5e-3)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "question"),
    [
        (11.5, 48.1, "are latitude and longitude swapped?"),
        (48.1, -11.5, "is the sign of longitude wrong?"),
        (-48.1, 11.5, "is the sign of latitude wrong?"),
        (48.15, 17.4, "is it UTM zone 32 instead of 33?"),
        (48.05, 5.5, "is it UTM zone 32 instead of 31?"),
        (48.1, -0.5, "is it UTM zone 32 instead of 30?"),
        (0.003, 0.001, "are its coordinates metres of a local system?"),
        (52.0, 13.4, ""),
        (48.1, 14.5, ""),  # half a zone away is no zone
    ],
)
def test_the_likely_mistake_of_a_map_far_away(latitude_deg, longitude_deg, question):
    place_n = HERE.ned_from_geodetic(*np.radians([latitude_deg, longitude_deg]), 0.0)
    assert likely_mistake(HERE, place_n) == question
