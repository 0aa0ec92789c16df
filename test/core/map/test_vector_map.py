"""A map in the tangent plane: heights, closing of outlines, labels, boxes."""

import math

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.layers import GeoFeature, MapLayer
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.types.errors import ConfigError

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)


def feature(offsets_n, *, label="", closed=False, group=-1, height=True):
    points = np.column_stack(PLANE.geodetic_from_ned(np.asarray(offsets_n, float)))
    if not height:
        points[:, 2] = np.nan
    return GeoFeature(label, closed, points, group)


def laid(features, ground_height_m=math.nan):
    return VectorMap.from_layers([MapLayer("", features)], PLANE, ground_height_m)


SQUARE = [[0, 0, 0], [0, 10, 0], [10, 10, 0], [10, 0, 0]]


def test_points_come_back_where_they_were():
    rng = np.random.default_rng(1)
    offsets = [rng.uniform(-500, 500, (n, 3)) for n in (3, 2, 7)]
    got = laid([feature(o) for o in offsets])
    for line, wanted in zip(got.lines.split(), offsets, strict=True):
        np.testing.assert_allclose(line, wanted, atol=1e-7)  # 6.4e6 m in float64: 1e-9 m


def test_a_map_without_heights_needs_the_ground_height():
    features = [feature(SQUARE), feature(SQUARE, height=False)]
    with pytest.raises(ConfigError, match=r"1 of 2 features.*ground_height_m \(--ground-height\)"):
        laid(features)


def test_parts_of_a_group_share_one_label():
    features = [
        feature(SQUARE, label="Beet", group=4),
        feature(SQUARE, group=4),
        feature(SQUARE, label="Beet"),
        feature(SQUARE, label="Beet"),
        feature([[0, 0, 0]], label="Beet", group=4),
    ]
    got = laid(features)
    assert got.labels == ("Beet", "Beet", "Beet")
    assert got.lines.owner.tolist() == [0, 0, 1, 2]
    assert got.marks.owner.tolist() == [0]
