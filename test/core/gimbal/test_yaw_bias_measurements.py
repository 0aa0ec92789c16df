"""When the gimbal's north shows, and what a reading of it is."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.config import NorthConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_from_matrix
from tirgeo_ros.core.gimbal.yaw_bias_filter import YawBiasFilter
from tirgeo_ros.core.gimbal.yaw_bias_measurements import SteadyMean, YawBiasMeasurements

MS = 1_000_000
PERIOD_MS = 50
CENTRED = NorthConfig(centred=True)
headings = st.floats(-3.1, 3.1)
biases = st.floats(-0.6, 0.6)


def read(nose, bias, *, seconds=10.0, config=CENTRED, lag_s=0.0, joints=False, pitch=-0.5):
    """The filter after a flight with the nose's heading ``nose(t_s)`` and a lagging gimbal."""
    north, readings = YawBiasFilter(config), YawBiasMeasurements(config, 0.0)
    camera = nose(0.0)
    for t_ms in range(0, round(seconds * 1e3) + 1, PERIOD_MS):
        t_s = 1e-3 * t_ms
        gain = 1 - math.exp(-1e-3 * PERIOD_MS / lag_s) if lag_s else 1.0
        camera += gain * (nose(t_s) - camera)
        q_nb = quat_from_euler(0.03, -0.05, nose(t_s))
        q_ng = quat_from_euler(0.0, pitch, camera + bias)
        q_bg = None
        if joints:
            level = matrix_from_quat(quat_from_euler(0.0, pitch, camera))
            q_bg = quat_from_matrix(matrix_from_quat(q_nb).T @ level)
        readings.read(north, t_ms * MS, q_ng, q_nb, q_bg)
    return north


@settings(max_examples=15)  # each a flight
@given(headings, biases, st.floats(-math.pi / 2, 0.3))
def test_a_still_centred_gimbal_shows_the_bias(yaw, bias, pitch):
    config = NorthConfig(centred=True, sigma_deg=60.0, centred_sigma_deg=0.0)
    north = read(lambda _t: yaw, bias, seconds=6.0, config=config, pitch=pitch)
    assert north.updates == 2  # three seconds to settle, then one each second but for a sample
    # the prior of 60 deg pulls with (0.2 / 60)^2 / 2
    assert north.bias_rad == pytest.approx(bias, abs=1e-5)


@pytest.mark.parametrize("rate_deg_s", [1.0, -10.0, 60.0])
def test_nothing_is_read_while_the_nose_turns(rate_deg_s):
    north = read(lambda t: math.radians(rate_deg_s) * t, 0.1, seconds=30.0, lag_s=0.35)
    assert north.updates + north.refused == 0


def test_the_lag_of_a_turn_is_waited_for():
    def nose(t_s):
        return math.radians(40.0) * min(t_s, 3.0)

    north = read(nose, 0.1, seconds=7.5, lag_s=0.5)
    assert north.updates == 1  # three seconds of turn, three to settle, one to average
    # of the 20 deg of lag exp(-3 / 0.5) is left, 0.05 deg, and the prior's part of 0.1 rad
    prior_part = 0.1 * (0.3**2 + 0.2**2) / 3.0**2
    assert north.bias_rad == pytest.approx(0.1, abs=math.radians(0.05) + prior_part)


def test_joints_show_the_bias_without_the_gimbal_being_centred_and_looking_down():
    config = NorthConfig()
    for pitch in (-0.5, -math.pi / 2):
        north = read(lambda _t: 0.4, 0.1, seconds=3.1, config=config, joints=True, pitch=pitch)
        assert north.updates == 3
        prior_part = 0.1 * (0.2**2 / 3) / 3.0**2
        assert north.bias_rad == pytest.approx(0.1, abs=2 * prior_part)


def test_a_gap_or_a_clock_that_goes_back_begins_anew():
    mean = SteadyMean(0.0)
    assert mean.add(0, 0.0, 0.1) is None
    assert mean.add(900 * MS, 0.0, 0.1) is None
    assert mean.add(2600 * MS, 0.0, 0.1) is None  # after 1.7 s
    assert mean.add(3500 * MS, 0.0, 0.1) is None
    assert mean.add(0, 0.0, 0.1) is None  # back
    assert mean.add(1000 * MS, 0.0, 0.1) == pytest.approx(0.1)
