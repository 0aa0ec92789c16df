"""Hold a vector map in memory and find the part of it that a camera sees."""
