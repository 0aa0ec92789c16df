"""A camera's place and angles: against true north at the camera, with honest accuracies."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scenes import PLANE, camera_pose

from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    matrix_from_euler,
    matrix_from_quat,
    matrix_from_rotvec,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.camera_place import body_rpy, camera_place, height_above_m
from tirgeo_ros.core.types.poses import BodyPose

COVARIANCE = np.diag([0.01, 0.02, 0.03, 0.002, 0.003, 0.004]) ** 2
DOWN = camera_pose([0.0, 0, 0])
angles = st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-180, 180))


def place_at(attitude_deg, position_n=(0.0, 0, 0), plane=PLANE):
    return camera_place(camera_pose(position_n, *attitude_deg, COVARIANCE), plane)


@given(angles)
def test_both_sets_of_angles_give_the_attitude(attitude_deg):
    place = place_at(attitude_deg)
    assert_allclose(matrix_from_euler(*place.rpy) @ BODY_OPTICAL, place.rotation_lc, atol=1e-12)
    # Right in the picture is right of the nose, down is its back, forward is down.
    axes_l = matrix_from_euler(*place.mapping_rpy)
    as_optical = np.stack([axes_l[:, 1], -axes_l[:, 0], axes_l[:, 2]], axis=1)
    assert_allclose(as_optical, place.rotation_lc, atol=1e-12)


def test_angles_are_against_north_at_the_camera_not_at_the_origin():
    """75 km east of the origin, north has turned by the meridians' convergence."""
    plane = TangentPlane(math.radians(48.0), math.radians(16.0), 0.0)
    where = math.radians(48.0), math.radians(17.0), 500.0
    position_n = plane.ned_from_geodetic(*where)
    place = place_at((0, -90, 0), position_n, plane)
    # True north there points to the west of the plane's, by the longitude times sin(latitude).
    convergence = math.radians(1) * math.sin(where[0])
    assert place.mapping_rpy[2] == pytest.approx(convergence, abs=2e-5)
    assert_allclose([place.latitude_rad, place.longitude_rad], where[:2], atol=1e-12)
    assert place.height_m == pytest.approx(500, abs=1e-6)
    body = BodyPose(0, position_n, np.array([1.0, 0, 0, 0]), COVARIANCE)
    assert body_rpy(body, plane)[2] == pytest.approx(convergence, abs=2e-5)
    turn = plane.rotation_from_local(*where[:2])
    expected = np.sqrt(np.diag(turn.T @ COVARIANCE[:3, :3] @ turn))
    assert_allclose(place.position_sigmas_m, expected)
    assert_allclose(turn @ place.rotation_lc, matrix_from_quat(DOWN.q_nc), atol=1e-15)


def test_accuracies_are_the_spread_of_the_angles():
    """The sigmas against those of angles of attitudes that are turned by random errors."""
    place = place_at((8.0, -50.0, 130.0))
    spreads = place.covariance_l[3:, 3:]
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(3), spreads, 4000)
    turned = [
        dataclasses.replace(place, rotation_lc=matrix_from_rotvec(one) @ place.rotation_lc)
        for one in errors
    ]
    spread = np.std([one.mapping_rpy for one in turned], axis=0)
    # The standard deviation of 4000 samples is good to 1.1 %: four times that.
    assert_allclose(place.mapping_sigmas_rad, spread, rtol=0.045)


def test_a_level_camera_has_no_accuracy_of_yaw_and_roll_apart():
    assert np.isnan(place_at((0, 0, 0)).mapping_sigmas_rad).all()


def test_altitudes_are_above_the_sea_where_that_is_known():
    place = place_at((0, 0, 0), (0, 0, -30.0))
    assert place.altitude_m(math.nan) == place.height_m
    assert place.altitude_m(-9.0) == pytest.approx(41.5 + 9.0)


def test_without_a_ground_there_is_no_height_above_it():
    assert math.isnan(height_above_m(camera_pose([0, 0, -30.0]), PLANE, None))
    assert height_above_m(camera_pose([0, 0, -30.0]), PLANE, 1.5) == pytest.approx(40.0)
