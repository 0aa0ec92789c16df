"""Read the aircraft's data from each source: serial link, psdk_ros2, ROS 1 bags."""
