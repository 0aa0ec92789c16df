"""Files: bags, maps, parameter files, surveys. No ROS."""
