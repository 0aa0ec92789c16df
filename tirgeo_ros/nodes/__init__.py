"""The ROS nodes, one thin file each."""
