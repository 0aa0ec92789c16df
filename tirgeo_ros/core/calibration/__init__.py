"""Estimate parameters of IMU, lens, boresight, orthophoto and aircraft from recordings."""
