"""Define quality of service: sensor data best effort, outputs reliable, the origin latched."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

#: For streams of which every sample counts: 2 s of an IMU at 400 Hz. A node that pauses for 2 s
#: still gets every sample, if the transport buffers as much (``config/fastdds.xml``).
STREAM_DEPTH = 800
#: A frame that waits behind another is already too late.
IMAGE_DEPTH = 2
OUTPUT_DEPTH = 20


def sensor_input(depth: int = STREAM_DEPTH) -> QoSProfile:
    """Return the profile for a topic from a sensor, compatible with any publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def output(depth: int = OUTPUT_DEPTH) -> QoSProfile:
    """Return the profile for a topic that this package publishes, or reads without loss."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """Return the profile for a topic whose last message a late subscriber still gets."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
