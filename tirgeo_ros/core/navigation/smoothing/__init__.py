"""Smooth a flight: estimate each pose from the measurements before and after it."""
