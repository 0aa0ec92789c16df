"""Measure how a camera moved up to an exposure."""

from __future__ import annotations

from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.types.poses import CameraPose

#: Less than a turn takes, enough for the noise.
RATES_S = 0.1


def rates_up_to(pose: CameraPose, poses: PoseBuffer[CameraPose]) -> CameraRates | None:
    """Return the camera's rates up to a pose; None if they are not known."""
    before = poses.at(pose.stamp_ns - round(RATES_S * 1e9))
    return None if isinstance(before, Miss) else CameraRates.between(before, pose)
