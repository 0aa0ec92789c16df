"""Compute the geo-registration: mathematics without ROS, files or printing."""
