"""Decode and encode what frames of DJI's OPEN protocol hold."""
