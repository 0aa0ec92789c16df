"""Run the ROS nodes, one thin file each."""
