"""The aircraft's language: bytes and foreign messages in, the core's samples out. No ROS."""
