"""Define the ROS nodes, one thin file each."""
