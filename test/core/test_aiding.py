"""H of every aiding source against differences of its non-linear model; noise floors; fusion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.aiding.fusion import Fusion, floored
from tirgeo_ros.core.aiding.heading import azimuth, baseline_b, heading_measurement
from tirgeo_ros.core.aiding.position import innovation_n, position_measurement
from tirgeo_ros.core.aiding.velocity import velocity_measurement
from tirgeo_ros.core.attitude import quat_from_euler
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import STATES, feedback
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.parameter import config_from
from tirgeo_ros.core.samples import (
    FixStatus,
    HeadingSample,
    Outcome,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.strapdown import NavState, matrix, rotation_of

LEVER_B = np.array([0.3, -0.4, -0.5])
RATE_B = np.array([0.2, -0.1, 0.5])
#: Half steps: second-order terms of the models are lever (1 m) times step squared.
STEPS = np.array([1e-4] * 3 + [1e-2] * 3 + [1.0] * 3 + [1e-4] * 3 + [1e-2] * 3)

tilts = st.floats(-0.6, 0.6)
headings = st.floats(-math.pi, math.pi)


def state_of(roll: float, pitch: float, yaw: float) -> NavState:
    q = tuple(quat_from_euler(roll, pitch, yaw).tolist())
    return NavState(q, (3.0, -1.0, 0.2), 0.695, 2.04, 31.5, *[(0.0,) * 3] * 3)


def position_of(state: NavState, shift_n: np.ndarray) -> PositionSample:
    """The antenna's true place for a state, moved by a few metres."""
    plane = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)
    place = matrix(rotation_of(state.q_nb)) @ LEVER_B + shift_n
    lat, lon, height = (float(x) for x in plane.geodetic_from_ned(place))
    return PositionSample(0, Source.RTK_POSITION, FixStatus.FIXED, lat, lon, height, np.eye(3))


def differences(innovation, state: NavState) -> np.ndarray:
    """d(innovation)/d(error) by central differences: what H must be with the opposite sign."""
    columns = []
    for index in range(STATES):
        error = np.zeros(STATES)
        error[index] = STEPS[index]
        plus, minus = innovation(feedback(state, error)), innovation(feedback(state, -error))
        columns.append((plus - minus) / (2 * STEPS[index]))
    return np.stack(columns, -1)


@given(tilts, tilts, headings)
def test_position_design(roll, pitch, yaw):
    state = state_of(roll, pitch, yaw)
    sample = position_of(state, np.array([1.0, 2.0, -3.0]))
    innovation = innovation_n(state, sample, LEVER_B)
    design = position_measurement(state, innovation, np.eye(3), LEVER_B, 5.0).design
    numeric = differences(lambda s: innovation_n(s, sample, LEVER_B), state)
    # Rounding of 1.4e-9 m over the step of 1e-4 rad gives 1e-5; metres to radians second order
    # in (3 m + 1 m) / 6.4e6 m.
    assert design == pytest.approx(-numeric, abs=3e-5)


@given(tilts, tilts, headings)
def test_position_innovation_is_the_shift(roll, pitch, yaw):
    state = state_of(roll, pitch, yaw)
    shift = np.array([1.0, 2.0, -3.0])
    # Curvature over 4 m: 16 / (2 x 6.4e6) = 1.3e-6 m.
    found = innovation_n(state, position_of(state, shift), LEVER_B)
    assert found == pytest.approx(shift, abs=2e-6)


@given(tilts, tilts, headings)
def test_velocity_design(roll, pitch, yaw):
    state = state_of(roll, pitch, yaw)
    measured = np.array([3.1, -0.9, 0.1])

    def innovation(s: NavState) -> np.ndarray:
        rate = RATE_B - np.array(s.gyro_bias_b)  # RATE_B is the reading, the state's bias zero
        swing_n = matrix(rotation_of(s.q_nb)) @ np.cross(rate, LEVER_B)
        return measured - (np.array(s.velocity_n) + swing_n)

    made = velocity_measurement(state, measured, np.eye(3), RATE_B, LEVER_B, 5.0)
    assert made.innovation == pytest.approx(innovation(state), abs=1e-12)
    # Second order: lever x rate x step squared is 1e-8 / 2e-4.
    assert made.design == pytest.approx(-differences(innovation, state), abs=1e-4)


@given(tilts, tilts, headings, st.floats(-180, 180))
def test_heading_design(roll, pitch, yaw, offset_deg):
    state = state_of(roll, pitch, yaw)
    baseline = baseline_b(offset_deg)
    made = heading_measurement(state, yaw, 1e-4, baseline, 5.0)
    assert made is not None  # 0.6 rad of roll and pitch leave a baseline mostly horizontal

    def innovation(s: NavState) -> np.ndarray:
        turned = azimuth(matrix(rotation_of(s.q_nb)) @ baseline)
        return np.array([math.remainder(made.innovation[0] + start - turned, 2 * math.pi)])

    start = azimuth(matrix(rotation_of(state.q_nb)) @ baseline)
    # Third order in 1e-4 rad, and rounding 1e-16 over it.
    assert made.design == pytest.approx(-differences(innovation, state), abs=1e-6)


@given(tilts, headings)
def test_heading_row_of_a_baseline_along_the_nose(pitch, yaw):
    """The row that the errata of Eq. 9 give."""
    made = heading_measurement(state_of(0.3, pitch, yaw), 0.0, 1.0, baseline_b(0.0), 5.0)
    expected = [math.tan(pitch) * math.cos(yaw), math.tan(pitch) * math.sin(yaw), 1.0]
    assert made is not None
    assert made.design[0, :3] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("turns", [-1, 0, 1, 2])
def test_heading_innovation_wraps(turns):
    measured = math.radians(-179.0) + turns * 2 * math.pi
    made = heading_measurement(
        state_of(0, 0, math.radians(179.0)), measured, 1.0, baseline_b(0), 5
    )
    assert made is not None
    assert made.innovation[0] == pytest.approx(math.radians(2.0), abs=1e-12)


def test_level_offset_is_added_to_the_nose():
    """A level aircraft: the reported direction is nose plus offset, clockwise."""
    state = state_of(0.0, 0.0, math.radians(30.0))
    made = heading_measurement(state, math.radians(120.0), 1.0, baseline_b(90.0), 5.0)
    assert made is not None
    assert made.innovation[0] == pytest.approx(0.0, abs=1e-12)


def test_upright_baseline_has_no_heading():
    state = state_of(0.0, math.radians(85.0), 0.0)
    assert heading_measurement(state, 0.0, 1.0, baseline_b(0.0), 5.0) is None
    sample = HeadingSample(0, 0.0, 1e-4)
    fused = Fusion(EkfConfig()).fuse(sample, state, np.eye(STATES), np.zeros(3), [])
    assert fused.verdict.outcome is Outcome.INVALID
    assert fused.state is state


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


def fused_position(config: dict, shift: np.ndarray, window: list[np.ndarray]):
    state = state_of(0.0, 0.0, 0.0)
    fusion = Fusion(config_from(EkfConfig, {"rtk.lever_arm_m": (0.3, 0.4, 0.5), **config}))
    sample = position_of(state, shift)
    window = [*window, fusion.offset_n(state, sample)]
    return state, fusion.fuse(sample, state, 0.01 * np.eye(STATES), np.zeros(3), window)


def test_direct_position_is_the_rtk_position():
    """Section 3.3: after the cycle the antenna stands where RTK says, whatever the gain."""
    shift = np.array([0.1, -0.2, 0.3])
    state, fused = fused_position({"position_update": "rtk_direct"}, shift, [])
    moved = innovation_n(fused.state, position_of(state, shift), LEVER_B)
    rotation_moved = innovation_n(
        fused.state._replace(q_nb=state.q_nb), position_of(state, shift), LEVER_B
    )
    assert fused.verdict.used
    assert rotation_moved == pytest.approx(np.zeros(3), abs=2e-6)
    assert np.abs(moved).max() < 0.1  # the lever arm turned with the attitude that was kept


def test_median_filter_ignores_one_jump():
    """Window of three: the middle of two good offsets and the jump is a good one."""
    good = [np.array([0.01, 0.0, -0.01]), np.array([-0.01, 0.01, 0.0])]
    _, fused = fused_position({"rtk.median_window": 3}, np.array([0.0, 5.0, 0.0]), good)
    assert fused.verdict.used
    assert fused.verdict.innovation == pytest.approx((0.0, 0.01, 0.0), abs=2e-6)


def test_gate_refuses_a_jump_and_leaves_the_state():
    state, fused = fused_position({}, np.array([0.0, 8.0, 0.0]), [])  # 8 sigma
    assert fused.verdict.outcome is Outcome.GATED
    assert fused.verdict.test_ratio > 1
    assert fused.state is state


def test_velocity_enters_with_its_floor():
    state = state_of(0.0, 0.0, 0.0)
    sample = VelocitySample(0, Source.RTK_VELOCITY, np.array([3.5, -1.0, 0.2]), np.zeros((3, 3)))
    covariance = np.diag(np.r_[np.zeros(3), np.full(3, 4e-4), np.zeros(9)])
    fused = Fusion(EkfConfig()).fuse(sample, state, covariance, np.zeros(3), [])
    # Variance 0.02^2 against the floor 0.02^2: half of the 0.5 m/s, but that is 17 sigma: refused.
    assert fused.verdict.outcome is Outcome.GATED
    fused = Fusion(EkfConfig()).fuse(
        sample, state._replace(velocity_n=(3.45, -1.0, 0.2)), covariance, np.zeros(3), []
    )
    assert fused.state.velocity_n[0] == pytest.approx(3.475, abs=1e-9)
