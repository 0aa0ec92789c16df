"""H of every aiding source against differences of its non-linear model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filter_states import (
    ANTENNA_M,
    LEVER_B,
    NOW_NS,
    ZERO,
    antenna_fix,
    armed_config,
    belief_of,
    state_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aids import AIDS
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import Baseline, HeadingAid
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    feedback,
    has_antenna,
    heading_error,
    states_of,
)
from tirgeo_ros.core.navigation.strapdown import matrix
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import HeadingSample, Source, VelocitySample
from tirgeo_ros.core.types.verdicts import Outcome

RATE_B = np.array([0.2, -0.1, 0.5])
SHIFT_N = np.array([1.0, 2.0, -3.0])
#: Half steps: second-order terms of the models are lever (1 m) times step squared.
STEPS = [1e-4] * 3 + [1e-2] * 3 + [1.0] * 3 + [1e-4] * 3 + [1e-2] * 3 + [1.0] * 3

tilts = st.floats(-0.6, 0.6)
headings = st.floats(-math.pi, math.pi)
HEADING = {"heading__bias_sigma_deg": 2.0}
PLACE = {"aircraft__rtk_antenna_sigma_m": (0.1, 0.2, 0.3)}
with_and_without_more_states = pytest.mark.parametrize(
    "optional", [{}, HEADING, PLACE, HEADING | PLACE], ids=["plain", "heading", "antenna", "both"]
)


def second(baseline_m):
    """The second antenna's place with this baseline; none of none."""
    return tuple(a + b for a, b in zip(ANTENNA_M, baseline_m, strict=True)) if baseline_m else ()


def moved(belief: StateEstimate, error: np.ndarray) -> StateEstimate:
    """The belief with an error of all its states put in, the receivers' too."""
    at, states = heading_error(len(error)), len(error)
    place_b = error[ANTENNA] if has_antenna(states) else ZERO
    turned = 0.0 if at is None else float(error[at])
    receivers = belief.control.receivers.changed(error[GPS_ERROR], turned, place_b)
    control = belief.control._replace(receivers=receivers)
    return StateEstimate(feedback(belief.state, error), belief.covariance, control)


def differences(innovation, belief: StateEstimate) -> np.ndarray:
    """d(innovation)/d(error) by central differences: what H must be with the opposite sign."""
    columns, states = [], len(belief.covariance)
    steps = [*STEPS, *[1e-2] * 3 * has_antenna(states), 1e-4]  # the last where it is a heading
    for error in np.diag(steps[:states]):
        plus, minus = innovation(moved(belief, error)), innovation(moved(belief, -error))
        columns.append((plus - minus) / (2 * error.sum()))
    return np.stack(columns, -1)


@with_and_without_more_states
@pytest.mark.parametrize("source", [Source.RTK_POSITION, Source.GPS_POSITION])
@settings(max_examples=60)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_position_design(optional, source, roll, pitch, yaw):
    """That of the ordinary GPS with its slow error in it."""
    config = armed_config(**optional)
    error = np.zeros(states_of(config))
    error[GPS_ERROR] = 0.5, -0.7, 2.0
    belief = moved(belief_of(state_of(roll, pitch, yaw), states_of(config)), error)
    sample = antenna_fix(belief.state, SHIFT_N, source)
    aid = AIDS[source](config)
    found = aid.measured(sample, belief, ZERO)[0].measurement

    def innovation(b: StateEstimate) -> np.ndarray:
        return aid.measured(sample, b, ZERO)[0].measurement.innovation

    # Rounding of 1.4e-9 m over the step of 1e-4 rad gives 1e-5; metres to radians second order
    # in (3 m + 1 m) / 6.4e6 m.
    assert found.design == pytest.approx(-differences(innovation, belief), abs=3e-5)
    own_n = error[GPS_ERROR] * (source is Source.GPS_POSITION)
    # Curvature over 4 m: 16 / (2 x 6.4e6) = 1.3e-6 m.
    assert found.innovation == pytest.approx(SHIFT_N - own_n, abs=2e-6)


@with_and_without_more_states
@pytest.mark.parametrize("source", [Source.RTK_VELOCITY, Source.GPS_VELOCITY])
@settings(max_examples=40)
@given(roll=tilts, pitch=tilts, yaw=headings)
def test_velocity_design(optional, source, roll, pitch, yaw):
    config = armed_config(**optional)
    belief = belief_of(state_of(roll, pitch, yaw), states_of(config))
    sample = VelocitySample(NOW_NS, source, np.array([3.1, -0.9, 0.1]), np.eye(3))
    rtk = source is Source.RTK_VELOCITY

    def innovation(b: StateEstimate) -> np.ndarray:
        rate = RATE_B - np.array(b.state.gyro_bias_b)  # RATE_B is the reading
        found_b = np.array(b.control.receivers.antenna_b) * rtk
        swing_n = matrix(rotation_of(b.state.q_nb)) @ np.cross(rate, LEVER_B + found_b)
        return sample.velocity_n - (np.array(b.state.velocity_n) + swing_n)

    found = AIDS[source](config).measured(sample, belief, tuple(RATE_B))[0].measurement
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
    config = armed_config(**optional, aircraft__second_antenna_m=second(baseline_m))
    forward, left, up = baseline_m or (1.0, 0.0, 0.0)
    baseline_b = np.array([forward, -left, -up])
    belief = belief_of(state_of(roll, pitch, yaw), states_of(config))

    def reported(b: StateEstimate) -> float:
        """What a perfect receiver says: the baseline's azimuth less its own in the body."""
        north, east, _ = matrix(rotation_of(b.state.q_nb)) @ baseline_b
        level = math.atan2(baseline_b[1], baseline_b[0])
        return math.atan2(east, north) - level + b.control.receivers.heading_error_rad

    measured = reported(belief) + 0.3
    # 0.6 rad of roll and pitch leave a baseline mostly horizontal.
    found = HeadingAid(config).measured(HeadingSample(NOW_NS, measured, 1e-4), belief, ZERO)[0]

    def innovation(b: StateEstimate) -> np.ndarray:
        return np.array([math.remainder(measured - reported(b), 2 * math.pi)])

    assert found.measurement.innovation == pytest.approx([0.3], abs=1e-12)
    # Third order in 1e-4 rad, and rounding 1e-16 over it.
    numeric = differences(innovation, belief)
    assert found.measurement.design == pytest.approx(-numeric, abs=1e-6)


def heading_aid(state, heading_rad, **values):
    config = armed_config(**values)
    sample = HeadingSample(NOW_NS, heading_rad, 1.0)
    return HeadingAid(config).measured(sample, belief_of(state, states_of(config)), ZERO)[0]


@pytest.mark.parametrize("turns", [-1, 0, 1, 2])
def test_heading_innovation_wraps(turns):
    measured = math.radians(-179.0) + turns * 2 * math.pi
    made = heading_aid(state_of(0, 0, math.radians(179.0)), measured)
    assert made.measurement.innovation[0] == pytest.approx(math.radians(2.0), abs=1e-12)


def test_baseline_of_the_parameters():
    """Second antenna behind, to the left and higher; where the IMU is does not matter."""
    places = {"aircraft__second_antenna_m": second((-1.0, 0.5, 0.25))}
    found = Baseline.from_config(armed_config(**places, aircraft__imu_m=(5.0, 6.0, 7.0)).aircraft)
    length = math.sqrt(1 + 0.25 + 0.0625)
    assert found.direction_b == pytest.approx((-1 / length, -0.5 / length, -0.25 / length))
    assert found.reported_less_azimuth_rad == pytest.approx(-math.atan2(-0.5, -1.0))


@pytest.mark.parametrize("baseline_m", [(0.0, 0.0, 0.0), (0.1, 0.0, -1.0), (0.03, -0.03, 0.0)])
def test_baseline_without_a_horizontal_part_is_refused(baseline_m):
    """Upright ones, and antennas nearer than 5 cm."""
    config = armed_config(aircraft__second_antenna_m=second(baseline_m))
    names = r"aircraft\.rtk_antenna_m \[0.3, 0.4, 0.5\] and aircraft\.second_antenna_m .* only"
    with pytest.raises(ConfigError, match=names):
        HeadingAid(config)


def test_upright_baseline_has_no_heading():
    assert heading_aid(state_of(0.0, math.radians(85.0), 0.0), 0.0).outcome is Outcome.INVALID
