"""Read and write bags: MCAP of ROS 2, and ROS 1."""
