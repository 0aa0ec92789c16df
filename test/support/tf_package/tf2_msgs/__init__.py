"""Stands in for ROS's tf2_msgs, which no wheel has: ``PYTHONPATH`` of a test's nodes names it."""
