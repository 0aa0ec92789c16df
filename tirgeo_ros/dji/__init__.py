"""Decode the aircraft's bytes and foreign ROS messages into the core's samples. No ROS."""
