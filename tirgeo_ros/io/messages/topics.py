"""Name the topics that are not of sensors with their types, and what messages name inside."""

from __future__ import annotations

#: Topic to type; those of the sensors are in ``sensor_messages``.
OTHER_TYPES: dict[str, str] = {
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
    "tirgeo/locate/answer": "diagnostic_msgs/msg/DiagnosticArray",
    "tirgeo/targets": "visualization_msgs/msg/MarkerArray",
    "tirgeo/findings": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}

#: Frame of joint messages that were computed without encoders: the topic of their source.
COMPUTED_FROM = "gimbal/attitude"

#: The gimbal's joints in the order of its chain, and the sign of each from FLU to FRD: the axes y
#: and z point the other way, x does not.
JOINT_SIGNS = {"gimbal_yaw_joint": -1.0, "gimbal_roll_joint": 1.0, "gimbal_pitch_joint": -1.0}
