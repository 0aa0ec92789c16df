"""Compute the camera's attitude that the flight controller would give at an instant."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_multiply, slerp
from tirgeo_ros.core.gimbal.joint_geometry import camera_turn
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.dji.protocol.broadcast_parts import Gimbal


class SimulatedGimbalAngles:
    """Interpolate the recorded gimbal attitudes.

    ``joints``: combine the aircraft's attitude with the encoders' angles, so that encoder angles
    survive a protocol that has none. Without them, or if it is false, use the recorded attitude.
    Nothing is extrapolated.
    """

    def __init__(self, *, joints: bool, order: str, max_gap_s: float) -> None:
        self._by_joints, self._order = joints, order
        self._joints: StampedBuffer[Array] = StampedBuffer(max_gap_s=max_gap_s)  # q_bg
        self._reported: StampedBuffer[Array] = StampedBuffer(max_gap_s=max_gap_s)  # q_ng

    def take(self, sample: JointSample | CameraAttitudeSample) -> bool:
        """Take a sample, which may be of the future; return whether it is valid."""
        if isinstance(sample, CameraAttitudeSample):
            sound = usable_attitude(sample.q_ng)
            if sound:
                self._reported.put(sample.stamp_ns, sample.q_ng)
            return sound
        sound = math.isfinite(sample.yaw_rad + sample.roll_rad + sample.pitch_rad)
        if sound:
            self._joints.put(sample.stamp_ns, camera_turn(sample, self._order))
        return sound

    def at(self, stamp_ns: int, q_nb: Array | None) -> Gimbal | None:
        """Return the camera's angles at an instant, None if they are not known.

        ``q_nb`` (4,) is the aircraft's own attitude, None if it is not known.
        """
        q_ng = self._attitude(stamp_ns, q_nb)
        if q_ng is None:
            return None
        roll_deg, pitch_deg, yaw_deg = np.degrees(euler_from_quat(q_ng)).tolist()
        return Gimbal(roll_deg, pitch_deg, yaw_deg)

    def _attitude(self, stamp_ns: int, q_nb: Array | None) -> Array | None:
        if self._by_joints and q_nb is not None:
            joints = self._joints.around(stamp_ns)
            if not isinstance(joints, Miss):
                return quat_multiply(q_nb, slerp(*joints))
        reported = self._reported.around(stamp_ns)
        return None if isinstance(reported, Miss) else slerp(*reported)
