"""Quality of service: sensor data best effort and shallow, outputs reliable, origin latched."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Inputs whose every sample counts, yet of which a slow reader wants the newest: at 100 Hz this
#: bridges a hiccup of 0.2 s. Beyond that the filter would call it a gap anyway.
SENSOR_DEPTH = 20
#: A frame that waits behind another is already late.
IMAGE_DEPTH = 2
OUTPUT_DEPTH = 20


def sensor_input(depth: int = SENSOR_DEPTH) -> QoSProfile:
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
