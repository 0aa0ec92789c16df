"""Read and write files: bags, maps, parameter files, surveys. No ROS."""
