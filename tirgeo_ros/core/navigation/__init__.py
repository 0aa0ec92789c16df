"""Estimate the aircraft's position, velocity and attitude from its IMU and receivers."""
