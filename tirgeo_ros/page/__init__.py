"""Serve the operator's page: video, map, targets and checks in a browser; no ROS."""
