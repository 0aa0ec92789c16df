"""What people run. No ROS."""
