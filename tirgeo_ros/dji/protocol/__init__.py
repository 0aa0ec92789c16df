"""Decode and encode the contents of frames of DJI's OPEN protocol."""
