"""Convert the aircraft's readings to the core's samples."""
