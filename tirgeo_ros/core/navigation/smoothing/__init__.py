"""Smooth a flight: give every pose what the measurements before and after it say."""
