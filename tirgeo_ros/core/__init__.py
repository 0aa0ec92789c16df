"""Mathematics of the geo-registration: no ROS, no files, no printing."""
