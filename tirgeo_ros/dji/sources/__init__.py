"""Read what the aircraft says over each way: serial link, psdk_ros2, ROS 1 bags."""
