"""Read and write bags: of ROS 2 as recorders leave them, and of ROS 1."""
