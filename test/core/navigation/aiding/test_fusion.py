"""Fusion of single samples: median, gate, floors, and what the receivers' errors take."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from filter_states import MEASURED, NOW_NS, belief_of, state_of
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import innovation_n
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate, floored
from tirgeo_ros.core.navigation.ins_error_model import states_of
from tirgeo_ros.core.navigation.strapdown import NavState, matrix, rotate
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome

LEVER_B = np.array([0.3, -0.4, -0.5])
ANTENNA_M = (0.3, 0.4, 0.5)
ARMS = {"aircraft.rtk_antenna_m": ANTENNA_M, "aircraft.gps_antenna_m": ANTENNA_M}


def config_of(**values) -> EkfConfig:
    given_ = {key.replace("__", "."): value for key, value in values.items()}
    return config_from(EkfConfig, ARMS | given_)


def position_of(state: NavState, shift_n: np.ndarray, source=Source.RTK_POSITION):
    """The antenna's true place for a state, moved by a few metres."""
    plane = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)
    place = matrix(rotation_of(state.q_nb)) @ LEVER_B + shift_n
    lat, lon, height = (float(x) for x in plane.geodetic_from_ned(place))
    return PositionSample(NOW_NS, source, FixStatus.FIXED, lat, lon, height, np.eye(3))


def fused_position(config: dict, shift: np.ndarray, offsets: tuple = ()):
    state = state_of(0.0, 0.0, 0.0)
    belief = belief_of(state, covariance=0.01 * np.eye(18))
    belief = belief._replace(control=belief.control._replace(offsets_n=offsets))
    sample = position_of(state, shift)
    return belief, Fusion(config_of(**config)).fuse(sample, belief, (0.0,) * 3)


def left_of(belief: StateEstimate, shift: np.ndarray, attitude: NavState) -> np.ndarray:
    """What the shifted position leaves, with the attitude of another state."""
    lever_n = rotate(rotation_of(attitude.q_nb), tuple(LEVER_B))
    return np.array(innovation_n(belief.state, position_of(attitude, shift), lever_n))


def test_direct_position_is_the_rtk_position():
    """Section 3.3: after the cycle the antenna stands where RTK says, whatever the gain."""
    shift = np.array([0.1, -0.2, 0.3])
    before, fused = fused_position({"position_update": "rtk_direct"}, shift)
    assert fused.verdict.used
    assert left_of(fused.belief, shift, before.state) == pytest.approx(np.zeros(3), abs=2e-6)
    turned = rotate(rotation_of(fused.belief.state.q_nb), tuple(LEVER_B))
    moved_m = innovation_n(fused.belief.state, position_of(before.state, shift), turned)
    assert np.abs(moved_m).max() < 0.1  # the lever arm turned with the attitude that was kept


def test_median_filter_ignores_one_jump():
    """Window of three: the middle of two good offsets and the jump is a good one."""
    good = ((0.01, 0.0, -0.01), (-0.01, 0.01, 0.0))
    shift = np.array([0.0, 5.0, 0.0])
    _, fused = fused_position({"rtk__median_window": 3}, shift, good)
    assert fused.verdict.used
    assert fused.verdict.innovation == pytest.approx((0.0, 0.01, 0.0), abs=2e-6)
    assert fused.belief.control.offsets_n[:2] == good
    assert fused.belief.control.offsets_n[2] == pytest.approx(shift, abs=2e-6)


def test_median_window_has_its_length():
    good = ((0.01, 0.0, -0.01), (-0.01, 0.01, 0.0), (0.0, 0.0, 0.0))
    _, fused = fused_position({"rtk__median_window": 3}, np.zeros(3), good)
    assert len(fused.belief.control.offsets_n) == 3
    assert fused.belief.control.offsets_n[:2] == good[1:]


def test_gate_refuses_a_jump_and_leaves_the_state():
    before, fused = fused_position({}, np.array([0.0, 8.0, 0.0]))  # 8 sigma
    assert fused.verdict.outcome is Outcome.GATED
    assert fused.verdict.test_ratio > 1
    assert fused.belief.state is before.state
    assert fused.belief.covariance is before.covariance


def test_velocity_enters_with_its_floor():
    state = state_of(0.0, 0.0, 0.0)
    sample = VelocitySample(
        NOW_NS, Source.RTK_VELOCITY, np.array([3.5, -1.0, 0.2]), np.zeros((3, 3))
    )
    covariance = np.diag(np.r_[np.zeros(3), np.full(3, 4e-4), np.zeros(12)])
    fusion = Fusion(MEASURED)
    fused = fusion.fuse(sample, belief_of(state, covariance=covariance), (0.0,) * 3)
    # Variance 0.02^2 against the floor 0.02^2: half of the 0.5 m/s, but that is 17 sigma: refused.
    assert fused.verdict.outcome is Outcome.GATED
    near = state._replace(velocity_n=(3.45, -1.0, 0.2))
    fused = fusion.fuse(sample, belief_of(near, covariance=covariance), (0.0,) * 3)
    assert fused.belief.state.velocity_n[0] == pytest.approx(3.475, abs=1e-9)


def test_gps_error_takes_what_the_state_does_not():
    """Where the position is known, a GPS position says what the receiver is off."""
    covariance = np.diag(np.r_[np.zeros(6), np.full(3, 1e-4), np.zeros(6), np.full(3, 4.0)])
    belief = belief_of(state_of(0.0, 0.0, 0.0), covariance=covariance)
    config = config_of(gps__position_noise_m=0.05)
    sample = position_of(belief.state, np.array([1.0, -2.0, 3.0]), Source.GPS_POSITION)
    sample = replace(sample, covariance_n=np.zeros((3, 3)))
    fused = Fusion(config).fuse(sample, belief, (0.0,) * 3)
    assert fused.verdict.used
    # Shares of the innovation: 4 and 1e-4 of 4 + 1e-4 + 0.05^2.
    total = 4 + 1e-4 + 0.05**2
    learned = np.array([1.0, -2.0, 3.0]) * 4 / total
    assert fused.belief.control.receivers.gps_error_n == pytest.approx(learned, abs=2e-6)
    shift = np.subtract(fused.belief.state.correction_n, belief.state.correction_n)
    assert shift == pytest.approx(np.array([1.0, -2.0, 3.0]) * 1e-4 / total, abs=2e-9)


def test_heading_error_is_learned_only_where_there_is_such_a_state():
    for sigma_deg, states in ((0.0, 18), (2.0, 19)):
        config = config_of(heading__bias_sigma_deg=sigma_deg)
        assert states_of(config) == states
        covariance = np.zeros((states, states))
        covariance[2, 2] = math.radians(1.0) ** 2
        if states == 19:
            covariance[18, 18] = math.radians(2.0) ** 2
        belief = belief_of(state_of(0.0, 0.0, 0.0), covariance=covariance)
        sample = HeadingSample(NOW_NS, math.radians(3.0), math.radians(0.6) ** 2)
        fused = Fusion(config).fuse(sample, belief, (0.0,) * 3)
        found = math.degrees(fused.belief.control.receivers.heading_error_rad)
        expected = 3.0 * 4 / (4 + 1 + 0.36) if states == 19 else 0.0
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("variances", "expected"),
    [
        ([4e-4, 1e-6, 1e-2], [4e-4, 1e-4, 1e-2]),
        ([0, 0, 0], [1e-4] * 3),
        ([-1, 1, 1], [1e-4, 1, 1]),
    ],
)
def test_floor_of_a_covariance(variances, expected):
    assert np.diag(floored(np.diag(variances).astype(float), 0.01)) == pytest.approx(expected)


def test_floor_keeps_correlation():
    covariance = np.array([[4.0, 1.0, 0], [1.0, 9.0, 0], [0, 0, 1.0]])
    assert np.array_equal(floored(covariance, 0.01), covariance)


@given(st.lists(st.floats(1e-6, 1.0), min_size=3, max_size=3), st.floats(-0.99, 0.99))
def test_floor_only_adds(variances, correlation):
    covariance = np.diag(variances)
    covariance[0, 1] = covariance[1, 0] = correlation * math.sqrt(variances[0] * variances[1])
    found = floored(covariance, 0.1)
    assert (np.diag(found) >= 0.01 * (1 - 1e-12)).all()
    assert np.linalg.eigvalsh(found - covariance)[0] >= -1e-15
