"""The composer: what waits, what is composed, what is dropped and how it is counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.attitude import (
    matrix_from_quat,
    quat_from_euler,
    wrap_pi,
)
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames import BODY_OPTICAL
from tirgeo_ros.core.gimbal import GimbalComposer
from tirgeo_ros.core.samples import BodyPose, CameraAttitudeSample, JointSample

MS = 1_000_000
YAW_RATE = 0.8  # rad/s, of the body


def body(t_ms, yaw=None):
    yaw = YAW_RATE * t_ms * 1e-3 if yaw is None else yaw
    position_n = np.array([3e-3 * t_ms, 0.0, -20.0])
    return BodyPose(t_ms * MS, position_n, quat_from_euler(0.0, 0.0, yaw), np.eye(6) * 1e-4)


def joints(t_ms):
    return JointSample(t_ms * MS, 0.1, 0.0, -0.5)


def reported(t_ms, yaw):
    return CameraAttitudeSample(t_ms * MS, quat_from_euler(0.0, -0.5, yaw))


def heading(pose):
    forward = (matrix_from_quat(pose.q_nc) @ BODY_OPTICAL.T)[:, 0]
    return float(np.arctan2(forward[1], forward[0]))


def test_waits_for_the_body_then_interpolates():
    composer = GimbalComposer(GimbalConfig(composition="encoders"))
    assert composer.add_body(body(0)) == []
    assert composer.add_joints(joints(5)) == []
    (pose,) = composer.add_body(body(10))
    assert pose.stamp_ns == 5 * MS
    np.testing.assert_allclose(pose.position_n, [15e-3, 0, -20], atol=1e-12)
    assert heading(pose) == pytest.approx(YAW_RATE * 5e-3 + 0.1, abs=1e-12)
    assert composer.counts == {"composed": 1}


def test_paper_takes_the_autopilot_of_the_same_instant():
    """The autopilot's heading error, and its turning, cancel in psi_coder."""
    composer = GimbalComposer(GimbalConfig(composition="paper"))
    error = 0.3
    poses = []
    for t_ms in range(0, 101, 10):
        autopilot_yaw = YAW_RATE * t_ms * 1e-3 + error
        poses += composer.add_autopilot(t_ms * MS, quat_from_euler(0.0, 0.0, autopilot_yaw))
        poses += composer.add_body(body(t_ms))
    at_ms = 43  # between two samples of the autopilot
    true_yaw = YAW_RATE * at_ms * 1e-3
    poses += composer.add_attitude(reported(at_ms, true_yaw + 0.1 + error))
    (pose,) = poses
    assert wrap_pi(heading(pose) - (true_yaw + 0.1)) == pytest.approx(0, abs=1e-12)


def arrivals():
    """What comes in 200 ms, each stream in its own order."""
    bodies = [("add_body", (body(t),)) for t in range(0, 201, 10)]
    autopilot = [
        ("add_autopilot", (t * MS, quat_from_euler(0.0, 0.0, YAW_RATE * t * 1e-3 + 0.3)))
        for t in range(0, 201, 10)
    ]
    attitudes = [
        ("add_attitude", (reported(t, YAW_RATE * t * 1e-3 + 0.4),)) for t in range(3, 200, 20)
    ]
    return [bodies, autopilot, attitudes]


@settings(max_examples=20)  # each composes twenty poses
@given(st.randoms(use_true_random=False))
def test_order_of_arrival_changes_nothing(random):
    """Streams mixed in any way give the same poses to the last bit."""
    outputs = []
    for mixed in (False, True):
        composer = GimbalComposer(GimbalConfig(composition="paper"))
        streams = [list(stream) for stream in arrivals()]
        poses = []
        while any(streams):
            open_streams = [stream for stream in streams if stream]
            stream = random.choice(open_streams) if mixed else open_streams[0]
            name, arguments = stream.pop(0)
            poses += getattr(composer, name)(*arguments)
        outputs.append([(p.stamp_ns, p.q_nc.tolist(), p.covariance.tolist()) for p in poses])
    assert len(outputs[0]) == 10
    assert outputs[0] == outputs[1]


def test_dropped_when_the_body_does_not_come():
    composer = GimbalComposer(GimbalConfig(composition="encoders", max_wait_s=0.1))
    composer.add_body(body(0))
    for t_ms in range(10, 131, 20):
        assert composer.add_joints(joints(t_ms)) == []
    # at 130 ms the samples of 10 ms and no other waited for more than 100 ms
    assert composer.counts == {"body_too_new": 1}
    assert [pose.stamp_ns for pose in composer.add_body(body(60))] == [30 * MS, 50 * MS]


def test_dropped_when_the_autopilot_does_not_come():
    composer = GimbalComposer(GimbalConfig(composition="paper", max_wait_s=0.1))
    composer.add_body(body(0))
    composer.add_attitude(reported(5, 0.0))
    for t_ms in range(10, 121, 10):
        assert composer.add_body(body(t_ms)) == []
    assert composer.counts == {"autopilot_empty": 1}


def test_before_the_first_body_and_across_a_gap_there_is_no_pose():
    composer = GimbalComposer(GimbalConfig(composition="encoders"))
    for t_ms in (100, 110, 500, 510):
        composer.add_body(body(t_ms))
    for t_ms in (90, 105, 300, 505):
        composer.add_joints(joints(t_ms))
    assert composer.counts == {"body_too_old": 1, "body_gap": 1, "composed": 2}


def test_auto_goes_over_to_joints_and_stays():
    composer = GimbalComposer(GimbalConfig())
    assert composer.composition == "paper"
    for t_ms in (0, 10):
        composer.add_autopilot(t_ms * MS, quat_from_euler(0.0, 0.0, 0.0))
        composer.add_body(body(t_ms))
    assert len(composer.add_attitude(reported(2, 0.0))) == 1
    assert composer.add_attitude(reported(12, 0.0)) == []
    assert len(composer.add_joints(joints(4))) == 1
    assert composer.composition == "encoders"
    assert composer.add_attitude(reported(6, 0.0)) == []
    # the sample that waited and the later one; joints of 4 ms follow an attitude of 12 ms
    assert composer.counts == {"composed": 2, "unused": 2, "went_back": 1}


def test_paper_ignores_joints():
    composer = GimbalComposer(GimbalConfig(composition="paper"))
    assert composer.add_joints(joints(5)) == []
    assert composer.counts == {"unused": 1}
    assert composer.composition == "paper"


def test_bad_samples_are_counted():
    composer = GimbalComposer(GimbalConfig())
    nan = float("nan")
    composer.add_attitude(CameraAttitudeSample(0, np.zeros(4)))
    composer.add_attitude(CameraAttitudeSample(0, np.array([nan, 0, 0, 1.0])))
    composer.add_joints(JointSample(0, nan, 0.0, 0.0))
    composer.add_joints(JointSample(0, 0.0, float("inf"), 0.0))
    composer.add_autopilot(0, np.zeros(4))
    composer.add_body(BodyPose(0, np.full(3, nan), quat_from_euler(0.0, 0.0, 0.0), np.eye(6)))
    assert composer.counts == {"invalid": 4, "autopilot_invalid": 1, "body_invalid": 1}
    assert composer.composition == "paper"  # a broken joint sample changes nothing


def test_repeated_stamp_gives_one_pose():
    composer = GimbalComposer(GimbalConfig(composition="encoders"))
    composer.add_body(body(0))
    composer.add_body(body(10))
    assert len(composer.add_joints(joints(5))) == 1
    assert composer.add_joints(joints(5)) == []
    assert composer.counts == {"composed": 1, "repeated": 1}


def test_clock_going_back_starts_again():
    composer = GimbalComposer(GimbalConfig(composition="encoders"))
    composer.add_body(body(5000))
    composer.add_joints(joints(5005))
    composer.add_body(body(0))
    composer.add_joints(joints(5))
    (pose,) = composer.add_body(body(10))
    assert pose.stamp_ns == 5 * MS
    assert composer.counts == {"composed": 1, "went_back": 1, "body_went_back": 1}


def test_boresight_of_the_parameters_is_applied():
    plain = GimbalComposer(GimbalConfig(composition="encoders"))
    turned = GimbalComposer(
        GimbalConfig(composition="encoders", boresight_rpy_deg=(0.0, 0.0, -3.0))
    )
    found = []
    for composer in (plain, turned):
        composer.add_body(body(0))
        composer.add_body(body(10))
        found += composer.add_joints(JointSample(5 * MS, 0.1, 0.0, 0.0))
    assert heading(found[1]) - heading(found[0]) == pytest.approx(np.radians(3.0), abs=1e-12)
