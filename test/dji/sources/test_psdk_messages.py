"""Each trap of psdk_ros2's topics with numbers worked by hand, and there and back."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.axes import ENU_NED, FLU_FRD
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_from_matrix,
    quat_from_rotvec,
)
from tirgeo_ros.dji.sources import psdk_messages as psdk

#: A handful of products of numbers of order one.
ROUNDING = 2e-15
LEVEL_EAST = (1.0, 0.0, 0.0, 0.0)  # FLU to ENU: the nose points east


def single(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


PI32 = single(math.pi)
angles = st.floats(-179.99, 179.99)


@given(st.integers(-(2**15), 2**15 - 1))
def test_every_rtk_yaw_comes_back(yaw_deg):
    (sent,) = struct.unpack("<H", struct.pack("<h", yaw_deg))
    assert psdk.baseline_yaw_deg(sent) == yaw_deg


@pytest.mark.parametrize(
    ("sent", "roll", "pitch", "yaw"),
    [
        # Level, to the north: z = 1.571 - 0.
        ((0.0, 0.0, 1.571), 0.0, 0.0, 0.0),
        # To the east, 90 deg: z = 1.571 - pi / 2 = 0.000204.
        ((0.0, 0.0, 1.571 - math.pi / 2), 0.0, 0.0, math.pi / 2),
        # Straight down, to the west: y = + pi / 2, z = 1.571 + pi / 2 wraps nowhere.
        ((0.0, math.pi / 2, 1.571 + math.pi / 2), 0.0, -math.pi / 2, -math.pi / 2),
        # South-west, -135 deg: 1.571 + 2.356 = 3.927 is sent as 3.927 - 2 pi = -2.356.
        ((0.1, -0.2, 1.571 + 0.75 * math.pi - math.tau), 0.1, 0.2, -0.75 * math.pi),
    ],
)
def test_gimbal_angles(sent, roll, pitch, yaw):
    reading = psdk.gimbal(7, sent)
    assert reading == (7, roll, pitch, pytest.approx(yaw, abs=ROUNDING))


@given(angles, st.floats(-120, 60), st.floats(-30, 30))
def test_gimbal_there_and_back(yaw_deg, pitch_deg, roll_deg):
    """As psdk_ros2 makes them: with constants of single precision, turned by one round."""
    z = single(1.571) - yaw_deg * PI32 / 180
    if z < -PI32:
        z += 2 * PI32
    elif z > PI32:
        z -= 2 * PI32
    made = psdk.gimbal(7, (roll_deg * PI32 / 180, -pitch_deg * PI32 / 180, z))
    # Its pi is 8.7e-8 too large, 1.571 is 2.4e-8 off: of angles up to a turn, less than 3e-7.
    assert made.roll_rad == pytest.approx(math.radians(roll_deg), abs=3e-7)
    assert made.pitch_rad == pytest.approx(math.radians(pitch_deg), abs=3e-7)
    assert math.remainder(made.yaw_rad - math.radians(yaw_deg), math.tau) == pytest.approx(
        0.0, abs=3e-7
    )
    assert -math.pi <= made.yaw_rad < math.pi


@given(st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array))
def test_attitude_there_and_back(rotvec):
    """R_ENU<-NED R R_FRD<-FLU is sent; q and -q are the same attitude."""
    matrix = matrix_from_quat(quat_from_rotvec(rotvec))
    sent = quat_from_matrix(ENU_NED @ matrix @ FLU_FRD)
    for sign in (1, -1):
        made = psdk.attitude(7, tuple((sign * sent).tolist()))
        back = matrix_from_quat(np.array(made.q_nb))
        # A quaternion from a matrix and back.
        np.testing.assert_allclose(back, matrix, atol=10 * ROUNDING)


@given(
    st.lists(st.floats(-4, 4), min_size=3, max_size=3),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
def test_imu_there_and_back(acceleration_g, rate):
    """Made of a hard-sync sample: FRD, g, rad/s."""
    signs = (1, -1, -1)
    force = tuple(s * a * single(9.8) for s, a in zip(signs, acceleration_g, strict=True))
    turned = tuple(s * r for s, r in zip(signs, rate, strict=True))
    made = psdk.imu(7, LEVEL_EAST, turned, force)
    # Its 9.8 has single precision: relatively 2e-8.
    assert made.acceleration_b == pytest.approx(acceleration_g, rel=3e-8)
    assert made.angular_rate_b == tuple(rate)


def test_the_fused_position_is_made_with_another_pi():
    """Uncorrected it is 2.8e-8 of 52 deg off: 0.16 m in latitude."""
    latitude, longitude = math.radians(52.0), math.radians(120.0)
    sent = (latitude * 180 / PI32, longitude * 180 / PI32, 30.0)
    off_m = (math.radians(sent[0]) - latitude) * 6.37e6
    assert off_m == pytest.approx(-0.16, abs=0.005)
    made = psdk.fused_position(7, sent)
    assert made.place == pytest.approx((latitude, longitude, 30.0), rel=ROUNDING)
    assert made.vertical_sigma_m > 100  # the height is not known to be of any kind


def test_the_velocity_that_is_what_its_frame_says():
    """East 1, north 2, up 3."""
    fused = psdk.READERS["velocity_ground_fused"](7, (1.0, 2.0, 3.0))
    assert fused.velocity_n == (2.0, 1.0, -3.0)


def test_accuracies_are_millimetres_and_centimetres_a_second():
    made = psdk.gps_details(7, 3.0, (1500.0, 2500.0, 40.0))
    assert made.fix == 3
    assert (made.horizontal_sigma_m, made.vertical_sigma_m) == (1.5, 2.5)
    assert made.velocity_sigma_m_s == pytest.approx(0.4, rel=ROUNDING)
    assert made.place is None
    assert made.velocity_n is None


@pytest.mark.parametrize("fix", [math.nan, math.inf])
def test_a_fix_that_is_no_number_is_none(fix):
    assert psdk.gps_details(7, fix, (1.0, 1.0, 1.0)).fix == 0
