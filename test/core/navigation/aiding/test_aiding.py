"""H of every aiding source against differences of its non-linear model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import MEASURED, NOW_NS, belief_of, state_of
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid_status import Receivers
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline, HeadingAid
from tirgeo_ros.core.navigation.aiding.fusion import Fusion
from tirgeo_ros.core.navigation.aiding.gnss_position import (
    GpsPositionAid,
    RtkPositionAid,
    innovation_n,
)
from tirgeo_ros.core.navigation.aiding.gnss_velocity import GpsVelocityAid, RtkVelocityAid
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    feedback,
    has_antenna,
    heading_error,
    states_of,
)
from tirgeo_ros.core.navigation.strapdown import NavState, matrix, rotate
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome

ZERO = (0.0, 0.0, 0.0)
LEVER_B = np.array([0.3, -0.4, -0.5])
ANTENNA_M = (0.3, 0.4, 0.5)
ARMS = {"aircraft.rtk_antenna_m": ANTENNA_M, "aircraft.gps_antenna_m": ANTENNA_M}
RATE_B = np.array([0.2, -0.1, 0.5])
#: Half steps: second-order terms of the models are lever (1 m) times step squared.
STEPS = [1e-4] * 3 + [1e-2] * 3 + [1.0] * 3 + [1e-4] * 3 + [1e-2] * 3 + [1.0] * 3

tilts = st.floats(-0.6, 0.6)
headings = st.floats(-math.pi, math.pi)
with_and_without_more_states = pytest.mark.parametrize(
    "optional",
    [
        {},
        {"heading.bias_sigma_deg": 2.0},
        {"aircraft.rtk_antenna_sigma_m": (0.1, 0.2, 0.3)},
        {"heading.bias_sigma_deg": 2.0, "aircraft.rtk_antenna_sigma_m": (0.1, 0.2, 0.3)},
    ],
    ids=["plain", "heading", "antenna", "both"],
)


def config_of(**values) -> EkfConfig:
    given_ = {key.replace("__", "."): value for key, value in values.items()}
    return config_from(EkfConfig, ARMS | given_)


def second(baseline_m):
    """The second antenna's place with this baseline; none of none."""
    return tuple(a + b for a, b in zip(ANTENNA_M, baseline_m, strict=True)) if baseline_m else ()


def moved(belief: StateEstimate, error: np.ndarray) -> StateEstimate:
    """The belief with an error of all its states put in, the receivers' too."""
    north, east, down = belief.control.receivers.gps_error_n
    x, y, z = error[GPS_ERROR]
    heading = belief.control.receivers.heading_error_rad
    if heading_error(len(error)) is not None:
        heading += error[-1]
    antenna_b = np.array(belief.control.receivers.antenna_b)
    if has_antenna(len(error)):
        antenna_b += error[ANTENNA]
    receivers = Receivers(NOW_NS, (north + x, east + y, down + z), heading, tuple(antenna_b))
    control = belief.control._replace(receivers=receivers)
    return StateEstimate(feedback(belief.state, error), belief.covariance, control)


def differences(innovation, belief: StateEstimate) -> np.ndarray:
    """d(innovation)/d(error) by central differences: what H must be with the opposite sign."""
    columns = []
    states = len(belief.covariance)
    steps = [*STEPS, *[1e-2] * 3 * has_antenna(states), 1e-4]  # the last where it is a heading
    for index in range(states):
        error = np.zeros(states)
        step = steps[index]
        error[index] = step
        plus, minus = innovation(moved(belief, error)), innovation(moved(belief, -error))
        columns.append((plus - minus) / (2 * step))
    return np.stack(columns, -1)


def position_of(state: NavState, shift_n: np.ndarray, source=Source.RTK_POSITION):
    """The antenna's true place for a state, moved by a few metres."""
    plane = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)
    place = matrix(rotation_of(state.q_nb)) @ LEVER_B + shift_n
    lat, lon, height = (float(x) for x in plane.geodetic_from_ned(place))
    return PositionSample(NOW_NS, source, FixStatus.FIXED, lat, lon, height, np.eye(3))


# Designs


@with_and_without_more_states
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_position_design(optional, roll, pitch, yaw):
    config = config_of(**optional)
    belief = belief_of(state_of(roll, pitch, yaw), states_of(config))
    sample = position_of(belief.state, np.array([1.0, 2.0, -3.0]))
    made = RtkPositionAid(config)
    design = made.measured(sample, belief, ZERO)[0].measurement.design
    numeric = differences(
        lambda b: made.measured(sample, b, ZERO)[0].measurement.innovation, belief
    )
    # Rounding of 1.4e-9 m over the step of 1e-4 rad gives 1e-5; metres to radians second order
    # in (3 m + 1 m) / 6.4e6 m.
    assert design == pytest.approx(-numeric, abs=3e-5)


@with_and_without_more_states
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_gps_position_design(optional, roll, pitch, yaw):
    """As RTK's, with the slow error of the receiver in it."""
    config = config_of(**optional)
    error = np.zeros(states_of(config))
    error[GPS_ERROR] = 0.5, -0.7, 2.0
    belief = moved(belief_of(state_of(roll, pitch, yaw), states_of(config)), error)
    sample = position_of(belief.state, np.array([1.0, 2.0, -3.0]), Source.GPS_POSITION)
    made = GpsPositionAid(config)
    design = made.measured(sample, belief, ZERO)[0].measurement.design
    numeric = differences(
        lambda b: made.measured(sample, b, ZERO)[0].measurement.innovation, belief
    )
    assert design == pytest.approx(-numeric, abs=3e-5)  # as above


@given(tilts, tilts, headings)
def test_position_innovation_is_the_shift(roll, pitch, yaw):
    state = state_of(roll, pitch, yaw)
    shift = np.array([1.0, 2.0, -3.0])
    lever_n = rotate(rotation_of(state.q_nb), tuple(LEVER_B))
    # Curvature over 4 m: 16 / (2 x 6.4e6) = 1.3e-6 m.
    found = innovation_n(state, position_of(state, shift), lever_n)
    assert found == pytest.approx(shift, abs=2e-6)


@given(tilts, tilts, headings)
def test_gps_innovation_is_what_its_error_does_not_explain(roll, pitch, yaw):
    belief = belief_of(state_of(roll, pitch, yaw))
    error = np.zeros(18)
    error[GPS_ERROR] = 0.5, -0.7, 2.0
    sample = position_of(belief.state, np.array([1.0, 2.0, -3.0]), Source.GPS_POSITION)
    found = (
        GpsPositionAid(config_of())
        .measured(sample, moved(belief, error), ZERO)[0]
        .measurement.innovation
    )
    assert found == pytest.approx([0.5, 2.7, -5.0], abs=2e-6)


@with_and_without_more_states
@pytest.mark.parametrize("receiver", ["rtk", "gps"])
@settings(max_examples=40)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_velocity_design(optional, receiver, roll, pitch, yaw):
    config = config_of(**optional)
    source = Source.RTK_VELOCITY if receiver == "rtk" else Source.GPS_VELOCITY
    belief = belief_of(state_of(roll, pitch, yaw), states_of(config))
    sample = VelocitySample(NOW_NS, source, np.array([3.1, -0.9, 0.1]), np.eye(3))
    made = (RtkVelocityAid if receiver == "rtk" else GpsVelocityAid)(config)

    def innovation(b: StateEstimate) -> np.ndarray:
        rate = RATE_B - np.array(b.state.gyro_bias_b)  # RATE_B is the reading
        found_b = np.array(b.control.receivers.antenna_b) if receiver == "rtk" else np.zeros(3)
        swing_n = matrix(rotation_of(b.state.q_nb)) @ np.cross(rate, LEVER_B + found_b)
        return sample.velocity_n - (np.array(b.state.velocity_n) + swing_n)

    found = made.measured(sample, belief, tuple(RATE_B))[0].measurement
    assert found.innovation == pytest.approx(innovation(belief), abs=1e-12)
    # Second order: lever x rate x step squared is 1e-8 / 2e-4.
    assert found.design == pytest.approx(-differences(innovation, belief), abs=1e-4)


@with_and_without_more_states
@pytest.mark.parametrize(
    "baseline_m", [(), (1.0, 0.0, 0.0), (0.3, -0.8, 0.0), (0.6, 0.2, 0.25), (-0.5, 0.1, -0.2)]
)
@settings(max_examples=40)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_heading_design(optional, baseline_m, roll, pitch, yaw):
    """Of the azimuth of a baseline in space, whether it lies level in the body or not."""
    config = config_of(**optional, aircraft__second_antenna_m=second(baseline_m))
    forward, left, up = baseline_m or (1.0, 0.0, 0.0)
    baseline_b = np.array([forward, -left, -up])
    belief = belief_of(state_of(roll, pitch, yaw), states_of(config))

    def reported(b: StateEstimate) -> float:
        """What a perfect receiver says: the baseline's azimuth less its own in the body."""
        north, east, _ = matrix(rotation_of(b.state.q_nb)) @ baseline_b
        level = math.atan2(baseline_b[1], baseline_b[0])
        error = b.control.receivers.heading_error_rad
        return math.atan2(east, north) - level + error

    made = HeadingAid(config)
    measured = reported(belief) + 0.3
    # 0.6 rad of roll and pitch leave a baseline mostly horizontal.
    found = made.measured(HeadingSample(NOW_NS, measured, 1e-4), belief, ZERO)[0]

    def innovation(b: StateEstimate) -> np.ndarray:
        return np.array([math.remainder(measured - reported(b), 2 * math.pi)])

    assert found.measurement.innovation == pytest.approx([0.3], abs=1e-12)
    # Third order in 1e-4 rad, and rounding 1e-16 over it.
    numeric = differences(innovation, belief)
    assert found.measurement.design == pytest.approx(-numeric, abs=1e-6)


def heading_aid(state, heading_rad, variance=1.0, **values):
    config = config_of(**values)
    belief = belief_of(state, states_of(config))
    sample = HeadingSample(NOW_NS, heading_rad, variance)
    return HeadingAid(config).measured(sample, belief, ZERO)[0]


@given(tilts, headings)
def test_heading_row_of_a_baseline_along_the_nose(pitch, yaw):
    """The row that the errata of Eq. 9 give."""
    made = heading_aid(state_of(0.3, pitch, yaw), 0.0)
    expected = [math.tan(pitch) * math.cos(yaw), math.tan(pitch) * math.sin(yaw), 1.0]
    assert made.measurement.design[0, :3] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("turns", [-1, 0, 1, 2])
def test_heading_innovation_wraps(turns):
    measured = math.radians(-179.0) + turns * 2 * math.pi
    made = heading_aid(state_of(0, 0, math.radians(179.0)), measured)
    assert made.measurement.innovation[0] == pytest.approx(math.radians(2.0), abs=1e-12)


@pytest.mark.parametrize("baseline_m", [(), (2.0, 0.0, 0.0), (0.0, -1.1, 0.1), (-0.3, 0.4, 0.0)])
def test_a_level_aircrafts_heading_is_the_nose_whatever_the_baseline(baseline_m):
    state = state_of(0.0, 0.0, math.radians(30.0))
    made = heading_aid(state, math.radians(30.0), aircraft__second_antenna_m=second(baseline_m))
    assert made.measurement.innovation[0] == pytest.approx(0.0, abs=1e-12)


def test_baseline_of_the_parameters():
    """Second antenna behind, to the left and higher; where the IMU is does not matter."""
    config = config_of(
        aircraft__second_antenna_m=second((-1.0, 0.5, 0.25)), aircraft__imu_m=(5.0, 6.0, 7.0)
    )
    found = Baseline.from_config(config.aircraft)
    length = math.sqrt(1 + 0.25 + 0.0625)
    assert found.direction_b == pytest.approx((-1 / length, -0.5 / length, -0.25 / length))
    assert found.reported_less_azimuth_rad == pytest.approx(-math.atan2(-0.5, -1.0))


@pytest.mark.parametrize(
    "baseline_m",
    [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.1, 0.0, -1.0), (0.03, -0.03, 0.0), (-0.049, 0.0, 0.0)],
)
def test_baseline_without_a_horizontal_part_is_refused(baseline_m):
    """Upright ones, and antennas nearer than 5 cm."""
    config = config_of(aircraft__second_antenna_m=second(baseline_m))
    with pytest.raises(
        ConfigError,
        match=r"aircraft\.rtk_antenna_m \[0.3, 0.4, 0.5\] and aircraft\.second_antenna_m .* only",
    ):
        Baseline.from_config(config.aircraft)
    with pytest.raises(ConfigError, match="too little for a heading"):
        HeadingAid(config)


def test_upright_baseline_has_no_heading():
    state = state_of(0.0, math.radians(85.0), 0.0)
    assert heading_aid(state, 0.0).outcome is Outcome.INVALID
    belief = belief_of(state)
    fused = Fusion(MEASURED).fuse(HeadingSample(NOW_NS, 0.0, 1e-4), belief, (0.0,) * 3)
    assert fused.verdict.outcome is Outcome.INVALID
    assert fused.belief.state is belief.state
    assert fused.belief.covariance is belief.covariance
