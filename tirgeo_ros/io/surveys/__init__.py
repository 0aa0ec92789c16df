"""Read and write surveyed points and their observations."""
