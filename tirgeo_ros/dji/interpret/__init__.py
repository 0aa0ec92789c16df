"""Interpret the aircraft's readings: readings in, the core's samples out."""
