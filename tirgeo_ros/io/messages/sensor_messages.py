"""Map each of the sensors' samples to its topic and message, and back; tell each topic's QoS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    JointSample,
    NavigationInput,
    Source,
)
from tirgeo_ros.io.messages.decode import (
    camera_attitude,
    heading_sample,
    imu_sample,
    joint_sample,
    position_sample,
    pressure_sample,
    set_heading,
    velocity_sample,
)
from tirgeo_ros.io.messages.encode import Messages

SensedSample = NavigationInput | JointSample | CameraAttitudeSample


class _Row(NamedTuple):
    """Hold a topic's message type, and the functions that convert its messages."""

    typename: str
    decode: Callable[[Any], Any]
    encode: Callable[[Messages, Any], Any]
    topic: str = ""  # of a sample that is no source of the filter
    by_dji: bool = True  # whether dji_node publishes it


_FIX, _TWIST = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistWithCovarianceStamped"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_IMU, _PRESSURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/FluidPressure"


def _fix(source: Source, frame: str) -> _Row:
    decode = partial(position_sample, source=source)
    return _Row(_FIX, decode, lambda m, s: m.nav_sat_fix(s, getattr(m.frames, frame)))


def _velocity(source: Source, frame: str) -> _Row:
    decode = partial(velocity_sample, source=source)
    return _Row(_TWIST, decode, lambda m, s: m.velocity(s, getattr(m.frames, frame)))


_ROWS: dict[Source | type, _Row] = {
    Source.IMU: _Row(_IMU, imu_sample, Messages.imu),
    Source.RTK_POSITION: _fix(Source.RTK_POSITION, "rtk_antenna"),
    Source.RTK_VELOCITY: _velocity(Source.RTK_VELOCITY, "rtk_antenna"),
    Source.RTK_HEADING: _Row(_IMU, heading_sample, Messages.heading),
    Source.GPS_POSITION: _fix(Source.GPS_POSITION, "gps_antenna"),
    Source.GPS_VELOCITY: _velocity(Source.GPS_VELOCITY, "gps_antenna"),
    Source.BAROMETER: _Row(_PRESSURE, pressure_sample, Messages.pressure, by_dji=False),
    Source.SET_HEADING: _Row(_POSE, set_heading, Messages.set_heading, by_dji=False),
    JointSample: _Row(
        "sensor_msgs/msg/JointState", joint_sample, Messages.joints, "gimbal/joint_states"
    ),
    CameraAttitudeSample: _Row(
        "geometry_msgs/msg/QuaternionStamped",
        camera_attitude,
        Messages.camera_attitude,
        "gimbal/attitude",
    ),
}
_BY_TOPIC = {
    (key.topic if isinstance(key, Source) else row.topic): row for key, row in _ROWS.items()
}

#: Topic to type. A leading slash marks a topic that no namespace applies to.
TOPIC_TYPES: dict[str, str] = {topic: row.typename for topic, row in _BY_TOPIC.items()} | {
    "thermal/image_raw": "sensor_msgs/msg/Image",
    "thermal/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "thermal/camera_info": "sensor_msgs/msg/CameraInfo",
    "tirgeo/locate/pixel": "geometry_msgs/msg/PointStamped",
    "tirgeo/odometry": "nav_msgs/msg/Odometry",
    "tirgeo/fix": "sensor_msgs/msg/NavSatFix",
    "tirgeo/origin": "sensor_msgs/msg/NavSatFix",
    "tirgeo/camera_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "tirgeo/overlay/image": "sensor_msgs/msg/Image",
    "tirgeo/overlay/image/compressed": "sensor_msgs/msg/CompressedImage",
    "tirgeo/overlay/camera_info": "sensor_msgs/msg/CameraInfo",
    "tirgeo/footprint": "geometry_msgs/msg/PolygonStamped",
    "tirgeo/path": "nav_msgs/msg/Path",
    "tirgeo/locate/fix": "sensor_msgs/msg/NavSatFix",
    "tirgeo/locate/point": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "tirgeo/locate/answer": "std_msgs/msg/String",
    "tirgeo/targets": "std_msgs/msg/String",
    "tirgeo/targets/markers": "visualization_msgs/msg/MarkerArray",
    "tirgeo/findings": "std_msgs/msg/String",
    "tirgeo/state": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}

#: Each source of the filter: its topic, and the decoder of its messages.
NAVIGATION_INPUTS: Mapping[Source, tuple[str, Callable[[Any], NavigationInput]]] = {
    source: (source.topic, row.decode)
    for source, row in _ROWS.items()
    if isinstance(source, Source)
}

#: The topics that sensors' samples are published on, and those of them that dji_node publishes.
SENSED_TOPICS = tuple(_BY_TOPIC)
DJI_TOPICS = tuple(topic for topic, row in _BY_TOPIC.items() if row.by_dji)

#: The decoder of each of these topics' messages.
SENSED_SAMPLES: Mapping[str, Callable[[Any], SensedSample]] = {
    topic: row.decode for topic, row in _BY_TOPIC.items()
}


def topic_of(sample: SensedSample) -> str:
    """Return the topic of the contract of a sensor's sample."""
    if isinstance(sample, JointSample | CameraAttitudeSample):
        return _ROWS[type(sample)].topic
    return sample.source.topic


def sensed(messages: Messages, sample: SensedSample) -> tuple[str, Any]:
    """Return the topic of the contract and the message of a sensor's sample."""
    topic = topic_of(sample)
    return topic, _BY_TOPIC[topic].encode(messages, sample)


#: For streams of which every sample counts: 2 s of an IMU at 400 Hz. A node that pauses for 2 s
#: still gets every sample, if the transport buffers as much (``config/fastdds.xml``).
STREAM_DEPTH = 800
#: A frame that waits behind another is already too late.
IMAGE_DEPTH = 2
OUTPUT_DEPTH = 20
#: As tf2's own broadcasters have it.
TF_DEPTH = 100
_STREAMS = (*SENSED_TOPICS, "tirgeo/odometry", "tirgeo/camera_pose")
_IMAGES = (
    *("image_raw", "image_raw/compressed"),
    *("overlay/image", "overlay/image/compressed", "overlay/camera_info"),
)
_LATCHED = (
    *("tirgeo/origin", "tirgeo/targets", "tirgeo/targets/markers", "tirgeo/state"),
    "tf_static",
)
#: In the order and the words of rosbag2's metadata from version 9 (Jazzy) on. The times are
#: ROS's infinity, which a recorder finds where a publisher sets none.
_TEXT = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""


class OfferedQos(NamedTuple):
    """Hold what a reliable publisher offers: the depth of its queue, and whether it latches."""

    depth: int
    latched: bool = False  # durability transient local: a late subscriber gets the last message

    @property
    def text(self) -> str:
        """Return the profile as rosbag2 reads it in ``offered_qos_profiles``: YAML, a list."""
        durability = "transient_local" if self.latched else "volatile"
        return _TEXT.format(depth=self.depth, durability=durability)


def offered_qos(topic: str) -> OfferedQos:
    """Return what is offered on a topic, in whatever namespace."""
    if _ends(topic, _LATCHED):
        return OfferedQos(1, latched=True)
    if _ends(topic, _STREAMS):
        return OfferedQos(STREAM_DEPTH)
    if _ends(topic, ("tf",)):
        return OfferedQos(TF_DEPTH)
    return OfferedQos(IMAGE_DEPTH if _ends(topic, _IMAGES) else OUTPUT_DEPTH)


def _ends(topic: str, names: tuple[str, ...]) -> bool:
    return f"/{topic}".endswith(tuple(f"/{name}" for name in names))
