"""Poses between poses and a little after the newest: where they lie, and how sure they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motions import angle_between

from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.overlay.camera_motion import predicted
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

STEP_NS = 10_000_000


def body(stamp_ns, position_n=(0.0, 0.0, 0.0), rotvec=(0.0, 0.0, 0.0), variance=1.0):
    q = quat_from_rotvec(np.array(rotvec, float))
    return BodyPose(stamp_ns, np.array(position_n, float), q, np.diag(np.full(6, variance)))


def constant_motion(stamp_ns, velocity_n, rate_b, start_q):
    """Straight line and constant body rate: interpolation has no error on it."""
    t = stamp_ns * 1e-9
    q = quat_multiply(start_q, quat_from_rotvec(np.asarray(rate_b) * t))
    return BodyPose(stamp_ns, np.asarray(velocity_n) * t, q, np.eye(6) * (1 + t))


vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(vectors, vectors, vectors, st.integers(0, 20 * STEP_NS))
def test_constant_motion_is_met_at_every_instant(velocity_n, rate_b, rotvec, stamp_ns):
    history: PoseBuffer[BodyPose] = PoseBuffer()
    start_q = quat_from_rotvec(rotvec)
    for k in range(21):
        history.add(constant_motion(k * STEP_NS, velocity_n, rate_b, start_q))
    truth = constant_motion(stamp_ns, velocity_n, rate_b, start_q)
    found = history.at(stamp_ns)
    assert isinstance(found, BodyPose)
    assert found.stamp_ns == stamp_ns
    # arithmetic on numbers of order one
    np.testing.assert_allclose(found.position_n, truth.position_n, atol=1e-12)
    np.testing.assert_allclose(found.covariance, truth.covariance, atol=1e-12)
    assert angle_between(found.q_nb, truth.q_nb) < 1e-7  # 2 atan2 near zero: root of epsilon


def test_never_outside_the_poses():
    history: PoseBuffer[BodyPose] = PoseBuffer()
    assert history.at(0) is Miss.EMPTY
    first, last = body(STEP_NS), body(2 * STEP_NS)
    history.add(first)
    history.add(last)
    assert history.at(STEP_NS - 1) is Miss.TOO_OLD
    assert history.at(STEP_NS) is first
    assert history.at(2 * STEP_NS) is last
    assert history.at(2 * STEP_NS + 1) is Miss.TOO_NEW


def test_gap_is_not_bridged_but_its_ends_stand():
    history: PoseBuffer[BodyPose] = PoseBuffer(max_gap_s=0.1)
    for stamp_ns in (0, 100_000_000, 200_000_001):
        history.add(body(stamp_ns))
    assert isinstance(history.at(50_000_000), BodyPose)  # 0.1 s exactly is no gap
    assert history.at(150_000_000) is Miss.GAP
    assert isinstance(history.at(200_000_001), BodyPose)


def test_stamp_going_back_starts_again():
    history: PoseBuffer[BodyPose] = PoseBuffer()
    history.add(body(5 * STEP_NS))
    history.add(body(6 * STEP_NS))
    history.add(body(STEP_NS))
    assert history.went_back == 1
    assert len(history) == 1
    assert history.at(5 * STEP_NS) is Miss.TOO_NEW


@pytest.mark.parametrize(
    "pose",
    [
        body(0, position_n=(np.nan, 0, 0)),
        body(0, position_n=(0, 0, 1e200)),
        body(0, variance=np.inf),
        BodyPose(0, np.zeros(3), np.zeros(4), np.eye(6)),
        BodyPose(0, np.zeros(3), np.array([np.nan, 0, 0, 1.0]), np.eye(6)),
        BodyPose(0, np.array([np.inf, -np.inf, 0]), np.array([np.inf, 0, 0, 1.0]), np.eye(6)),
        BodyPose(0, np.zeros(3), np.array([1.0, 0, 0, 1.0]), np.eye(6)),
    ],
)
def test_invalid_pose_is_refused_and_counted(pose):
    history: PoseBuffer[BodyPose] = PoseBuffer()
    assert not history.add(pose)
    assert history.invalid == 1
    assert history.fault
    assert history.at(0) is Miss.EMPTY


STEP_S = 0.02
GAP_S = 0.25
SIGMA_M, SIGMA_RAD = 0.01, 0.001
COVARIANCE = np.diag(np.repeat([SIGMA_M, SIGMA_RAD], 3) ** 2)
rates = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def pose_of(time_s, position_n, q_nc):
    return CameraPose(round(time_s * 1e9), np.asarray(position_n, float), q_nc, COVARIANCE)


def moving(times_s, velocity_n, rate_n, q_nc):
    return [
        pose_of(t, np.asarray(velocity_n) * t, quat_multiply(quat_from_rotvec(rate_n * t), q_nc))
        for t in times_s
    ]


def error_of(pose, truth):
    turn = quat_multiply(truth.q_nc, quat_conjugate(pose.q_nc))
    return np.concatenate([truth.position_n - pose.position_n, rotvec_from_quat(turn)])


@given(rates, rates, rates, st.floats(0.001, 0.2), st.sampled_from([0.005, 0.02, 0.1]))
def test_steady_motion_goes_on(velocity_n, rate_n, rotvec, ahead_s, step_s):
    q_nc = quat_from_rotvec(rotvec)
    poses = moving(np.arange(0, 1.21, step_s), velocity_n, rate_n, q_nc)
    time_s = poses[-1].stamp_ns * 1e-9 + ahead_s
    found = predicted(poses, round(time_s * 1e9), GAP_S)
    assert isinstance(found, CameraPose)
    assert found.stamp_ns == round(time_s * 1e9)
    truth = moving([found.stamp_ns * 1e-9], velocity_n, rate_n, q_nc)[0]
    # slopes of sums near 1 over a tenth of a second, and 2 atan2 near zero: root of epsilon
    assert np.abs(error_of(found, truth)).max() < 1e-7


def wandering(rng, number):
    """True poses of a camera that accelerates at random, and the same with the poses' noise."""
    steps = rng.normal(0, 1, (number, 6)) * np.repeat([2.0, 0.8], 3) * STEP_S
    smooth = np.array([np.convolve(each, np.ones(15) / 15**0.5, "same") for each in steps.T]).T
    rates = smooth.cumsum(axis=0)
    places = rates.cumsum(axis=0) * STEP_S
    q = [quat_from_rotvec(place[3:] * 0.5) for place in places]
    truth = [pose_of(i * STEP_S, places[i, :3], q[i]) for i in range(number)]
    noise = rng.normal(0, 1, (number, 6)) @ np.sqrt(COVARIANCE)
    seen = [
        pose_of(
            i * STEP_S,
            places[i, :3] + noise[i, :3],
            quat_multiply(quat_from_rotvec(noise[i, 3:]), q[i]),
        )
        for i in range(number)
    ]
    return truth, seen


@pytest.mark.slow
@pytest.mark.parametrize("steps_ahead", [1, 3, 5])
def test_the_covariance_is_what_the_error_is(steps_ahead):
    """Mean squared error over variance of each of six axes, over 300 flights.

    One for a covariance that is right. At most 1.3: its expected spread over 1800 errors is 0.03,
    and what a second of trials shows of a flight is itself uncertain by a fifth. At least 0.4: the
    newest pose's own noise is in the trials and in its covariance, and so counts up to twice.
    """
    rng = np.random.default_rng(steps_ahead)
    ratios = []
    for _ in range(300):
        truth, seen = wandering(rng, 61 + steps_ahead)
        met = truth[-1]
        found = predicted(seen[:61], met.stamp_ns, GAP_S)
        ratios.append(error_of(found, met) ** 2 / np.diag(found.covariance))
    assert 0.4 < np.mean(ratios) < 1.3
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
    np.testing.assert_allclose(found.covariance, found.covariance.T, rtol=1e-12)


def test_few_poses_are_trusted_less():
    """With three poses no trial is possible: both ends of the line may be wrong."""
    q_nc = np.array([1.0, 0, 0, 0])
    poses = moving([0, 0.03, 0.06], np.array([3.0, 0, 0]), np.zeros(3), q_nc)
    found = predicted(poses, 160_000_000, GAP_S)
    assert found.position_n[0] == pytest.approx(0.48, abs=1e-9)
    # A slope over 50 ms between two ends of 1 cm each, over 100 ms: 2.83 cm; and the pose's own.
    assert found.covariance[0, 0] >= SIGMA_M**2 * (1 + 2 * 2**2)


def test_poses_before_a_gap_do_not_count():
    """The aircraft turned round meanwhile."""
    q_nc = np.array([1.0, 0, 0, 0])
    before = moving(np.arange(0, 0.5, 0.02), np.array([9.0, 0, 0]), np.zeros(3), q_nc)
    after = moving(np.arange(2, 2.2, 0.02), np.array([-3.0, 0, 0]), np.zeros(3), q_nc)
    found = predicted([*before, *after], 2_280_000_000, GAP_S)
    assert found.position_n[0] == pytest.approx(-3 * 2.28, abs=1e-6)
