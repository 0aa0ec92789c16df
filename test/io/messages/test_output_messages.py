"""Poses, located points and diagnostics to messages and back."""

from __future__ import annotations

import dataclasses
import math

import message_samples as given
import numpy as np
import pytest
from message_round_trips import made, through_cdr
from numpy.testing import assert_allclose, assert_array_equal

from tirgeo_ros.core.frames import axes as frames
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    matrix_from_rotvec,
)
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import (
    Source,
)
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io import messages
from tirgeo_ros.io.messages.encode import UNKNOWN_VARIANCE


def test_twist_is_in_the_body():
    message = made.odometry(given.SOLUTION, given.BODY)
    forward_right_down = matrix_from_quat(given.SOLUTION.q_nb).T @ given.SOLUTION.velocity_n
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    wanted = forward_right_down * [1, -1, -1]
    assert_allclose([linear.x, linear.y, linear.z], wanted, rtol=1e-13)
    assert_array_equal(
        [angular.x, angular.y, angular.z], given.SOLUTION.angular_rate_b * [1, -1, -1]
    )


def body_velocity_flu(error, solution=given.SOLUTION):
    """Body velocity of a state that is off by (attitude phi_n, velocity) of (6,)."""
    rotation = matrix_from_rotvec(error[:3]) @ matrix_from_quat(solution.q_nb)
    return frames.FLU_FRD @ rotation.T @ (solution.velocity_n + error[3:])


def test_twist_covariance_is_that_of_the_solution_in_the_body():
    step = 1e-6
    partials = np.column_stack(
        [
            (body_velocity_flu(step * axis) - body_velocity_flu(-step * axis)) / (2 * step)
            for axis in np.eye(6)
        ]
    )
    wanted = partials @ given.SOLUTION.covariance[3:, 3:] @ partials.T
    message = made.odometry(given.SOLUTION, given.BODY)
    covariance = message.twist.covariance.reshape(6, 6)
    # Central differences with steps of 1e-6: rounding 1e-16 / 1e-6 times entries of order 10.
    assert_allclose(covariance[:3, :3], wanted, rtol=1e-8, atol=1e-8)
    assert_array_equal(covariance[3:, 3:], np.diag(given.SOLUTION.rate_variance_b))
    assert not covariance[:3, 3:].any()


@pytest.mark.parametrize("height_m", [math.inf, math.nan, 1e200])
def test_an_origin_that_is_no_place_is_refused(height_m):
    message = made.origin(dataclasses.replace(given.PLANE, height_m=height_m), 7)
    with pytest.raises(MessageError, match=r"^tirgeo/origin: .*(not finite|out of range)"):
        messages.tangent_plane(message)


@pytest.mark.parametrize(("space", "aircraft"), [("/", "aircraft"), ("/a/uav1/", "a/uav1")])
def test_a_diagnostic_names_its_aircraft(space, aircraft):
    items = [messages.DiagnosticItem(f"{space}ekf_node: a/b: c", 0, "")]
    assert made.diagnostics(0, items).status[0].hardware_id == aircraft


def test_navigation_status_round_trip():
    item = messages.navigation_item("ekf_node: state", given.STATUS)
    (message,) = through_cdr(made.diagnostics(0, [item])).status
    status = messages.navigation_status(message)
    assert status.heading_sigma_rad == pytest.approx(given.STATUS.heading_sigma_rad, rel=1e-15)
    given_sigma = dataclasses.replace(status, heading_sigma_rad=given.STATUS.heading_sigma_rad)
    assert given_sigma == given.STATUS
    assert (message.level, message.message) == (1, "aligning: too slow")


def test_a_warning_while_running_is_the_message():
    status = dataclasses.replace(given.STATUS, state=FilterState.RUNNING, reason="")
    item = messages.navigation_item("n", status)
    assert item.level == 1
    assert item.message == "running: imu/data: accelerometer x clipped; another"
    assert item.values["clipped.accelerometer x"] == "12"
    lost = dataclasses.replace(status, state=FilterState.LOST, reason="far off")
    assert messages.navigation_item("n", lost).level == 2
    assert messages.navigation_item("n", lost).message == "lost: far off"


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (FilterState.RUNNING, 0),
        (FilterState.WAITING, 1),
        (FilterState.ALIGNING, 1),
        (FilterState.DEGRADED, 1),
        (FilterState.DEAD_RECKONING, 1),
        (FilterState.LOST, 2),
    ],
)
def test_every_state_has_its_level_and_comes_back(state, level):
    given_status = dataclasses.replace(given.STATUS, state=state, reason="", warnings=())
    item = messages.navigation_item("n", given_status)
    assert (item.level, item.message) == (level, state.value)
    (message,) = through_cdr(made.diagnostics(0, [item])).status
    assert messages.navigation_status(message).state is state


def test_a_recording_without_time_and_resets_is_read():
    item = messages.navigation_item("n", given.STATUS)
    new = {"state_time_s", "last_reset", "reset.rtk_position", "reset.rtk_heading"}
    new |= {"clipped.accelerometer x", "warnings"}
    assert new <= item.values.keys()
    old = {key: value for key, value in item.values.items() if key not in new}
    (message,) = made.diagnostics(0, [messages.DiagnosticItem("n", 1, "", old)]).status
    status = messages.navigation_status(message)
    assert (status.state_s, status.resets, status.last_reset) == (0.0, {}, "")
    assert (status.clipped, status.warnings) == ({}, ())
    assert status.counts == given.STATUS.counts


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("state", "dreaming"),
        ("heading_sigma_deg", "wide"),
        ("method", None),
        ("state_time_s", "long"),
    ],
)
def test_other_diagnostics_are_no_navigation_status(key, value):
    item = messages.navigation_item("other", given.STATUS)
    values = {k: (value if k == key else v) for k, v in item.values.items()}
    values = {k: v for k, v in values.items() if v is not None}
    changed = messages.DiagnosticItem("other", 0, "", values)
    (message,) = made.diagnostics(0, [changed]).status
    with pytest.raises(MessageError, match="'other' is no navigation status"):
        messages.navigation_status(message)


# tirgeo/locate


COVARIANCE = given.covariance(3)
LOCATED = Located(
    given.STAMP_NS, (3.0, 4.0), np.array([1.0, 2.0, 3.0]), COVARIANCE, 0.55, -2.1, 123.4
)


def test_the_fix_is_the_place_with_its_covariance_in_enu():
    fix = through_cdr(made.located_fix(LOCATED))
    assert messages.stamp_ns(fix) == given.STAMP_NS
    assert fix.header.frame_id == "map"
    assert_allclose(
        [fix.latitude, fix.longitude, fix.altitude],
        [math.degrees(0.55), math.degrees(-2.1), 123.4],
    )
    covariance = fix.position_covariance.reshape(3, 3)
    assert fix.position_covariance_type == 3
    assert (covariance[0, 0], covariance[1, 1]) == (COVARIANCE[1, 1], COVARIANCE[0, 0])
    assert covariance[0, 2] == -COVARIANCE[1, 2]
    back = messages.position_sample(fix, Source.RTK_POSITION)
    assert_array_equal(back.covariance_n, COVARIANCE)


def test_the_point_is_in_the_map_and_has_no_attitude():
    point = through_cdr(made.located_point(LOCATED))
    assert point.header.frame_id == "map"
    position = point.pose.pose.position
    assert (position.x, position.y, position.z) == (2.0, 1.0, -3.0)
    q = point.pose.pose.orientation
    assert (q.w, q.x, q.y, q.z) == (1.0, 0.0, 0.0, 0.0)
    covariance = point.pose.covariance.reshape(6, 6)
    assert covariance.diagonal()[3:].tolist() == [UNKNOWN_VARIANCE] * 3
    stamp_ns, point_n, covariance_n = messages.ground_point(point)
    assert stamp_ns == given.STAMP_NS
    assert_array_equal(point_n, LOCATED.point_n)
    assert_array_equal(covariance_n, COVARIANCE)


def test_a_clicked_pixel_comes_back():
    clicked = (given.STAMP_NS, 12.5, 7.25)
    assert messages.pixel(through_cdr(made.pixel(*clicked))) == clicked
