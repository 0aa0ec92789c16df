"""The markers of targets, as RViz shows them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

pytest.importorskip("visualization_msgs.msg", reason="needs ROS 2 or its wheels")

from message_samples import LOCATED, PLANE, TARGET
from visualization_msgs.msg import Marker

from tirgeo_ros.core.camera.projection_covariance import ellipse_95
from tirgeo_ros.core.ground.ground_point import enu_of
from tirgeo_ros.nodes.aircraft_view import target_markers


def test_the_first_marker_deletes_all_others():
    assert [one.action for one in target_markers("map", PLANE, []).markers] == [Marker.DELETEALL]
    delete, shape, label = target_markers("uav1/map", PLANE, [TARGET]).markers
    assert (delete.action, shape.action, label.text) == (3, Marker.ADD, "1 fire: barn")
    assert {one.header.frame_id for one in (delete, shape, label)} == {"uav1/map"}
    place = TARGET.place
    north, east, down = PLANE.ned_from_geodetic(
        place.latitude_rad, place.longitude_rad, place.height_m
    )
    point = shape.pose.position
    np.testing.assert_allclose([point.x, point.y, point.z], [east, north, -down], rtol=1e-12)
    assert label.pose.position.z == pytest.approx(point.z + 1.0)


def test_the_marker_is_the_95_percent_ellipsoid():
    """A viewer in ``map`` sees its greatest breadth where the covariance has its own."""
    level = dataclasses.replace(LOCATED, covariance_enu=enu_of(np.diag([4.0, 1.0, 0.01])))
    target = dataclasses.replace(TARGET, clicks=(level,), name="x" * 1000)
    _, shape, label = target_markers("map", PLANE, [target]).markers
    semi_axes, _ = ellipse_95(np.diag([4.0, 1.0]))
    breadths = sorted([shape.scale.x, shape.scale.y, shape.scale.z])
    np.testing.assert_allclose(breadths[:0:-1], 2 * semi_axes[0], rtol=1e-12)
    assert len(label.text) == 60
