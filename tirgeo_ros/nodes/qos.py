"""Quality of service: sensor data best effort, outputs reliable, the origin latched."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Of streams whose every sample counts: 2 s of an IMU at 400 Hz. A node that stands still for so
#: long finds all of it, if the transport holds as much (``config/fastdds.xml``).
STREAM_DEPTH = 800
#: A frame that waits behind another is already late.
IMAGE_DEPTH = 2
OUTPUT_DEPTH = 20


def sensor_input(depth: int = STREAM_DEPTH) -> QoSProfile:
    """For a topic from a sensor, which a publisher of any kind fits."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT
    )


def output(depth: int = OUTPUT_DEPTH) -> QoSProfile:
    """For a topic that this package publishes; also for reading one without loss."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE
    )


def latched() -> QoSProfile:
    """For a topic whose last message a late reader gets too."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
