"""Propagate state and covariance with the IMU: strapdown, error model, Kalman update."""
