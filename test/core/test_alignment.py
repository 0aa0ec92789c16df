"""The first attitude: the vector solution, at rest, in motion, and what it waits for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flights import config_for, flight, navigation_samples
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.alignment import Aligner, attitude_from
from tirgeo_ros.core.attitude import (
    euler_from_quat,
    matrix_from_euler,
    quat_from_matrix,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.samples import (
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)

tilts = st.floats(-0.8, 0.8)


@given(tilts, tilts, st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(-3, 3))
def test_two_vectors_give_the_attitude(roll, pitch, yaw, north, east):
    """Exact vectors, any attitude, acceleration up to 3 m/s2: the rotation comes back."""
    rotation = matrix_from_euler(roll, pitch, yaw)
    force_n = np.array([north, east, -9.8])
    baseline = np.array([math.cos(0.3), math.sin(0.3), 0.0])
    turned = rotation @ baseline
    found = attitude_from(
        rotation.T @ force_n, force_n, [baseline], [math.atan2(turned[1], turned[0])]
    )
    error = rotvec_from_quat(quat_from_matrix(found @ rotation.T))
    # Twenty fixed-point turns, each at least halving, about a force that leans at most 23 deg.
    assert np.linalg.norm(error) < 1e-6


def test_headings_average_across_the_wrap():
    azimuths = [math.radians(179.0), math.radians(-179.0)]
    nose = np.array([1.0, 0, 0])
    found = attitude_from(np.array([0, 0, -9.8]), np.array([0, 0, -9.8]), [nose] * 2, azimuths)
    yaw = euler_from_quat(quat_from_matrix(found))[2]
    assert abs(wrap_pi(yaw - math.pi)) < 1e-9


def aligned(samples, config, *, use_heading=True):
    aligner = Aligner(config, use_heading=use_heading)
    for sample in samples:
        found = aligner.add(sample)
        if found is not None:
            return found, aligner
    return None, aligner


@pytest.mark.parametrize("start_s", [0.0, 15.0, 24.0, 31.0, 42.0])
def test_alignment_at_rest_and_in_motion(start_s):
    """Started anywhere in the flight, turns among them, within its own sigma x 4."""
    flown = flight()
    start_ns = flown.truth.stamp_ns[0] + round(start_s * 1e9)
    samples = [s for s in navigation_samples(flown) if s.stamp_ns >= start_ns]
    samples = [s for s in samples if getattr(s, "source", Source.RTK_POSITION).value[:3] == "rtk"]
    found, _ = aligned(samples, config_for(flown))
    assert found is not None
    assert (found.stamp_ns - start_ns) * 1e-9 < 1.5  # a window of 1 s, RTK at 5 Hz
    i = int(np.argmin(np.abs(np.array(flown.truth.stamp_ns) - found.stamp_ns)))
    error = wrap_pi(
        euler_from_quat(flown.truth.q_nb[i]) - euler_from_quat(np.array(found.state.q_nb))
    )
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.abs(error[:2]).max() < 4 * sigma[0]
    # Five whole-degree headings of 0.49 deg each.
    assert abs(error[2]) < 4 * np.radians(0.49) / math.sqrt(5)
    assert np.abs(flown.truth.velocity_n[i] - found.state.velocity_n).max() < 4 * 0.03
    assert found.imu[0].stamp_ns <= found.stamp_ns < found.imu[1].stamp_ns


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (PositionSample, "needs rtk/fix"),
        (VelocitySample, "needs rtk/vel"),
        (HeadingSample, "needs rtk/heading"),
        (ImuSample, "needs imu/data"),
    ],
)
def test_what_is_missing_is_named(kind, reason):
    flown = flight()
    samples = navigation_samples(flown)[:600]
    samples = [s for s in samples if not isinstance(s, kind)]
    samples = [s for s in samples if "gps" not in str(getattr(s, "source", ""))]
    found, aligner = aligned(samples, config_for(flown))
    assert found is None
    assert reason in aligner.reason


def test_wrong_unit_of_force_is_refused():
    """Force in g instead of m/s2 cannot be gravity."""
    flown = flight()
    samples = [
        replace(s, specific_force_b=s.specific_force_b / 9.8) if isinstance(s, ImuSample) else s
        for s in navigation_samples(flown)[:600]
        if "gps" not in str(getattr(s, "source", ""))
    ]
    found, aligner = aligned(samples, config_for(flown))
    assert found is None
    assert "imu/data and rtk/vel differ by 8." in aligner.reason


def test_without_heading_the_autopilot_gives_the_first():
    flown = flight()
    samples = navigation_samples(flown)[:600]
    samples = [s for s in samples if "gps" not in str(getattr(s, "source", ""))]
    found, _ = aligned(samples, config_for(flown), use_heading=False)
    assert found is not None
    yaw = euler_from_quat(np.array(found.state.q_nb))[2]
    autopilot = euler_from_quat(found.imu[0].autopilot_q_nb)[2]
    assert abs(wrap_pi(yaw - autopilot)) < np.radians(0.5)  # one instant to the next
    for q_nb in (None, np.zeros(4), np.full(4, math.nan), np.array([math.inf, 0, 0, 0])):
        bare = [
            replace(s, autopilot_q_nb=q_nb) if isinstance(s, ImuSample) else s for s in samples
        ]
        found, aligner = aligned(bare, config_for(flown), use_heading=False)
        assert found is None
        assert "orientation" in aligner.reason
