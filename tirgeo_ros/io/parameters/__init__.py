"""Read and write ROS 2 parameter files."""
