"""Define quality of service: sensor data best effort, outputs reliable, the origin latched."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tirgeo_ros.io.messages.offered_qos import (
    IMAGE_DEPTH,
    OUTPUT_DEPTH,
    STREAM_DEPTH,
    TF_DEPTH,
)

__all__ = ["IMAGE_DEPTH", "STREAM_DEPTH", "TF_DEPTH", "latched", "output", "sensor_input"]


def sensor_input(depth: int = STREAM_DEPTH) -> QoSProfile:
    """Return the profile for a topic from a sensor, compatible with any publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def output(depth: int = OUTPUT_DEPTH) -> QoSProfile:
    """Return the profile for a topic that this package publishes, or reads without loss."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int = 1) -> QoSProfile:
    """Return the profile for a topic whose last message a late subscriber still gets."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
