"""Estimate an IMU's noise from records at rest (Allan variance) and in flight (spectra)."""
